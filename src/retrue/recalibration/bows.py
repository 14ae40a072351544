"""How a plane may be bowed."""

from __future__ import annotations

import numpy as np

from retrue.geometry.arrays import FloatArray
from retrue.geometry.two_view import FREE, TwoViewPoints

BOWS = 3
MONOMIALS = 10  # of two variables, of degree three and less
CURVED = 30.0  # times as bowed as walls are: balls, pipes, faces; curled paper, clapboards
SCALES = np.geomspace(0.003, 3.7, 19)
"""Of the stated flatness, how far planes may be bowed: alike before the points speak; their mean square is 1."""


def bend_of(known: FloatArray, bend: FloatArray, degree: int = 2) -> FloatArray:
    """(14,) by how much a plane is bent at any ray x, from what it is at those known (M, 2): a polynomial of them.

    That is their centre (2,) and scale (2,), and what each of ten monomials of (x - centre) / scale counts.

    >>> known = np.array([[u, v] for u in (-1.0, 0.0, 1.0) for v in (-1.0, 0.0, 1.0)])
    >>> (bend_of(known, known[:, 0] ** 2 - known[:, 0] * known[:, 1]).round(3) + 0.0).tolist()
    [0.0, 0.0, 0.816, 0.816, 0.0, 0.0, 0.0, 0.667, -0.667, 0.0, 0.0, 0.0, 0.0, 0.0]
    """
    centre, scale = known.mean(axis=0), np.maximum(known.std(axis=0), 1e-300)
    around = ((known - centre) / scale).T
    there = _monomials(around[0], around[1], degree)
    found = np.zeros(4 + MONOMIALS)
    found[:2], found[2:4] = centre, scale
    found[4 : 4 + len(there)] = np.linalg.lstsq(there @ there.T, there @ bend, rcond=None)[0]
    return found


def _monomials(u: FloatArray, v: FloatArray, degree: int) -> FloatArray:
    """(M, N) of rays (N,), those of each degree after those below it: 1, u, v, u^2, u v, v^2, ..."""
    found = last = [np.ones(len(u))]
    for _ in range(degree):
        last = [*(u * one for one in last), v * last[-1]]
        found = found + last
    return np.stack(found)


def bow_shapes(points: TwoViewPoints, degree: int = 2) -> FloatArray:
    """(N, B) polynomials that bow each plane, together of RMS 1, without what a tilt takes up: three of degree two."""
    shapes = np.zeros((len(points), (degree + 1) * (degree + 2) // 2 - 3))
    for plane in range(int(points.plane_index.max(initial=FREE)) + 1):
        mine = np.flatnonzero(points.plane_index == plane)
        if len(mine) < 2 * shapes.shape[1]:
            continue
        x = np.ascontiguousarray(points.camera_rays[mine].T)
        x = (x - x.mean(axis=1)[:, None]) / np.maximum(x.std(axis=1), 1e-300)[:, None]
        terms = _monomials(x[0], x[1], degree)
        linear, bows = terms[:3], terms[3:]
        bows -= bows @ linear.T @ np.linalg.pinv(linear @ linear.T) @ linear
        shapes[mine] = (bows / np.maximum(bows.std(axis=1) * np.sqrt(len(bows)), 1e-300)[:, None]).T
    return shapes


def measured_scale(bows: FloatArray, information: FloatArray) -> float:
    """How far planes are bowed, of what was stated: root of the posterior mean of the squared scale s.

    Bows (B,) were found under a normal prior of variance 1, with that prior in their `information` (B, B), all else
    being free: so the points alone have them at L^-1 (L + 1) b with the information L, and each is N(0, 1 / L + s^2).
    Planes that are flat within what the points tell are then taken to be about that flat, and cost little.

    >>> flat, bowed = measured_scale(np.zeros(3), np.eye(3) * 401), measured_scale(np.full(3, 0.9), np.eye(3) * 401)
    >>> flat < 0.1, 0.9 < bowed < 1.6
    (True, True)
    """
    if not len(bows):
        return 1.0
    told, axes = np.linalg.eigh(information - np.eye(len(bows)))
    told = np.maximum(told, 1e-6)
    found = (axes.T @ bows) * (told + 1) / told
    spread = 1 + SCALES[:, None] ** 2 * told
    log_evidence = -0.5 * (np.log(spread) + found**2 * told / spread).sum(axis=1)
    weights = np.exp(log_evidence - log_evidence.max())
    return float(np.sqrt(weights @ SCALES**2 / weights.sum()))
