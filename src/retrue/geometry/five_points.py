"""Relative poses of five matches, and the best of many samples among points that may be wrong."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations_with_replacement

import numpy as np

from retrue.geometry.arrays import FloatArray, IntArray
from retrue.kernels import essentials as solver
from retrue.kernels import five_points as kernel

MOST_SOLUTIONS = 20  # ten, and what rounding may add
SAMPLES, MOST_SAMPLES = 60, 480
MISSED = np.log(0.01)  # that no sample is all right

# Monomials in (x, y, z, 1) by their factors: ten that are eliminated, then those by which three of the equations are
# linear in x and y.
_CUBIC = (
    *("000", "111", "001", "011", "002", "003", "112", "113", "012", "013"),
    *("022", "023", "033", "122", "123", "133", "222", "223", "233", "333"),
)
_SQUARE = tuple("".join(pair) for pair in combinations_with_replacement("0123", 2))


def _products(of: Sequence[str], to: Sequence[str]) -> IntArray:
    """(len(of), 4) number of the monomial that each one makes with each factor."""
    products = np.array([[to.index("".join(sorted(one + factor))) for factor in "0123"] for one in of])
    products.setflags(write=False)
    return products


MONOMIALS = _products("0123", _SQUARE), _products(_SQUARE, _CUBIC)
"""Which one two factors make (4, 4), and a square and a factor (10, 4)."""


def five_point_essentials(x: FloatArray, y: FloatArray, samples: IntArray) -> FloatArray:
    """All essential matrices (K, 3, 3) of norm 1 that samples of five matches allow: y^T E x = 0.

    Parameters
    ----------
    x, y : (N, 2) normalised rays of both devices.
    samples : (S, 5) rows. Of a degenerate sample there is none.

    Source: Nister 2004, "An efficient solution to the five-point relative pose problem".
    """
    found = np.empty((MOST_SOLUTIONS * len(samples), 3, 3))
    rays = np.ascontiguousarray(x), np.ascontiguousarray(y)
    return found[: solver.essentials(*rays, np.ascontiguousarray(samples), *MONOMIALS, found)]


def poses_of_essential(E: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """The four (R, unit t) of an essential matrix E = [t]x R (3, 3), any scale and sign.

    >>> from retrue.geometry.transform import skew
    >>> sorted(tuple((t.round(6) + 0).tolist()) for R, t in poses_of_essential(skew(np.array([1.0, 0, 0]))))[0]
    (-1.0, 0.0, 0.0)
    """
    U, _, Vt = np.linalg.svd(E)
    U, Vt = U * np.sign(np.linalg.det(U)), Vt * np.sign(np.linalg.det(Vt))
    W = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    return [(U @ w @ Vt, sign * U[:, 2]) for w in (W, W.T) for sign in (1.0, -1.0)]


def best_essentials(
    x: FloatArray,
    y: FloatArray,
    noises: Sequence[float],
    draw: Callable[[int], IntArray],
    scored: IntArray,
    most_samples: int = MOST_SAMPLES,
) -> list[FloatArray]:
    """The essential matrices (3, 3) of samples of five that the most points agree with at each noise: MSAC.

    Where a part of the points is wrong, and noisier than the right ones, they differ; else each is there once. Samples
    are drawn until one of them is all right with 99 %, by the share that agrees.

    Parameters
    ----------
    x, y : (N, 2) normalised rays of both devices.
    noises : standard deviations of a match to try, in their unit.
    draw : rows (S, 5) of so many samples.
    scored : rows that are asked.
    """
    few = np.ascontiguousarray(x[scored].T), np.ascontiguousarray(y[scored].T)
    drawn, enough = 0, SAMPLES
    limits = 9 * np.square(np.asarray(noises, dtype=np.float64))
    found: list[FloatArray | None] = [None] * len(limits)
    agreement, which = np.zeros(len(limits)), np.empty(len(limits), dtype=np.int64)
    while drawn < min(enough, most_samples):
        candidates = five_point_essentials(x, y, draw(SAMPLES))
        drawn += SAMPLES
        if len(candidates):
            kernel.most_agreed(candidates, *few, limits, which, agreement)
            for index in np.flatnonzero(which >= 0):
                found[index] = candidates[which[index]]
        agreeing = float(agreement.max()) / max(len(scored), 1)
        enough = MISSED / np.log1p(-min(agreeing**5, 0.99)) if agreeing > 0.1 else most_samples
    distinct: list[FloatArray] = []
    for E in found:
        if E is not None and not any(np.array_equal(E, other) for other in distinct):
            distinct.append(E)
    return distinct


def sampson_squares(E: FloatArray, x: FloatArray, y: FloatArray, out: FloatArray | None = None) -> FloatArray:
    """(N,) squared Sampson distance of N matches to an essential matrix (3, 3), into `out` if that is given."""
    squares = np.empty(len(x)) if out is None else out
    kernel.sampson_squares(E, np.ascontiguousarray(x), np.ascontiguousarray(y), squares)
    return squares
