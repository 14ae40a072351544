"""What goes to CAD: patches of surface with outlines, and how far the points lie from them."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from retrue.cad.surfaces import Surface
from retrue.geometry.arrays import FloatArray, IntArray
from retrue.shown import ShortRepr, Shown, counted, figures
from retrue.values import ByValue

Outline = tuple[FloatArray, ...]
"""Closed polygons (K, 2) in the parameters of a surface: the outer one, then those around holes."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Patch(ByValue, ShortRepr):
    """A piece of one surface.

    Attributes
    ----------
    surface : in the camera frame, in the cloud's unit.
    outlines : one a face, within the cells of its points.
    rows : (N,) the points of the cloud that lie on it.
    max_error, rms_error : distance of those points from the surface.
    tolerance : what `max_error` was to stay within.
    """

    surface: Surface
    outlines: tuple[Outline, ...]
    rows: IntArray
    max_error: float
    rms_error: float
    tolerance: float

    @property
    def met(self) -> bool:
        """Whether every point lies within the tolerance."""
        return self.max_error <= self.tolerance

    def _shown(self) -> Shown:
        title = f"{self.surface.kind}, {counted(len(self.rows), 'point')}, RMS {figures(self.rms_error)}"
        return f"{title}, at most {figures(self.max_error)} of {figures(self.tolerance)} allowed", {}


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class CadModel(ByValue, ShortRepr):
    """All patches of a cloud.

    Attributes
    ----------
    patches : largest first.
    unit : the cloud's unit of length.
    points : how many the cloud has.
    """

    patches: tuple[Patch, ...]
    unit: str
    points: int

    @property
    def left_out(self) -> int:
        """Points of the cloud that are on no patch."""
        return self.points - sum(len(patch.rows) for patch in self.patches)

    def _shown(self) -> Shown:
        kinds = Counter(patch.surface.kind for patch in self.patches)
        title = ", ".join(counted(count, kind) for kind, count in kinds.items())
        return f"{title} in {self.unit}", {"points": f"{self.points - self.left_out:,} of {self.points:,} lie on them"}
