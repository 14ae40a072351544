"""Relative poses of five matches, many samples at a time, and the best of them among points that may be wrong."""

from __future__ import annotations

from itertools import combinations_with_replacement
from typing import cast

import numpy as np
from numpy.typing import NDArray

from retrue.geometry.arrays import FloatArray, IntArray
from retrue.kernels import five_points as kernel

ComplexArray = NDArray[np.complex128]

# Monomials in (x, y, z, 1) as sorted triples of their factors; first the ten of third degree.
_TRIPLES = [tuple(sorted(m)) for m in combinations_with_replacement(range(4), 3)]
_ORDER = sorted(_TRIPLES, key=lambda m: (m.count(3) > 0, m.count(3), m))
CUBIC = {m: k for k, m in enumerate(_ORDER)}


def _products() -> tuple[FloatArray, FloatArray]:
    """(4, 4, 10) and (10, 4, 20): which monomial two factors make, and a pair and a factor."""
    pairs = [tuple(p) for p in combinations_with_replacement(range(4), 2)]
    two, three = np.zeros((4, 4, 10)), np.zeros((10, 4, 20))
    for a in range(4):
        for b in range(4):
            two[a, b, pairs.index((min(a, b), max(a, b)))] = 1
    for k, pair in enumerate(pairs):
        for c in range(4):
            three[k, c, CUBIC[tuple(sorted((*pair, c)))]] = 1
    return two, three


_TWO, _THREE = _products()
_TWO.setflags(write=False)
_THREE.setflags(write=False)


def five_point_essentials(x: FloatArray, y: FloatArray) -> FloatArray:
    """All essential matrices (K, 3, 3) that S samples of five matches allow: y^T E x = 0.

    E = a X + b Y + c Z + W in the null space of the five equations; det E = 0 and 2 E E^T E = tr(E E^T) E are ten cubic
    equations in a, b, c, whose solutions are eigenvectors of the matrix that multiplies by a.

    Parameters
    ----------
    x, y : (S, 5, 2) normalised rays of both devices. Of a degenerate sample there is none.

    Source: Nister 2004; Stewenius, Engels, Nister 2006.
    """
    ones = np.ones((*x.shape[:2], 1))
    design = np.einsum("spi,spj->spij", np.concatenate([y, ones], 2), np.concatenate([x, ones], 2)).reshape(-1, 5, 9)
    basis = np.linalg.svd(design)[2][:, 5:].reshape(-1, 4, 3, 3)
    E = np.moveaxis(basis, 1, -1)  # (S, 3, 3, 4): linear in (a, b, c, 1)
    EEt = np.einsum("sika,sjkb,abm->sijm", E, E, _TWO, optimize=True)
    trace = np.einsum("siim->sm", EEt)
    weighted = 2 * EEt
    weighted[:, range(3), range(3)] -= trace[:, None]
    cubics = np.einsum("sijm,sjka,mac->sikc", weighted, E, _THREE, optimize=True).reshape(-1, 9, 20)
    minor = np.einsum("sja,skb,abm->sjkm", E[:, 1], E[:, 2], _TWO, optimize=True)
    cross = np.stack(
        [minor[:, 1, 2] - minor[:, 2, 1], minor[:, 2, 0] - minor[:, 0, 2], minor[:, 0, 1] - minor[:, 1, 0]], 1
    )
    determinant = np.einsum("sim,sia,mac->sc", cross, E[:, 0], _THREE, optimize=True)
    system = np.concatenate([cubics, determinant[:, None]], axis=1)
    scale = np.abs(system).max(axis=(1, 2), keepdims=True)
    system = system / np.maximum(scale, 1e-300)
    good = np.abs(np.linalg.det(system[:, :, :10])) > 1e-28
    system, E = system[good], E[good]
    if not len(system):
        return np.empty((0, 3, 3))
    # The cubic monomials by the lower ones.
    reduced = np.asarray(-np.linalg.solve(system[:, :, :10], system[:, :, 10:]), dtype=np.float64)
    lower = _ORDER[10:]
    action = np.zeros((len(system), 10, 10))
    for row, monomial in enumerate(lower):
        product = tuple(sorted((0, *(m for m in monomial if m != 3))))
        full = tuple(sorted((*product, *([3] * (3 - len(product))))))
        if CUBIC[full] < 10:
            action[:, row] = reduced[:, CUBIC[full]]
        else:
            action[:, row, lower.index(full)] = 1
    values, vectors = cast(tuple[ComplexArray, ComplexArray], np.linalg.eig(action))
    real = np.abs(values.imag) < 1e-9 * np.maximum(np.abs(values), 1e-3)
    last = vectors[:, 9]
    real &= np.abs(last) > 1e-12
    sample, which = np.nonzero(real)
    linear = [lower.index((k, 3, 3)) for k in range(3)]
    chosen = vectors[sample, :, which]
    abc = (chosen[:, linear] / chosen[:, 9:]).real
    found = np.einsum("sija,sa->sij", E[sample], np.column_stack([abc, np.ones(len(abc))]))
    return found / np.linalg.norm(found, axis=(1, 2), keepdims=True)


def poses_of_essential(E: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """The four (R, unit t) of an essential matrix E = [t]x R (3, 3), any scale and sign.

    >>> from retrue.geometry.transform import skew
    >>> sorted(tuple(t.round(6).tolist()) for R, t in poses_of_essential(skew(np.array([1.0, 0, 0]))))[0]
    (-1.0, 0.0, 0.0)
    """
    U, _, Vt = np.linalg.svd(E)
    U, Vt = U * np.sign(np.linalg.det(U)), Vt * np.sign(np.linalg.det(Vt))
    W = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    return [(U @ w @ Vt, sign * U[:, 2]) for w in (W, W.T) for sign in (1.0, -1.0)]


def best_essential(
    x: FloatArray, y: FloatArray, noise: float, samples: IntArray, scored: IntArray
) -> FloatArray | None:
    """The essential matrix (3, 3) of samples of five that the most points agree with: MSAC; None of hopeless samples.

    Parameters
    ----------
    x, y : (N, 2) normalised rays of both devices.
    noise : standard deviation of a match, in their unit.
    samples : (S, 5) rows to solve.
    scored : rows that are asked.
    """
    candidates = five_point_essentials(x[samples], y[samples])
    if not len(candidates):
        return None
    return candidates[kernel.most_agreed(np.ascontiguousarray(candidates), x[scored], y[scored], 9 * noise**2)]


def sampson_squares(E: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
    """(N,) squared Sampson distance of N matches to an essential matrix (3, 3)."""
    squares = np.empty(len(x))
    kernel.sampson_squares(E, np.ascontiguousarray(x), np.ascontiguousarray(y), squares)
    return squares
