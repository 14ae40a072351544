"""Where the artefact is in a cloud: balls of a known size, and the largest flat thing.

Every point of a ball of radius r, seen from outside, has the centre at X - r n, n its normal: all of them vote for one
place, while the votes of anything else scatter. The normals are of planes through the neighbours within a third of r.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.robust import biweight
from retrue.geometry.sphere import sphere_through

PER_RADIUS = 8  # cells of the thinned cloud
REACH = 0.35  # of the radius: neighbours that tell a normal
SPREAD = 0.15  # of the radius: votes for one centre
NEAR = 0.2  # of the radius: what lies so far from the sphere belongs to it still
MARGIN_DEG = 10.0  # about a cap, in which points are asked where their feet lie
FEWEST_NEIGHBOURS = 6
MOST_BALLS = 4  # asked, from the one with the most votes
FAINTEST = 0.2  # of the most votes
MOST_BEND = 0.2  # of a fitted radius against the true one
FLAT = 0.01  # of the cloud's size: a plane's points lie within
PLANES_ASKED = 300
STEEPEST = np.cos(np.radians(20.0))  # between normals on a plane
LINK = 2.5  # cells between parts of one plane
SIDE_CELLS = 120  # of the cloud's size
DENSE = 0.05  # quantile of distances between neighbours


def find_balls(
    points: FloatArray, radius: float, cap_deg: float, noise: Callable[[IntArray], FloatArray]
) -> list[tuple[FloatArray, IntArray]]:
    """Centre (3,) and points (indices) of each ball of that radius, the one with the most votes first.

    Points count near the sphere, whose feet on it (`feet_on_sphere`) lie within the cap of so many degrees about the
    line to the camera; `noise` tells the covariances (M, 3, 3) of M points (indices).
    """
    thin = _thinned(points, radius / PER_RADIUS)
    normals = _normals(thin, REACH * radius)
    known = np.isfinite(normals).all(axis=1)
    votes = thin[known] - radius * normals[known]
    if not len(votes):
        return []
    tree = _tree(votes)
    count = np.asarray(tree.query_ball_point(votes, SPREAD * radius, return_length=True))
    found: list[tuple[FloatArray, IntArray]] = []
    most = int(count.max())
    while len(found) < MOST_BALLS and count.max(initial=0) >= max(FAINTEST * most, FEWEST_NEIGHBOURS):
        best = votes[int(count.argmax())]
        centre = votes[tree.query_ball_point(best, SPREAD * radius)].mean(axis=0)
        count[tree.query_ball_point(best, radius)] = 0
        centre = _settled(points, centre, radius, cap_deg)
        rows = np.flatnonzero(_near_cap(points, centre, radius, cap_deg + MARGIN_DEG))
        feet = feet_on_sphere(points[rows], noise(rows), centre, radius)
        rows = rows[within_cap(feet, centre, cap_deg)]
        if len(rows) >= FEWEST_NEIGHBOURS and _is_ball(points[rows], centre, radius):
            found.append((centre, rows))
    return found


def find_plane(points: FloatArray) -> IntArray:
    """Points (indices) of the largest flat and connected thing, without its rim; possibly none."""
    extent = float(np.linalg.norm(np.ptp(points, axis=0)))
    cell = extent / SIDE_CELLS
    thin = _thinned(points, cell)
    normals = _normals(thin, 3 * cell)
    known = np.flatnonzero(np.isfinite(normals).all(axis=1))
    if not len(known):
        return np.empty(0, np.int64)
    asked = np.random.default_rng(0).choice(known, min(PLANES_ASKED, len(known)), replace=False)
    best, most = asked[0], -1
    for row in asked:
        flat = np.abs((thin - thin[row]) @ normals[row]) < FLAT * extent
        alike = int((flat & (np.abs(normals @ normals[row]) > STEEPEST)).sum())
        best, most = (row, alike) if alike > most else (best, most)
    normal, distance = normals[best], normals[best] @ thin[best]
    axes = np.eye(3)
    for _ in range(10):
        off = thin @ normal - distance
        weights = biweight(off / (FLAT * extent / 3)) * (np.abs(np.nan_to_num(normals) @ normal) > STEEPEST)
        if not weights.sum() > 0:
            return np.empty(0, np.int64)
        centre = np.average(thin, axis=0, weights=weights)
        _, _, axes = np.linalg.svd((thin - centre) * np.sqrt(weights)[:, None], full_matrices=False)
        normal, distance = axes[2], axes[2] @ centre
    flat = np.abs(thin @ normal - distance) < FLAT * extent
    part = _largest_part(thin, flat & (np.abs(np.nan_to_num(normals) @ normal) > STEEPEST), LINK * cell)
    # A rim point has neighbours that are not of the plane, or none on one side.
    inside = _within(thin[part], cell, axes[:2])
    near, _ = _tree(thin[part][inside]).query(points, distance_upper_bound=cell) if inside.any() else (np.inf, None)
    return np.flatnonzero(np.isfinite(near) & (np.abs(points @ normal - distance) < FLAT * extent))


def dense_distance(points: FloatArray) -> float:
    """From a point to the nearest one, where they are nearly densest; never none."""
    if len(points) < 2:
        return np.inf
    distance, _ = _tree(points).query(points, 2)
    return max(float(np.quantile(distance[:, 1], DENSE)), 1e-9)


def _tree(points: FloatArray) -> Any:
    from scipy.spatial import KDTree

    return cast("Any", KDTree)(points)


def _thinned(points: FloatArray, cell: float) -> FloatArray:
    """The mean point of each occupied cell."""
    _, number = np.unique(np.floor(points / cell).astype(np.int64), axis=0, return_inverse=True)
    number = number.ravel()
    counts = np.bincount(number)
    return np.stack([np.bincount(number, points[:, axis]) / counts for axis in range(3)], axis=1)


def _normals(points: FloatArray, reach: float) -> FloatArray:
    """Unit normals towards the camera; NaN where fewer than six neighbours tell."""
    if not len(points):
        return np.empty((0, 3))
    one, other = _tree(points).query_pairs(reach, output_type="ndarray").T
    each = np.arange(len(points))
    owner, neighbour = np.concatenate([one, other, each]), np.concatenate([other, one, each])
    counts = np.bincount(owner)
    mean = np.stack([np.bincount(owner, points[neighbour, axis]) / counts for axis in range(3)], axis=1)
    away = points[neighbour] - mean[owner]
    moments = np.empty((len(points), 3, 3))
    for i in range(3):
        for j in range(i, 3):
            moments[:, i, j] = moments[:, j, i] = np.bincount(owner, away[:, i] * away[:, j]) / counts
    _, axes = np.linalg.eigh(moments)
    normals = axes[:, :, 0]
    normals = np.where(((normals * points).sum(axis=1) > 0)[:, None], -normals, normals)
    normals[counts < FEWEST_NEIGHBOURS] = np.nan
    return normals


def feet_on_sphere(points: FloatArray, noise: FloatArray, centre: FloatArray, radius: float) -> FloatArray:
    """(N, 3) where on the sphere each point most likely comes from, to first order,

        X - C n (|X - centre| - radius) / (n^T C n),    n outwards.

    It errs independently of the distance to the sphere, so that a cap that is cut by it is fair. By rays it would not
    be: of points about its rim, those that noise moves inwards across their rays would count, and the ball would
    shrink; nor by the points themselves, whose noise along the rays would make it grow.
    """
    away = points - centre
    length = np.linalg.norm(away, axis=1, keepdims=True)
    normals = away / length
    by_normal = (noise @ normals[:, :, None])[:, :, 0]
    along = (by_normal * normals).sum(axis=1, keepdims=True)
    return points - by_normal * (length - radius) / along


def within_cap(points: FloatArray, centre: FloatArray, cap_deg: float) -> BoolArray:
    """Points less than so many degrees from the line to the camera, seen from the centre."""
    away, towards = points - centre, -centre / np.linalg.norm(centre)
    return away @ towards > np.cos(np.radians(cap_deg)) * np.linalg.norm(away, axis=1)


def _near_cap(points: FloatArray, centre: FloatArray, radius: float, cap_deg: float) -> BoolArray:
    """Points near the sphere, whose rays meet it within so many degrees of the line to the camera."""
    away = points - centre
    near = np.abs(np.linalg.norm(away, axis=1) - radius) < NEAR * radius
    far = float(np.linalg.norm(centre))
    sine = np.linalg.norm(np.cross(points, centre / far), axis=1) / np.linalg.norm(points, axis=1)
    normal = np.arcsin(np.minimum(far * sine / radius, 1.0)) - np.arcsin(np.minimum(sine, 1.0))
    return near & ((away @ centre) < 0) & (far * sine < radius) & (normal < np.radians(cap_deg))


def _settled(points: FloatArray, centre: FloatArray, radius: float, cap_deg: float) -> FloatArray:
    """The centre of the sphere of that radius that most points near it lie on."""
    for _ in range(10):
        rows = _near_cap(points, centre, radius, cap_deg)
        if rows.sum() < FEWEST_NEIGHBOURS:
            break
        away: FloatArray = points[rows] - centre
        length = np.linalg.norm(away, axis=1)
        off = length - radius
        weights = biweight(off / (NEAR * radius / 2))
        design = away / length[:, None]
        information: FloatArray = (design * weights[:, None]).T @ design + 1e-9 * np.eye(3)
        step = np.asarray(np.linalg.solve(information, design.T @ (weights * off)), dtype=np.float64)
        centre = centre + step
        if not np.linalg.norm(step) > 1e-4 * radius:
            break
    return centre


def _is_ball(points: FloatArray, centre: FloatArray, radius: float) -> bool:
    """Whether a sphere of free radius through them has about that radius, and they lie about it."""
    try:
        free = sphere_through(points)
    except DegenerateError:
        return False
    return bool(
        abs(free.radius - radius) < MOST_BEND * radius and np.linalg.norm(free.centre - centre) < MOST_BEND * radius
    )


def _largest_part(points: FloatArray, chosen: BoolArray, reach: float) -> IntArray:
    """Indices of the largest set of chosen points that are linked within reach."""
    from scipy.sparse import coo_array, csgraph

    rows = np.flatnonzero(chosen)
    near = _tree(points[rows])
    pairs: Any = near.query_pairs(reach, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(rows), len(rows)))
    part: IntArray = cast("Any", csgraph).connected_components(links, directed=False)[1]
    return rows[part == np.bincount(part).argmax()] if len(rows) else rows


def _within(points: FloatArray, cell: float, axes: FloatArray) -> BoolArray:
    """Points with others on all four sides within two cells and a half."""
    flat = points @ axes.T
    tree = _tree(flat)
    sides = np.array([[1, 0], [-1, 0], [0, 1], [0, -1]]) * 2 * cell
    return np.all([np.isfinite(tree.query(flat + side, distance_upper_bound=cell)[0]) for side in sides], axis=0)
