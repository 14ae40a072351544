"""One view, thinned to what an alignment needs: points, normals, and how far noise moves each along its normal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.arrays import FloatArray, IntArray

CELLS_PER_SIDE = 60  # a view's size in cells, unless told otherwise
NEIGHBOURS = 12  # of a local plane
FEWEST_POINTS = 50
PATCH = 16  # points of a quadric
FLATTEST = 0.5  # scatter across a local plane of that along it; beyond it there is no surface
SIDEWAYS = 0.2  # noise across a ray, of that along it
EDGE, CUT = 0.25, 0.3  # cells to the outermost point; share of a side that points so near to it fill, if it is cut
STRAYS = 0.002  # of the points, outside of all others
TINY = np.finfo(np.float64).tiny  # of points that all lie in one place


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """N thinned points in the view's own camera frame.

    Attributes
    ----------
    points, normals : (N, 3), normals towards the camera.
    sigma : (N,) standard deviation along the normal, as far as the view itself tells.
    rays : (N, 2) where the camera sees them, X / Z and Y / Z.
    field : (2, 2) lowest and highest X / Z and Y / Z that the picture holds; infinite where the surface ends within it.
    noise : one standard deviation of such a point along its normal, in the view's unit.
    tree, ray_tree, prepared : to ask for neighbours, and what small_gicp keeps of the points.
    """

    points: FloatArray
    normals: FloatArray
    sigma: FloatArray
    rays: FloatArray
    field: FloatArray
    noise: float
    tree: Any
    ray_tree: Any
    prepared: Any


def neighbour_tree(points: FloatArray) -> Any:
    """A k-d tree over points (N, k)."""
    from scipy.spatial import KDTree

    return cast("Any", KDTree)(points)


def usual_cell(clouds: list[FloatArray]) -> float:
    """A sixtieth of a view's size, but no less than the points' own distance."""
    sizes = [float(np.linalg.norm(np.ptp(np.quantile(points, (0.02, 0.98), axis=0), axis=0))) for points in clouds]
    spacings = [usual_spacing(points) for points in clouds]
    return max(float(np.median(sizes)) / CELLS_PER_SIDE, 1.2 * float(np.median(spacings)))


def require_points(points: FloatArray) -> None:
    """A `DegenerateError` where these are too few to be a view."""
    if len(points) < FEWEST_POINTS:
        raise DegenerateError(f"expected {FEWEST_POINTS} points on a surface, found {len(points)}")


def make_view(points: FloatArray, sigma: FloatArray | None, cell: float) -> View:
    """Thin points (N, 3) of the camera frame to one a cell, where a quadric through its neighbours is.

    A mean of the points would lie inside of every bump, the more the denser they are, and views would not fit.
    `sigma` (N,) is that along the ray; without it, noise grows as the square of depth. Raises `DegenerateError`
    where too few points, or none with neighbours on a surface, remain.
    """
    require_points(points)
    along = sigma if sigma is not None and (sigma > 0).all() else points[:, 2] ** 2
    means = _thinned(points, cell)
    require_points(means)
    thin, normals, variance, near, flat = _patches(points, means)
    thin, normals, near = thin[flat], normals[flat], near[flat]
    require_points(thin)
    cosine = np.abs((thin * normals).sum(axis=1)) / np.linalg.norm(thin, axis=1)
    shape = np.sqrt((along[near] ** 2).mean(axis=1)) * np.hypot(cosine, SIDEWAYS)
    noise = float(np.sqrt(np.median(variance[flat])))
    smoothed = noise / np.sqrt(PATCH / 3)  # the height of a quadric at its middle, of so many points
    rays = thin[:, :2] / thin[:, 2:]
    return View(
        thin,
        normals,
        smoothed * shape / np.median(shape),
        rays,
        _field(points[:, :2] / points[:, 2:], cell / float(np.median(thin[:, 2]))),
        smoothed,
        neighbour_tree(thin),
        neighbour_tree(rays),
        prepared(thin),
    )


def _field(rays: FloatArray, width: float) -> FloatArray:
    """A picture's edge cuts a surface off along a line; the surface's own end touches such a line at a place only."""
    field = np.array([[-np.inf, -np.inf], [np.inf, np.inf]])
    bins = np.floor(rays / width).astype(np.int64)
    for axis in (0, 1):
        for end, outermost in enumerate(np.quantile(rays[:, axis], (STRAYS, 1 - STRAYS))):
            outwards = (rays[:, axis] - outermost) * (1 if end else -1)
            along = bins[:, 1 - axis]
            if len(np.unique(along[outwards > -EDGE * width])) > CUT * len(np.unique(along)):
                field[end, axis] = outermost
    return field


def _patches(points: FloatArray, places: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, IntArray, Any]:
    """Quadrics through the nearest points of each place: where they are, their normals, the variance that they leave.

    And the points they go through (N, k), and whether they lie along a surface at all (N,).
    """
    _, near = neighbour_tree(points).query(places, min(PATCH, len(points)))
    middle = points[near].mean(axis=1)
    away = points[near] - middle[:, None]
    values, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", away, away))
    normals = axes[:, :, 0]
    normals = np.where(((normals * middle).sum(axis=1) > 0)[:, None], -normals, normals)
    sideways, upwards = axes[:, :, 2], np.cross(normals, axes[:, :, 2])
    u, v, w = (np.einsum("nki,ni->nk", away, axis) for axis in (sideways, upwards, normals))
    scale = np.sqrt((u**2 + v**2).mean(axis=1, keepdims=True)) + TINY
    u, v = u / scale, v / scale
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=-1)
    fitted = np.einsum("ntk,nk->nt", np.linalg.pinv(terms), w)
    left = w - np.einsum("nkt,nt->nk", terms, fitted)
    variance = (left**2).sum(axis=1) / (near.shape[1] - terms.shape[-1])
    slope = fitted[:, 1:3] / scale
    normal = normals - slope[:, :1] * sideways - slope[:, 1:] * upwards
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return middle + fitted[:, :1] * normals, normal, variance, near, values[:, 0] < FLATTEST**2 * values[:, 1]


def local_normals(points: FloatArray, count: int) -> tuple[FloatArray, Any]:
    """Unit normals (N, 3) towards the camera of planes through so many neighbours; and where those are flat (N,)."""
    _, near = neighbour_tree(points).query(points, min(count, len(points)))
    away = points[near] - points[near].mean(axis=1, keepdims=True)
    values, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", away, away))
    normals = axes[:, :, 0]
    normals = np.where(((normals * points).sum(axis=1) > 0)[:, None], -normals, normals)
    return normals, values[:, 0] < FLATTEST**2 * values[:, 1]


def prepared(points: FloatArray, neighbours: int = NEIGHBOURS) -> Any:
    """The points, with covariances, and their tree, as small_gicp wants them."""
    import small_gicp

    library: Any = small_gicp
    cloud = library.PointCloud(points)
    tree = library.KdTree(cloud)
    library.estimate_covariances(cloud, tree, num_neighbors=neighbours)
    return cloud, tree


def usual_spacing(points: FloatArray) -> float:
    """Median distance to the nearest point; zero of fewer than two."""
    if len(points) < 2:
        return 0.0
    some = points[:: max(1, len(points) // 2000)]
    distance, _ = neighbour_tree(points).query(some, 2)
    return float(np.median(distance[:, 1]))


def _thinned(points: FloatArray, cell: float) -> FloatArray:
    """The mean point of each occupied cell."""
    number: IntArray = np.unique(np.floor(points / cell).astype(np.int64), axis=0, return_inverse=True)[1].ravel()
    counts = np.bincount(number)
    return np.stack([np.bincount(number, points[:, axis]) / counts for axis in range(3)], axis=1)
