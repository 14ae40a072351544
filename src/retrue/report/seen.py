"""What a job was given."""

from __future__ import annotations

from dataclasses import dataclass

from retrue.correspondences import Correspondences
from retrue.geometry.arrays import Image


@dataclass(frozen=True, slots=True, eq=False)
class SeenCapture:
    """One capture: its name, what was decoded from it, and the photograph where there is one."""

    name: str
    points: Correspondences
    picture: Image | None = None
