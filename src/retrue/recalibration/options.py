"""Named limits of the recalibration; each is a number that a user may have a reason to change."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING

from retrue.errors import InputError
from retrue.ranges import check_ranges, ranged
from retrue.values import ByValue

if TYPE_CHECKING:  # so that the command line's help loads no NumPy
    from retrue.geometry.arrays import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class KnownDistance(ByValue):
    """The true length between the scene points seen at two camera pixels of the first capture: it gives |t|.

    Attributes
    ----------
    first_px, second_px : (2,) camera pixels (x, y).
    length : in the rig's unit.
    """

    first_px: FloatArray
    second_px: FloatArray
    length: float

    def __post_init__(self) -> None:
        from retrue.geometry.arrays import finite_array, frozen_array

        for name in ("first_px", "second_px"):
            pixel = finite_array(getattr(self, name), (2,), f"known distance, {name}")
            object.__setattr__(self, name, frozen_array(pixel))
        if not 0 < self.length < inf:
            raise InputError(f"known distance: expected a positive length, found {self.length}")


@dataclass(frozen=True, slots=True)
class RecalibrateOptions:
    """Limits of `recalibrate`.

    Attributes
    ----------
    known_distance
        Two camera pixels and the true length between their points. Without it the old |t| is kept.
    twin_margin
        Chi-square by which points off the plane must prefer one of the twin poses.
    twin_deviations
        The same in standard deviations of a sum over points that agree by chance.
    max_behind
        Share of its plane's points that a pose may have behind a device; the twin often has more, and is impossible.
    min_points
        Fewest correspondences, and fewest points on a plane.
    max_planes
        Planes split off from one capture, largest first.
    max_points
        Correspondences used in all; more are thinned out evenly. Neighbours in a dense code repeat each other.
    max_sigma_rotation_deg
        A rotation that the points determine less certainly than this is refused.
    max_sigma_translation_deg
        Likewise for the direction of t.
    max_noise_px
        Correspondences noisier than this, about the pose that fits them best, are none.
    max_structure_px
        Residuals that neighbours share beyond this are no noise: the intrinsics do not hold.
    max_outliers
        Share of correspondences that may contradict the pose.
    max_contradicting
        Share of the points that may contradict the pose together, as a surface and not as wrong matches.
    max_interleaved
        Share of the points whose neighbour may lie on another plane; mixed pictures of two poses have more.
    max_change_deg
        A rotation, or a direction of t, that changed by more than this is refused: no bump does that.
    max_unchecked_change_deg
        The same where the points cannot check the focal lengths, as on a bare wall: there a zoom looks like a move.
    min_fold_deg
        With t nearer to the plane's normal than this, no covariance holds.
    focal_sigma
        How well the focal lengths are known, relative; part of the sigma of the pose.
    principal_point_sigma_px
        How well the principal points are known; likewise.
    flatness_sigma
        How far planes are bowed, RMS relative to their distance; likewise.
    max_focal_change
        Residuals that ask for a focal length further off than this, relative, are a sign of zoom or focus,
    focal_deviations
        if they ask for it with so many standard deviations.
    seed
        Of the random samples; the same points and seed give the same answer.
    """

    known_distance: KnownDistance | None = None
    twin_margin: float = ranged(25.0, 0)
    twin_deviations: float = ranged(3.5, 0)
    max_behind: float = ranged(0.02, 0, 1)
    min_points: int = ranged(12, 4)
    max_planes: int = ranged(4, 1)
    max_points: int = ranged(20_000, 4)
    max_sigma_rotation_deg: float = ranged(1.0, 0, 180)
    max_sigma_translation_deg: float = ranged(3.0, 0, 180)
    max_noise_px: float = ranged(2.0, 0)
    max_structure_px: float = ranged(0.1, 0)
    max_outliers: float = ranged(0.65, 0, 1)
    max_contradicting: float = ranged(0.05, 0, 1)
    max_interleaved: float = ranged(0.3, 0, 1)
    max_change_deg: float = ranged(45.0, 0, 180)
    max_unchecked_change_deg: float = ranged(15.0, 0, 180)
    min_fold_deg: float = ranged(2.0, 0, 90)
    focal_sigma: float = ranged(2e-3, 0, 1)
    principal_point_sigma_px: float = ranged(1.0, 0, 1e6)
    flatness_sigma: float = ranged(5e-4, 0, 1)
    max_focal_change: float = ranged(1e-2, 0)
    focal_deviations: float = ranged(5.0, 0)
    seed: int = ranged(0, 0, 2**32 - 1)

    def __post_init__(self) -> None:
        check_ranges(self)
