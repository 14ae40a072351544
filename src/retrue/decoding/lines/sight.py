"""What the decoder saw of a line grid: the record that drawings are made of, and advice."""

from __future__ import annotations

from dataclasses import dataclass

from retrue.decoding.lines.crossings import Crossings
from retrue.decoding.lines.places import Places
from retrue.decoding.lines.surfaces import Surfaces
from retrue.decoding.pictures import unusable_picture
from retrue.geometry.arrays import FloatArray, Image
from retrue.patterns.line_grid import LineGrid

GOOD_COUNT = 30  # points that a job can work with
SMALLEST_PITCH = 5.0  # px


@dataclass(frozen=True, slots=True, eq=False)
class LineSight:
    """One look at a picture. N crossings of lines; grid arrays are (rows, columns) of the code, NaN where nothing is.

    Attributes
    ----------
    picture : (h, w, 3) that was looked at, in full size.
    halvings : how many times it was halved to find the lines.
    crossings, places : in pixels of the halved picture.
    surfaces : what was decoded, in pixels of `picture`.
    sigma_px : (rows, columns) standard deviation of each crossing, per axis.
    pitch_px : median distance between lines, decoded or else seen, in pixels of `picture`; 0: none.
    """

    pattern: LineGrid
    picture: Image
    halvings: int
    crossings: Crossings
    places: Places
    surfaces: Surfaces
    sigma_px: FloatArray
    pitch_px: float

    @property
    def decoded(self) -> int:
        """How many crossings."""
        return int(self.surfaces.held.sum())

    def rejected(self) -> dict[str, int]:
        """How many of the crossings that were seen were not decoded, by reason."""
        placed = int((self.places.column >= 0).sum())
        counts = {
            "colours fit no place of the code": len(self.crossings) - max(placed, self.decoded),
            "off its surface, or surface too small to be sure": placed - self.decoded,
        }
        return {reason: count for reason, count in counts.items() if count > 0}


def advise(sight: LineSight) -> str:
    """One sentence for the user; empty where there is nothing to say."""
    if sight.decoded >= GOOD_COUNT:
        return ""
    if unusable := unusable_picture(sight.picture):
        return unusable
    if not sight.pitch_px > 0 or len(sight.crossings) < GOOD_COUNT:
        return "no lines seen: out of focus, or closer than 5 px: focus, move closer or use a coarser grid"
    if sight.pitch_px < SMALLEST_PITCH:
        return "lines closer than 5 px: move closer or use a coarser grid"
    return "not this pattern: lines cross there, but their colours are not those of this code (or it is mirrored)"
