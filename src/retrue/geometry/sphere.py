"""The sphere through points, wherever one is looked for: on a ball of known size, an artefact, or a part."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.arrays import FloatArray

ROUNDS = 30
SETTLED = 1e-12  # of the radius: a step that changes nothing
FLAT = 1e-12  # of the points' spread: less, and they tell no radius


@dataclass(frozen=True, slots=True, eq=False)
class FittedSphere:
    """|X - centre| = radius, as N points have it.

    Attributes
    ----------
    centre, radius : (3,) and positive, in the points' unit.
    residuals : (N,) |X - centre| - radius, positive outside.
    design : (N, 4) by how much residuals fall as centre and radius grow: outward unit vectors, and ones.
    """

    centre: FloatArray
    radius: float
    residuals: FloatArray
    design: FloatArray


def sphere_through(points: FloatArray, sigma: FloatArray | None = None, rounds: int = ROUNDS) -> FittedSphere:
    """Minimises sum of ((|X - c| - r) / sigma)^2 over c and r: the Gaussian compensating sphere where sigma is even.

    From |X|^2 = 2 c . X + r^2 - |c|^2, which is linear, Gauss-Newton goes on.

    Parameters
    ----------
    points : (N, 3), four or more.
    sigma : (N,) of each along its normal, up to a common factor; None: alike.
    rounds : of Gauss-Newton; 0 leaves the linear answer, whose sphere is a little too small where the points scatter.

    Raises
    ------
    DegenerateError : the points lie on one plane, or are fewer than four.

    Source: Forbes, "Least-squares best-fit geometric elements", NPL report DITC 140/89, 1989.

    >>> angles = np.linspace(0, 2, 9)
    >>> curve = np.column_stack([np.cos(angles), np.sin(angles), 0.2 * angles**2])
    >>> ball = sphere_through(3 * curve / np.linalg.norm(curve, axis=1)[:, None] + [0, 0, 50])
    >>> ball.centre.round(6).tolist(), round(ball.radius, 6)
    ([0.0, 0.0, 50.0], 3.0)
    """
    middle: FloatArray = points.mean(axis=0) if len(points) else np.zeros(3)
    scale = float(np.sqrt(((points - middle) ** 2).sum(axis=1).mean())) if len(points) else 0.0
    if len(points) < 4 or not scale > 0:
        raise _undetermined(points)
    local = (points - middle) / scale
    weight = np.ones(len(points)) if sigma is None else 1 / sigma
    terms = np.column_stack([2 * local, np.ones(len(local))])
    solved, rank = _solved(terms, (local**2).sum(axis=1), weight)
    centre, radius = solved[:3], float(np.sqrt(max(solved[3] + solved[:3] @ solved[:3], 0.0)))
    residuals, design = _beside(local, centre, radius)
    for _ in range(rounds if rank == 4 else 0):
        if not np.isfinite(residuals).all():
            break
        step, _ = _solved(design, residuals, weight)
        centre, radius = centre + step[:3], radius + float(step[3])
        residuals, design = _beside(local, centre, radius)
        if not np.abs(step).max() > SETTLED * radius:
            break
    if not (rank == 4 and np.isfinite(centre).all() and radius > 0 and np.isfinite(residuals).all()):
        raise _undetermined(points)
    return FittedSphere(centre * scale + middle, radius * scale, residuals * scale, design)


def _solved(terms: FloatArray, values: FloatArray, weight: FloatArray) -> tuple[FloatArray, int]:
    """Least squares, and the rank of the terms."""
    found: Any = np.linalg.lstsq(terms * weight[:, None], values * weight, FLAT)
    return np.asarray(found[0], dtype=np.float64), int(found[2])


def _beside(points: FloatArray, centre: FloatArray, radius: float) -> tuple[FloatArray, FloatArray]:
    """Residuals and design; NaN of a point at the centre itself."""
    away = points - centre
    length = np.linalg.norm(away, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        outwards = away / length[:, None]
    outwards[~(length > 0)] = np.nan
    return np.where(length > 0, length - radius, np.nan), np.column_stack([outwards, np.ones(len(points))])


def _undetermined(points: FloatArray) -> DegenerateError:
    found = f"{len(points)} points" + (" that lie on one plane" if len(points) >= 4 else "")
    return DegenerateError(f"sphere: expected four points or more that are not on one plane, found {found}")
