"""Many views' points as one surface: an implicit function that all of them have a say in, weighted by how sure they
are.

f(x) = sum w_k n_k' . (x - p_k) / sum w_k, w_k = exp(-|x - p_k|^2 / h^2) / sigma_k^2, n_k' the mean of the point's
normal and that of the place, so that curvature cancels. Its zero is the surface: smooth across the seams of views.
Source: R. Kolluri, "Provably good moving least squares", SODA 2005; for n_k' S. Rusinkiewicz, see `pairs`.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np

from retrue.errors import DegenerateError, InputError
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.kernels import moving_surface as kernel
from retrue.merging.view import neighbour_tree

NEIGHBOURS = 24  # that have a say at a place
AT_A_TIME = 200_000
REACH = 2.0  # h, beyond which there is no surface
MOST_NODES = 40_000_000  # of the grid


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Oriented points (N, 3) of all views in one frame, with their normals, sigma (N,), and the length h.

    `rows` (N,) tells which ones of those that were handed in.
    """

    points: FloatArray
    normals: FloatArray
    sigma: FloatArray
    reach: float
    tree: Any
    rows: IntArray

    def at(self, places: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """f (M,), the normal (M, 3) and the sigma (M,) of f at places; NaN where no point is within reach."""
        parts = [self._at(part, self._near(part)) for part in _parts(places)]
        value, normal, sigma = (np.concatenate(column) for column in zip(*parts, strict=True))
        return value, normal, sigma

    def onto(self, places: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Places (M, 3) moved to the surface along its normal; the normals there, and the sigma of where it is."""
        parts = [self._onto(part, self._near(part)) for part in _parts(places)]
        on, normal, sigma = (np.concatenate(column) for column in zip(*parts, strict=True))
        return on, normal, sigma

    def _onto(self, places: FloatArray, near: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        value, normal, _ = self._at(places, near)
        on = places - value[:, None] * normal
        value, normal, sigma = self._at(on, near)  # it moved by less than points are apart
        return on - value[:, None] * normal, normal, sigma

    def _near(self, places: FloatArray) -> IntArray:
        count = min(NEIGHBOURS, len(self.points))
        _, row = self.tree.query(places, count, distance_upper_bound=REACH * self.reach)
        return np.asarray(row, dtype=np.int64).reshape(len(places), count)

    def _at(self, places: FloatArray, near: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        value, sigma = np.full((2, len(places)), np.nan)
        normal = np.full((len(places), 3), np.nan)
        farthest = REACH * self.reach
        kernel.heights(places, self.points, self.normals, self.sigma, near, self.reach, farthest, value, normal, sigma)
        return value, normal, sigma


def _parts(places: FloatArray) -> list[FloatArray]:
    return [np.ascontiguousarray(places[start : start + AT_A_TIME]) for start in range(0, len(places), AT_A_TIME)]


def make_surface(points: FloatArray, normals: FloatArray, sigma: FloatArray, reach: float) -> Surface:
    """Points without a normal are left out."""
    known = np.isfinite(normals).all(axis=1) & np.isfinite(points).all(axis=1) & (sigma > 0)
    points = np.ascontiguousarray(points[known])
    return Surface(
        points,
        np.ascontiguousarray(normals[known]),
        np.ascontiguousarray(sigma[known]),
        reach,
        neighbour_tree(points),
        np.flatnonzero(known),
    )


def require_meshing() -> None:
    """An `InputError` where what meshes is not installed."""
    if find_spec("skimage") is None:
        raise InputError('merge --mesh: expected the library scikit-image, found none; pip install ".[merge]"')


def surface_mesh(surface: Surface, cell: float) -> tuple[FloatArray, IntArray]:
    """Vertices (N, 3) and faces (M, 3), counter-clockwise from outside, by marching cubes; holes stay open.

    Raises `DegenerateError` where `cell` (`cell_in_reach` allows it) makes the grid too large, or there is no surface.
    """
    require_meshing()
    from skimage import measure

    low = surface.points.min(axis=0) - 2 * cell
    shape = np.ceil((np.ptp(surface.points, axis=0) + 4 * cell) / cell).astype(np.int64) + 1
    if not shape.prod() <= MOST_NODES:
        raise DegenerateError(
            f"mesh: expected at most {MOST_NODES} cells, found {' x '.join(map(str, shape))}: take larger ones"
        )
    near = _near_nodes(surface, low, shape, cell)
    nodes = np.argwhere(near)
    value, _, _ = surface.at(low + nodes * cell)
    field = np.full(shape, np.nan)
    field[near] = value
    known = np.isfinite(field)
    library: Any = measure
    try:
        vertices, faces, _, _ = library.marching_cubes(np.where(known, field, cell), 0.0, mask=known)
    except (ValueError, RuntimeError) as error:
        raise DegenerateError("mesh: the points have no surface in common") from error
    vertices = low + vertices.astype(np.float64) * cell
    kept = _of_cubes_that_are_known(known, vertices, faces, low, cell)
    used, numbered = np.unique(faces[kept], return_inverse=True)
    return vertices[used], numbered.reshape(-1, 3).astype(np.int64)


def cell_in_reach(surface: Surface, cell: float) -> float:
    """That size of the cubes, or the smallest that the grid has room for."""
    sides = np.ptp(surface.points, axis=0)
    while not np.prod(np.ceil(sides / cell) + 6) <= MOST_NODES:
        cell *= 1.05
    return cell


def _near_nodes(surface: Surface, low: FloatArray, shape: IntArray, cell: float) -> BoolArray:
    """Nodes within a cell and a half of a point."""
    from scipy import ndimage

    near = np.zeros(shape, bool)
    near[tuple(np.round((surface.points - low) / cell).astype(np.int64).T)] = True
    library: Any = ndimage
    return np.asarray(library.binary_dilation(near, np.ones((3, 3, 3))), dtype=np.bool_)


def _of_cubes_that_are_known(
    known: BoolArray, vertices: FloatArray, faces: IntArray, low: FloatArray, cell: float
) -> BoolArray:
    """Faces all of whose cube's nodes have a value: at the rim of what was seen the field is not a surface."""
    middle = np.floor((vertices[faces].mean(axis=1) - low) / cell).astype(np.int64)
    whole = known[:-1, :-1, :-1].copy()
    for x, y, z in np.ndindex(2, 2, 2):
        whole &= known[x : x + whole.shape[0], y : y + whole.shape[1], z : z + whole.shape[2]]
    middle = np.clip(middle, 0, np.array(whole.shape) - 1)
    return whole[tuple(middle.T)]
