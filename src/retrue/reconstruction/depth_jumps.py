"""When a step in inverse depth is too large to be the surface going on."""

from __future__ import annotations

import numpy as np

from retrue.geometry.arrays import FloatArray

NOISE_SIGMAS = 6.0
SPACING_FRACTION = 0.5  # a kink of this many point spacings in one step, about 27 degrees, is still a surface
MAD_TO_SIGMA = 1.4826  # of a normal distribution


def jump_limit(residuals: FloatArray, inverse_depth: FloatArray, spacing_angle: float) -> FloatArray:
    """The largest departure from the surface's slope, in inverse depth, that is not a jump; as `inverse_depth`.

    Six robust sigmas of all `residuals` (NaN: unknown), so that noise makes no holes; and at least half the
    distance between neighbours, `spacing_angle` times depth, so that the curvature of a noiseless surface
    makes none: dZ = angle Z / 2 is dw = angle w / 2.

    >>> jump_limit(np.zeros(9), np.array([0.5]), spacing_angle=0.01).tolist()
    [0.0025]
    """
    finite = residuals[np.isfinite(residuals)]
    noise = MAD_TO_SIGMA * float(np.median(np.abs(finite))) if len(finite) else 0.0
    return np.maximum(NOISE_SIGMAS * noise, SPACING_FRACTION * spacing_angle * inverse_depth)
