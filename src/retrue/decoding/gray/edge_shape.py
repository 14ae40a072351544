"""How far a straight line through a blurred edge misses it, told from how the edges of a capture look.

Across an edge pattern - inverse goes, in shares of the contrast, as

    g(d) = sum over j of (-1)^j e(d - j w),   e(d) = I(d + 1/2) - I(d - 1/2),
    I(x) = x erf(x / (sqrt 2 s)) + s sqrt(2 / pi) exp(-x^2 / (2 s^2)),

d the distance to it, w that to the next edges of the same bit, s the blur of both lenses, all in camera pixels: a step,
blurred, and gathered over a pixel. Between two pixels, the edge a share f of the way, a straight line finds
f' = g(f) / (g(f) + g(1 - f)): off by a wave of one pixel, up to a tenth, the most where stripes are about as narrow as
pixels. Where both beat, all edges of a window err alike, over tens or hundreds of pixels, which neither its residuals
nor its neighbours show.

Bit 0 changes between every other two stripes, bit 1 between every fourth, and a coarse bit's edges are alone: how
steep these are tells s, since half of them have g(f) + g(1 - f) above e(1/4) + e(3/4). The lenses blur all of a picture
alike, but stripes are as wide as the surface lies: the wave is told for every width, and that counted about each edge.
"""

from __future__ import annotations

from math import erf, exp, log, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from retrue.geometry.arrays import FloatArray

EdgeBias = NDArray[np.float32]
"""(3, `SPACINGS`, 2) of bit 0, of bit 1 and of the coarser ones, c and c' of stripes 0, 1, ... `PER_STRIPE`-ths of
which a pixel is wide: f' - f = (c + c' (1 - 2 f')^2) f' (1 - f') (1 - 2 f'), in camera pixels."""
PER_STRIPE, SPACINGS = 16, 28
"""The last ones are .6 pixels wide: narrower ones, alternating from pixel to pixel, hardly show an edge."""
NO_BIAS: EdgeBias = np.zeros((3, SPACINGS, 2), np.float32)
CUBIC_PEAK = sqrt(3) / 18
"""The largest value of f (1 - f) (1 - 2 f)."""
LEAST_BIAS = 0.02
"""Camera pixels: what straight lines miss by less is left, since albedo and JPEG move single edges by more."""
SHARPEST, SOFTEST = 0.05, 4.0
"""Camera pixels: blur that is looked for."""
HALVINGS = 20
ROUNDS = 5
"""Edges to either side that are summed; of a bit that is resolved these are all that matter."""
APART = 2.0, 4.0, 16.0
"""Stripes between the edges of bit 0, of bit 1, and, at least, of coarser ones."""
PLACES = (np.arange(12) + 0.5) / 12


def edge_bias(stripe_px: float, steepness: float) -> EdgeBias:
    """What straight lines miss edges by, of a bit that is the finest, the next, or coarser, by the width of stripes.

    Parameters
    ----------
    stripe_px : usual width of a stripe, in camera pixels.
    steepness : of the edges of coarse bits, the median of |pattern - inverse| / (white - black) in the pixel before
        the edge and in the one behind it, summed.

    Returns
    -------
    EdgeBias
        all 0 where, of the usual width, none is `LEAST_BIAS`.

    Examples
    --------
    >>> edge_bias(1.0, 0.95)[:, PER_STRIPE, 0].astype(float).round(2).tolist()
    [0.54, 0.32, 0.32]
    >>> bool(edge_bias(1.7, 0.6).any())
    False
    """
    if not (stripe_px > 0 and steepness > 0):
        return NO_BIAS
    blur = _blur(steepness)
    if not any(_largest(blur, apart * stripe_px) >= LEAST_BIAS for apart in APART):
        return NO_BIAS
    found = np.zeros_like(NO_BIAS)
    found[2] = _wave(blur, APART[2] * stripe_px)
    for bit in (0, 1):
        found[bit, 0] = found[2, 0]
        for spacing in range(1, SPACINGS):
            found[bit, spacing] = _wave(blur, APART[bit] * PER_STRIPE / spacing)
    return found


def _blur(steepness: float) -> float:
    """s whose edges, each alone, are that steep: by halving its logarithm, for steepness falls with it."""
    sharp, soft = log(SHARPEST), log(SOFTEST)
    for _ in range(HALVINGS):
        middle = (sharp + soft) / 2
        steeper = _edge(0.25, exp(middle)) + _edge(0.75, exp(middle)) > steepness
        sharp, soft = (middle, soft) if steeper else (sharp, middle)
    return exp((sharp + soft) / 2)


def _largest(blur: float, apart: float) -> float:
    """About the most that straight lines miss edges by that are so far apart."""
    found, terms = _missed(blur, apart)
    first = terms[:, 0]
    return float(first @ (found - PLACES) / (first @ first)) * CUBIC_PEAK if blur <= apart else 0.0


def _wave(blur: float, apart: float) -> FloatArray:
    """c and c' of edges so far apart, by least squares over the places found; 0 of what blur hides."""
    if blur > apart:
        return np.zeros(2)
    found, terms = _missed(blur, apart)
    return np.asarray(np.linalg.lstsq(terms, found - PLACES, rcond=None)[0], np.float64)


def _missed(blur: float, apart: float) -> tuple[FloatArray, FloatArray]:
    """Where straight lines have the edges at `PLACES`, and the two terms there."""
    before = np.array([_profile(place, blur, apart) for place in PLACES.tolist()])
    found: FloatArray = before / (before + before[::-1])
    cubic = found * (1 - found) * (1 - 2 * found)
    return found, np.stack([cubic, cubic * (1 - 2 * found) ** 2], axis=1)


def _profile(distance: float, blur: float, apart: float) -> float:
    """g(d)."""
    return sum((-1) ** j * _edge(distance - j * apart, blur) for j in range(-ROUNDS, ROUNDS + 1))


def _edge(distance: float, blur: float) -> float:
    """e(d)."""
    return _integral(distance + 0.5, blur) - _integral(distance - 0.5, blur)


def _integral(x: float, blur: float) -> float:
    return x * erf(x / (sqrt(2) * blur)) + blur * sqrt(2 / pi) * exp(-(x**2) / (2 * blur**2))
