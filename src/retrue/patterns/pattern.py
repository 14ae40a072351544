"""Every kind of pattern."""

from __future__ import annotations

from retrue.patterns.color_grid import ColorGrid
from retrue.patterns.gray_code import GrayCode
from retrue.patterns.line_grid import LineGrid
from retrue.patterns.sequence import FrameSequence

Pattern = GrayCode | ColorGrid | LineGrid | FrameSequence
PATTERNS = (ColorGrid, LineGrid, GrayCode, FrameSequence)
"""For `isinstance`."""
