"""Either kind of pattern."""

from __future__ import annotations

from retrue.patterns.color_grid import ColorGrid
from retrue.patterns.gray_code import GrayCode

Pattern = GrayCode | ColorGrid
