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
steep these are tells s, since half of them have g(f) + g(1 - f) above e(1/4) + e(3/4).
"""

from __future__ import annotations

from math import erf, exp, log, pi, sqrt

import numpy as np

from retrue.geometry.arrays import FloatArray

EdgeBias = tuple[float, float, float]
"""c of bit 0, of bit 1 and of the coarser ones, in f' - f = c f' (1 - f') (1 - 2 f'); camera pixels."""
NO_BIAS: EdgeBias = (0.0, 0.0, 0.0)
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
    """What straight lines miss edges by, of a bit that is the finest, the next, or coarser.

    Parameters
    ----------
    stripe_px : width of a stripe, in camera pixels.
    steepness : of the edges of coarse bits, the median of |pattern - inverse| / (white - black) in the pixel before
        the edge and in the one behind it, summed.

    Returns
    -------
    EdgeBias
        all 0 where none is `LEAST_BIAS`.

    Examples
    --------
    >>> [round(c, 2) for c in edge_bias(1.0, 0.95)]
    [0.48, 0.29, 0.29]
    >>> edge_bias(1.7, 0.6)
    (0.0, 0.0, 0.0)
    """
    if not (stripe_px > 0 and steepness > 0):
        return NO_BIAS
    blur = _blur(steepness)
    first, second, coarse = (_cubic(blur, apart * stripe_px) for apart in APART)
    return (first, second, coarse) if max(first, second, coarse) * CUBIC_PEAK >= LEAST_BIAS else NO_BIAS


def _blur(steepness: float) -> float:
    """s whose edges, each alone, are that steep: by halving its logarithm, for steepness falls with it."""
    sharp, soft = log(SHARPEST), log(SOFTEST)
    for _ in range(HALVINGS):
        middle = (sharp + soft) / 2
        steeper = _edge(0.25, exp(middle)) + _edge(0.75, exp(middle)) > steepness
        sharp, soft = (middle, soft) if steeper else (sharp, middle)
    return exp((sharp + soft) / 2)


def _cubic(blur: float, apart: float) -> float:
    """c of edges so far apart, by least squares over the places found; 0 of what blur hides."""
    if blur > apart:
        return 0.0
    before = np.array([_profile(place, blur, apart) for place in PLACES.tolist()])
    found: FloatArray = before / (before + before[::-1])
    cubic = found * (1 - found) * (1 - 2 * found)
    return float(cubic @ (found - PLACES) / (cubic @ cubic))


def _profile(distance: float, blur: float, apart: float) -> float:
    """g(d)."""
    return sum((-1) ** j * _edge(distance - j * apart, blur) for j in range(-ROUNDS, ROUNDS + 1))


def _edge(distance: float, blur: float) -> float:
    """e(d)."""
    return _integral(distance + 0.5, blur) - _integral(distance - 0.5, blur)


def _integral(x: float, blur: float) -> float:
    return x * erf(x / (sqrt(2) * blur)) + blur * sqrt(2 / pi) * exp(-(x**2) / (2 * blur**2))
