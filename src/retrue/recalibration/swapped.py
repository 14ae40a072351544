"""Were camera and projector taken for each other? Their points then ask for a pose far off; exchanged, for one near."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from retrue.correspondences import Correspondences
from retrue.errors import DegenerateError
from retrue.geometry.two_view import TwoViewPose
from retrue.rasters import MOST_OUTSIDE
from retrue.recalibration.candidates import match_noise, refined_poses, starting_poses, with_planes
from retrue.recalibration.costs import mean_cost_across
from retrue.recalibration.fit import Support
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.posterior import Posterior
from retrue.recalibration.rays import rays_of_captures
from retrue.recalibration.rivals import move_deg
from retrue.recalibration.turned_pictures import inside
from retrue.rig import Rig

FAR_MOVE_DEG = 15.0
NEARER = 3.0  # times, than the answer is to the old pose, where points tell the two not apart
AS_WELL = 0.8  # of chi-square, each point: noise that is half as large again
BETTER = 0.3  # of chi-square, each point: more than what no model holds
ASKED_POINTS = 800


def exchanged(capture: Correspondences) -> Correspondences:
    """The same matches, the camera's for the projector's."""
    return replace(
        capture,
        camera_px=capture.projector_px,
        projector_px=capture.camera_px,
        camera_sigma_px=capture.projector_sigma_px,
        projector_sigma_px=capture.camera_sigma_px,
        camera_size=capture.projector_size,
        projector_size=capture.camera_size,
    )


def move_if_exchanged(
    rig: Rig, captures: Sequence[Correspondences], answer: Posterior, old: TwoViewPose, options: RecalibrateOptions
) -> float | None:
    """How far the rig moved, degrees, if its devices were exchanged.

    None where that explains nothing better, is itself louder than an answer may be, or the pixels of the one are none
    of the other.
    """
    moved = move_deg(answer.pose, old)
    if not moved > FAR_MOVE_DEG:
        return None
    captures = [exchanged(capture) for capture in captures]
    if not inside(rig, captures) >= 1 - MOST_OUTSIDE:
        return None
    rng = np.random.default_rng(options.seed)
    try:
        rays = rays_of_captures(rig, captures, ASKED_POINTS, rng)
        rays, homographies = with_planes(rays, rig, options, rng)
        starts = starting_poses(rays.points, homographies, old, match_noise(rays.points, rng)[0], rng)
        fits = refined_poses(starts, Support.of(rays), rng)
    except DegenerateError:
        return None
    fits = [fit for fit in fits if fit.epipolar_noise.level <= options.max_noise_px]
    least = min(fit.epipolar_noise.level for fit in (answer.fit, *fits))
    own = mean_cost_across(answer.fit, least)
    nearest = np.inf
    for fit in fits:
        cost, near = mean_cost_across(fit, least), move_deg(fit.pose, old)
        if (near < moved and cost < own - BETTER) or (near * NEARER < moved and cost < own + AS_WELL):
            nearest = min(nearest, near)
    return float(nearest) if nearest < moved else None
