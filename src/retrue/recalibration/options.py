"""Named limits of the recalibration; each is a number that a user may have a reason to change."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # so that the command line's help loads no NumPy
    from retrue.geometry.arrays import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class KnownDistance:
    """The true length between the scene points seen at two camera pixels of the first capture: it gives |t|.

    Attributes
    ----------
    first_px, second_px : (2,) camera pixels (x, y).
    length : in the rig's unit.
    """

    first_px: FloatArray
    second_px: FloatArray
    length: float


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
    prior_drift_deg
        How far the direction of t plausibly turns (one sigma); resolves the twins where the scene cannot.
    prior_odds
        Odds that the old direction of t must give before it resolves the twins.
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
    max_change_deg
        A rotation, or a direction of t, that changed by more than this is refused: no bump does that.
    focal_sigma
        How well the focal lengths are known, relative; part of the sigma of the pose.
    principal_point_sigma_px
        How well the principal points are known; likewise.
    flatness_sigma
        How far planes are bowed, RMS relative to their distance; likewise.
    max_focal_change
        Residuals that ask for a focal length further off than this, relative, are a sign of zoom or focus.
    seed
        Of the random samples; the same points and seed give the same answer.
    """

    known_distance: KnownDistance | None = None
    twin_margin: float = 25.0
    twin_deviations: float = 3.5
    prior_drift_deg: float = 10.0
    prior_odds: float = 1000.0
    min_points: int = 12
    max_planes: int = 4
    max_points: int = 20_000
    max_sigma_rotation_deg: float = 1.0
    max_sigma_translation_deg: float = 3.0
    max_noise_px: float = 2.0
    max_structure_px: float = 0.15
    max_outliers: float = 0.65
    max_change_deg: float = 45.0
    focal_sigma: float = 1e-3
    principal_point_sigma_px: float = 1.0
    flatness_sigma: float = 5e-4
    max_focal_change: float = 5e-3
    seed: int = 0
