"""What the captures themselves say of the pose, before anybody judges it. Shared by recalibrate and verify."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from retrue.correspondences import Correspondences
from retrue.geometry.arrays import FloatArray
from retrue.recalibration.candidates import Comparison, compare_candidates, with_planes
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.prepare import Rays, rays_of_captures
from retrue.recalibration.reasons import NoPlane, PointsNotSpread, TooFewPoints, Undecidable
from retrue.rig import Rig


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """All rays, with the plane of each, and both candidates."""

    rays: Rays
    comparison: Comparison


def estimate_pose(rig: Rig, captures: Sequence[Correspondences], options: RecalibrateOptions) -> Estimate:
    """decode -> SPLIT OFF PLANES -> CANDIDATES -> REFINE -> COMPARE -> judge.

    Raises DegenerateError, with what to do, where there are too few points, no plane, or no pose.
    """
    rng = np.random.default_rng(options.seed)
    rays = rays_of_captures(rig, captures, options.max_points, rng)
    _check_spread(rays, options)
    rays, homographies = with_planes(rays, float(rig.projector.K[0, 0]), options, rng)
    if not homographies:
        raise Undecidable(NoPlane(len(rays)))
    return Estimate(rays, compare_candidates(rays, homographies, rng))


def _check_spread(rays: Rays, options: RecalibrateOptions) -> None:
    if len(rays) < options.min_points:
        raise Undecidable(TooFewPoints(len(rays), options.min_points))
    for name, points in (("camera", rays.points.camera_rays), ("projector", rays.points.projector_rays)):
        largest, smallest = _spread(points)
        if not largest > 1e-9:
            raise Undecidable(PointsNotSpread(name, "place"))
        if not smallest > 1e-6 * largest:
            raise Undecidable(PointsNotSpread(name, "line"))


def _spread(points: FloatArray) -> tuple[float, float]:
    """Standard deviations along the widest and the narrowest direction."""
    low, high = np.linalg.eigvalsh(np.cov(points.T))
    return float(np.sqrt(max(high, 0.0))), float(np.sqrt(max(low, 0.0)))
