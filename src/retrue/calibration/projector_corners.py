"""Projector pixels on the board, from the dense code (Moreno and Taubin 2012).

Around each corner, in a cell one square wide, the decoded points fix a local map camera -> projector; at the corner
it gives the corner's projector pixel, bridging the dark squares, which return no code. The cells do not overlap, so
that their errors are independent, and continue one square beyond the outer corners.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.calibration.board import Board
from retrue.calibration.detection import BoardCorners, opencv
from retrue.correspondences import Correspondences
from retrue.errors import InputError
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.homography import apply_homography, fit_homography
from retrue.geometry.robust import MEDIAN_DISTANCE

FEWEST_IN_CELL = 8
LARGEST_CELL = 4  # squares on a side
WORST_CORNER_PX = 0.5  # sigma beyond which a corner tells nothing that its neighbours do not tell better
MOST_DECODED = 25_000  # of a view: neighbours share stripe edges, so that more tell nothing new
MODEL_PX = 0.01  # what an affine map of a cell, and the decoder's own bias, may leave beyond the scatter
CLOSE_PX = 4.0  # of the homography of a board's points: its lenses bend less, and strays lie farther
TRIALS, MINIMAL = 100, 6  # draws of points, each of so many, for the map of one coordinate
KEPT_SCENE_POINTS = 120  # of a view, around the board
KEPT_DENSE_POINTS = 4000  # of a view, to judge by


@dataclass(frozen=True, slots=True, eq=False)
class ProjectorFit:
    """The board as the projector sees it.

    Attributes
    ----------
    corner_px, corner_sigma : (N, 2), (N,) of the board's corners, NaN where no cell supports one.
    patch_camera_px, patch_projector_px, patch_sigma : (M, 2), (M, 2), (M,) the middle of every cell.
    scene_camera_px, scene_projector_px : (L, 2) decoded points around the board, thinned.
    dense_camera_px, dense_projector_px : (K, 2) decoded points of the board, thinned.
    """

    corner_px: FloatArray
    corner_sigma: FloatArray
    patch_camera_px: FloatArray
    patch_projector_px: FloatArray
    patch_sigma: FloatArray
    scene_camera_px: FloatArray
    scene_projector_px: FloatArray
    dense_camera_px: FloatArray
    dense_projector_px: FloatArray


def fit_projector_corners(corners: BoardCorners, points: Correspondences, board: Board) -> ProjectorFit:
    """The projector's view of a board that the camera sees at `corners`. Raises `InputError` where it has none."""
    board_from_camera = fit_homography(corners.pixels, corners.board_xy, source_sigma=0.0)  # cells are cut on the board
    thin = _every_nth(points.camera_px)
    camera_px, projector_px = points.camera_px[thin], points.projector_px[thin]
    near = _on_board(camera_px, corners, board_from_camera, 1.5, board.spacing)  # with its margin
    beyond = np.ones(len(camera_px), dtype=bool)
    beyond[near] = False
    around = np.flatnonzero(beyond)
    around = around[:: max(1, len(around) // KEPT_SCENE_POINTS)]
    scene_camera_px, scene_projector_px = camera_px[around], projector_px[around]
    unknown = [axis for axis in (0, 1) if axis not in points.axes]
    if unknown:
        scene_camera_px, scene_projector_px = np.empty((0, 2)), np.empty((0, 2))  # on a line of no known place
    rows = near[_on_board(camera_px[near], corners, board_from_camera, 1, board.spacing)]
    if len(rows) < 4 * FEWEST_IN_CELL:
        raise InputError(f"expected decoded points on the board, found {len(rows)}; does the projector light it?")
    camera_px, projector_px = camera_px[rows], projector_px[rows]
    for axis in unknown:
        projector_px = _stood_in_for(camera_px, projector_px, axis)
    smooth, inlier_share = _SmoothMap.fitted(camera_px, projector_px)
    if smooth is None or not inlier_share > 0.5:
        raise InputError(
            f"expected the board's projector codes on one plane, found {100 * inlier_share:.0f} % of them on it; "
            "did the board move during the capture, or is it another pattern?"
        )
    rest = projector_px - smooth(camera_px)
    board_xy = apply_homography(board_from_camera, camera_px)
    side = _cell_side(board_xy, board.spacing)
    cells, names = _cells(board_xy, side)
    fit = _LocalFits(camera_px, rest, cells, len(names))

    corner_cells = {name: index for index, name in enumerate(names)}
    of_corner = np.array([corner_cells.get(_name(xy, side), -1) for xy in corners.board_xy])
    local, corner_sigma = fit.at(corners.pixels, of_corner)
    corner_px = smooth(corners.pixels) + local
    corner_px[~(corner_sigma < WORST_CORNER_PX)] = np.nan

    patches = np.flatnonzero(fit.good)
    local, patch_sigma = fit.at(fit.centre[patches], patches)
    patch_px = smooth(fit.centre[patches]) + local
    for column in (corner_px, patch_px, projector_px):
        column[:, unknown] = np.nan
    kept = np.flatnonzero(fit.kept)[:: -(-len(rows) // KEPT_DENSE_POINTS)]
    return ProjectorFit(
        corner_px,
        corner_sigma,
        fit.centre[patches],
        patch_px,
        patch_sigma,
        scene_camera_px,
        scene_projector_px,
        camera_px[kept],
        projector_px[kept],
    )


def _stood_in_for(camera_px: FloatArray, projector_px: FloatArray, axis: int) -> FloatArray:
    """Projector pixels with a stand-in for the coordinate that the code has not, so that one map does for both.

    On a plane the known one is x = (a u + b v + c) / (g u + h v + 1) of camera pixels; the stand-in is
    (a v - b u) / (g u + h v + 1), which makes of both a homography.
    """
    u, v = (camera_px - camera_px.mean(axis=0)).T / max(float(camera_px.std()), 1e-9)
    middle, spread = float(np.median(projector_px[:, 1 - axis])), max(float(projector_px[:, 1 - axis].std()), 1e-9)
    x = (projector_px[:, 1 - axis] - middle) / spread
    terms = np.stack([u, v, np.ones_like(u), -x * u, -x * v], axis=-1)

    def missed(found: FloatArray) -> FloatArray:
        with np.errstate(all="ignore"):
            error = np.abs((terms[:, :3] @ found[:3]) / (1 + np.stack([u, v], axis=-1) @ found[3:]) - x)
        return np.nan_to_num(error, nan=np.inf) * spread

    def fitted(rows: IntArray) -> FloatArray:
        return np.asarray(np.linalg.lstsq(terms[rows], x[rows], rcond=None)[0], dtype=np.float64)

    rng = np.random.default_rng(0)
    fits = [fitted(rng.choice(len(x), MINIMAL, replace=False)) for _ in range(TRIALS)]
    found = max(fits, key=lambda fit: int((missed(fit) < CLOSE_PX).sum()))
    for _ in range(3):
        rows = np.flatnonzero(missed(found) < CLOSE_PX)
        found = fitted(rows) if len(rows) >= MINIMAL else found
    a, b, _, g, h = found
    filled = projector_px.copy()
    filled[:, axis] = spread * (a * v - b * u) / (1 + g * u + h * v) / max(float(np.hypot(a, b)), 1e-9)
    return filled


class _LocalFits:
    """In every cell, an affine map of what the smooth map leaves: least squares on all points but the outliers."""

    def __init__(self, camera_px: FloatArray, rest: FloatArray, cells: IntArray, count: int) -> None:
        self.kept = np.ones(len(cells), dtype=bool)
        sizes = np.maximum(np.bincount(cells, minlength=count), 1)
        self.centre = np.stack([np.bincount(cells, camera_px[:, axis], count) / sizes for axis in (0, 1)], axis=-1)
        for limit in (8.0, 4.0, 4.0):
            self._fit(camera_px, rest, cells, count)
            error = np.linalg.norm(rest - self._value(camera_px, cells), axis=1)
            typical = max(float(np.median(error[self.kept])), 1e-6) / MEDIAN_DISTANCE
            self.kept = error < limit * np.maximum(self.spread[cells], typical)
        self._fit(camera_px, rest, cells, count)

    def _fit(self, camera_px: FloatArray, rest: FloatArray, cells: IntArray, count: int) -> None:
        cells, camera_px, rest = cells[self.kept], camera_px[self.kept], rest[self.kept]
        self.size = np.bincount(cells, minlength=count).astype(np.float64)
        self.centre = np.stack(
            [np.bincount(cells, camera_px[:, axis], count) / np.maximum(self.size, 1) for axis in (0, 1)], axis=-1
        )
        x, y = (camera_px - self.centre[cells]).T
        basis = (np.ones(len(x)), x, y)
        normal = np.empty((count, 3, 3))
        right = np.empty((count, 3, 2))
        for i, first in enumerate(basis):
            for j, second in enumerate(basis):
                normal[:, i, j] = np.bincount(cells, first * second, count) if j >= i else normal[:, j, i]
            for axis in (0, 1):
                right[:, i, axis] = np.bincount(cells, first * rest[:, axis], count)
        square = np.linalg.det(normal[:, 1:, 1:])
        self.good: BoolArray = (self.size >= FEWEST_IN_CELL) & (square > 1e-6 * self.size**2)
        normal[~self.good] = np.eye(3)
        self.inverse = np.linalg.inv(normal)
        self.coefficients = self.inverse @ right
        error = rest - self._value(camera_px, cells)
        squares = np.bincount(cells, np.sum(error**2, axis=1), count)
        self.spread = np.sqrt(squares / np.maximum(2 * self.size - 6, 1))

    def _value(self, camera_px: FloatArray, cells: IntArray) -> FloatArray:
        return np.einsum("ni,nia->na", self._basis(camera_px, cells), self.coefficients[cells])

    def _basis(self, camera_px: FloatArray, cells: IntArray) -> FloatArray:
        return np.concatenate([np.ones((len(cells), 1)), camera_px - self.centre[cells]], axis=1)

    def at(self, camera_px: FloatArray, cells: IntArray) -> tuple[FloatArray, FloatArray]:
        """The map at camera pixels (N, 2) of those cells, and its sigma (N,); NaN where the cell has no fit."""
        basis = self._basis(camera_px, cells)
        variance = np.einsum("ni,nij,nj->n", basis, self.inverse[cells], basis)
        floor = float(np.median(self.spread[self.good])) if self.good.any() else 0.0
        sigma = np.hypot(np.sqrt(variance) * np.maximum(self.spread[cells], floor), MODEL_PX)
        known = (cells >= 0) & self.good[cells]
        value = np.einsum("ni,nia->na", basis, self.coefficients[cells])
        return np.where(known[:, None], value, np.nan), np.where(known, sigma, np.nan)


def _every_nth(camera_px: FloatArray) -> IntArray:
    """Points of every n-th row and column, so that about `MOST_DECODED` remain."""
    every = int(np.ceil(np.sqrt(max(len(camera_px), 1) / MOST_DECODED)))
    return np.flatnonzero(((camera_px + 0.5).astype(np.int32) % every == 0).all(axis=1))


def _on_board(
    camera_px: FloatArray, corners: BoardCorners, board_from_camera: FloatArray, squares: float, spacing: float
) -> IntArray:
    """Rows of points that lie within the board's corners, or up to that many squares beyond."""
    low, high = corners.board_xy.min(axis=0) - squares * spacing, corners.board_xy.max(axis=0) + squares * spacing
    outline = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
    box = apply_homography(np.asarray(np.linalg.inv(board_from_camera), dtype=np.float64), outline)
    x, y = camera_px.T
    rows = np.flatnonzero(
        (x >= box[:, 0].min()) & (x <= box[:, 0].max()) & (y >= box[:, 1].min()) & (y <= box[:, 1].max())
    )
    on_board = apply_homography(board_from_camera, camera_px[rows])
    return rows[((on_board > low) & (on_board < high)).all(axis=1)]


@dataclass(frozen=True, slots=True, eq=False)
class _SmoothMap:
    """Projector from camera pixels over one board: its homography, and a cubic for what the lenses bend."""

    homography: FloatArray
    middle: FloatArray
    spread: float
    cubic: FloatArray

    @classmethod
    def fitted(cls, camera_px: FloatArray, projector_px: FloatArray) -> tuple[_SmoothMap | None, float]:
        """The map, and the share of points within some pixels of the homography."""
        sample = np.linspace(0, len(camera_px) - 1, min(len(camera_px), 3000)).astype(int)
        camera_px, projector_px = camera_px[sample], projector_px[sample]
        cv2 = opencv()
        homography, mask = cv2.findHomography(camera_px, projector_px, cv2.RANSAC, CLOSE_PX, maxIters=500)
        if homography is None:
            return None, 0.0
        inlier = mask.ravel() > 0
        share = float(inlier.mean())
        middle, spread = camera_px.mean(axis=0), float(camera_px.std())
        bare = cls(homography, middle, spread, np.zeros((10, 2)))
        rest = projector_px - bare(camera_px)
        powers = bare._powers(camera_px)
        cubic = bare.cubic
        for _ in range(3):
            basis = powers[inlier]
            cubic = np.asarray(np.linalg.lstsq(basis.T @ basis, basis.T @ rest[inlier])[0], dtype=np.float64)
            error = np.linalg.norm(rest - powers @ cubic, axis=1)
            inlier = error <= 4 * max(float(np.median(error)), 1e-9)
        return cls(homography, middle, spread, cubic), share

    def __call__(self, camera_px: FloatArray) -> FloatArray:
        return apply_homography(self.homography, camera_px) + self._powers(camera_px) @ self.cubic

    def _powers(self, camera_px: FloatArray) -> FloatArray:
        x, y = ((camera_px - self.middle) / self.spread).T
        return np.stack([x**i * y**j for i in range(4) for j in range(4 - i)], axis=-1)


def _cell_side(board_xy: FloatArray, spacing: float) -> float:
    """One square, or as many as a sparse code (a colour grid) needs to have enough points in a cell."""
    for squares in range(1, LARGEST_CELL):
        counts = np.bincount(_cells(board_xy, squares * spacing)[0])
        if np.median(counts) >= 2 * FEWEST_IN_CELL:
            return squares * spacing
    return LARGEST_CELL * spacing


def _cells(board_xy: FloatArray, side: float) -> tuple[IntArray, list[tuple[int, int]]]:
    index = np.floor(board_xy / side + 0.5).astype(np.int64)
    low = index.min(axis=0)
    width = int(np.ptp(index[:, 0])) + 1
    keys, cells = np.unique((index[:, 1] - low[1]) * width + index[:, 0] - low[0], return_inverse=True)
    return cells, [(int(key % width + low[0]), int(key // width + low[1])) for key in keys]


def _name(board_xy: FloatArray, side: float) -> tuple[int, int]:
    column, row = np.floor(board_xy / side + 0.5)
    return int(column), int(row)
