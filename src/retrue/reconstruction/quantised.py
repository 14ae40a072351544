"""Whole projector pixels: noticed, and put between their neighbours, so that a surface has no steps.

Tools that read codes without their edges hand on whole pixels (or every second one ...). Triangulated as they are,
they make steps in depth, which look like jumps: a surface falls apart into strips. Each true coordinate lies within
half a step of what was read. Within that, it is moved to the mean of its neighbours, again and again, wherever their
readings go on smoothly: relaxation to the flattest surface that every reading allows.
"""

from __future__ import annotations

import numpy as np

from retrue.correspondences import Correspondences
from retrue.errors import InputError
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.reconstruction.surface_grid import cell_index

ROUNDING = 1e-6  # of a step: what lies nearer to a multiple is one
FEWEST_PER_STEP = 4  # points that share a reading, on average
SAME = 0.95
"""Share of neighbours that are one distance apart, from which on readings are places of a pattern, such as centres of
blocks, and no rounded ones."""
MOST_ROUNDS = 100
SAMPLE = 20_000


def quantisation_px(points: Correspondences) -> tuple[float, float]:
    """The step of either projector coordinate; 0 where it is read finer, or not at all.

    >>> x, y = np.meshgrid(np.arange(80.0), np.arange(60.0))
    >>> camera = np.stack([x.ravel(), y.ravel()], axis=-1)
    >>> quantisation_px(Correspondences(camera, np.round(camera / 3)))
    (1.0, 1.0)
    >>> quantisation_px(Correspondences(camera, camera / 3))
    (0.0, 0.0)
    """
    index = _grid(points)
    if index is None:
        return 0.0, 0.0
    steps = [_step(points.projector_px[:, axis], index) if axis in points.axes else 0.0 for axis in (0, 1)]
    return steps[0], steps[1]


def between_readings(points: Correspondences, steps: tuple[float, float]) -> FloatArray:
    """(N, 2) projector pixels, each coordinate within half of its step of what was read, and smooth otherwise."""
    projector_px = points.projector_px.copy()
    index = _grid(points)
    if index is None:
        return projector_px
    there = index >= 0
    for axis, step in enumerate(steps):
        if step > 0:
            read = np.where(there, points.projector_px[index, axis], np.nan)
            relaxed = _relaxed(read, step)
            projector_px[index[there], axis] = relaxed[there]
    return projector_px


def _grid(points: Correspondences) -> IntArray | None:
    """Which point lies in each cell, or in each pixel of the camera where the points have no cells; None: neither."""
    cells = points.cells
    if cells is None:
        if not len(points) or (points.camera_px != np.round(points.camera_px)).any():
            return None
        cells = points.camera_px[:, ::-1].astype(np.int64)
    try:
        return cell_index(cells)
    except InputError:  # scattered farther than any picture is large
        return None


def _step(values: FloatArray, index: IntArray) -> float:
    few = values[:: max(1, len(values) // SAMPLE)]
    places = np.asarray(np.unique(few), dtype=np.float64)
    if len(places) < 3 or len(few) < FEWEST_PER_STEP * len(places):
        return 0.0
    step = float(np.diff(places).min())
    multiples = np.asarray((values - places[0]) / step, dtype=np.float64)
    if (np.abs(multiples - np.rint(multiples)) > ROUNDING * np.maximum(1, np.abs(multiples))).any():
        return 0.0
    there = index >= 0
    grid = np.where(there, np.rint(multiples)[index], np.nan)
    exact = [_most_common(np.diff(grid, axis=axis)) for axis in (0, 1)]
    return 0.0 if min(exact) > SAME else step


def _most_common(differences: FloatArray) -> float:
    """Share of the differences that are the most common one."""
    known = differences[np.isfinite(differences)]
    return float(np.unique(known, return_counts=True)[1].max() / len(known)) if len(known) else 1.0


def _relaxed(read: FloatArray, step: float) -> FloatArray:
    """The grid (H, W) of one coordinate, NaN where there is no point, between its readings."""
    smooth = [_goes_on(read, step), _goes_on(read.T, step).T]
    low, high = read - step / 2, read + step / 2
    relaxed = read
    for _ in range(_rounds(read)):
        total, count = relaxed.copy(), np.ones(read.shape)
        for axis, on in enumerate(smooth):
            mean = _mean_of_neighbours(relaxed, 1 - axis)
            total += np.where(on, mean, 0.0)
            count += on
        relaxed = np.clip(total / count, low, high)
    return relaxed


def _goes_on(read: FloatArray, step: float) -> BoolArray:
    """Where both neighbours of the row are there, and readings of a straight line could be these."""
    bend = np.full(read.shape, np.nan)
    bend[:, 1:-1] = read[:, :-2] - 2 * read[:, 1:-1] + read[:, 2:]
    return np.abs(bend) <= 2 * step


def _mean_of_neighbours(grid: FloatArray, axis: int) -> FloatArray:
    mean = np.zeros(grid.shape)
    if axis == 1:
        mean[:, 1:-1] = 0.5 * (grid[:, :-2] + grid[:, 2:])
    else:
        mean[1:-1] = 0.5 * (grid[:-2] + grid[2:])
    return mean


def _rounds(read: FloatArray) -> int:
    """Enough to even out steps that are as long as these: what spreads goes as far as the root of the rounds."""
    steps = (read[1:] - read[:-1], read[:, 1:] - read[:, :-1])
    changing = max(np.count_nonzero(np.abs(along) > 0) / max(np.isfinite(along).sum(), 1) for along in steps)
    longest = 1 / max(changing, 0.1)
    return min(max(round(4 * longest**2), 8), MOST_ROUNDS)
