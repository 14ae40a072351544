"""A capture in memory: what it showed, and the points that were found in it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from retrue.correspondences import Card, Correspondences
from retrue.geometry.arrays import Image


@dataclass(frozen=True, slots=True, eq=False)
class Capture:
    """One capture, read once; whoever shows it or judges it looks here, and not on the disk again.

    Attributes
    ----------
    name : for people.
    points : what was decoded from it, or read from a table.
    photograph : (h, w) or (h, w, 3), what it looked like: the picture of a colour grid, or the scene of a sequence
        in white light; None for a table, and where nobody asked to keep it.
    size : (width, height) of its pictures; None for a table.
    path : where it lies; None where it came from no file.
    """

    name: str
    points: Correspondences
    photograph: Image | None = None
    size: tuple[int, int] | None = None
    path: Path | None = None

    @property
    def card(self) -> Card | None:
        """What the decoder has to say."""
        return self.points.card
