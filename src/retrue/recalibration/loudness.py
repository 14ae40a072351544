"""Captures are one as loud, one as quiet: each counts by its own noise, which planes tell before any pose is known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from retrue.geometry.arrays import FloatArray, IntArray
from retrue.geometry.robust import biweight_level
from retrue.geometry.two_view import FREE
from retrue.recalibration.fit import FEWEST_OF_A_FAMILY
from retrue.recalibration.measured import MISFIT_PX
from retrue.recalibration.parts import homography_residuals
from retrue.recalibration.rays import Rays
from retrue.recalibration.uneven_noise import WITHOUT_NEIGHBOURS


def loudness_of_captures(
    rays: Rays, neighbours: IntArray, homographies: Sequence[FloatArray], captures: int
) -> FloatArray:
    """(C,) noise of each capture over the usual one, in the points' own sigma; 1 where its planes do not tell.

    It is what their homographies leave of a point, less what they leave of the four nearest of its plane on average: no
    bow, no lens and no pose is in that. None is quieter than what real lenses leave over.
    """
    missed, plane = homography_residuals(rays.points, homographies), rays.points.plane_index
    beside = (plane != FREE) & (plane[neighbours] == plane[:, None]).all(axis=1)
    apart = missed - missed[neighbours].mean(axis=1)
    levels = np.full(captures, np.nan)
    for capture in range(captures):
        rows = np.flatnonzero(beside & (rays.capture == capture))
        if len(rows) >= FEWEST_OF_A_FAMILY:
            levels[capture] = np.hypot(biweight_level(apart[rows].ravel()) * np.sqrt(WITHOUT_NEIGHBOURS), MISFIT_PX)
    told = np.isfinite(levels)
    usual = np.exp(np.log(levels[told]).mean()) if told.any() else 1.0
    return np.where(told, levels / usual, 1.0)
