"""What a reconstruction can be told; apart from it, so that `--help` need not load NumPy."""

from __future__ import annotations

from dataclasses import dataclass

from retrue.ranges import check_ranges, ranged


@dataclass(frozen=True, slots=True)
class ReconstructOptions:
    """How a cloud is made.

    Attributes
    ----------
    outlier_sigmas
        Drop a point whose rays pass each other by more than this many times the typical distance.
    keep_strays
        Keep points that lie on no surface, and pieces of surface too small to have an inside.
    smooth
        Even out noise over the capture's grid, never over an edge.
    albedo
        Colour points by their surface alone: the shading of the projector's light is divided out.
    """

    outlier_sigmas: float = ranged(6.0, 0, above=True)
    keep_strays: bool = False
    smooth: bool = False
    albedo: bool = False

    def __post_init__(self) -> None:
        check_ranges(self)
