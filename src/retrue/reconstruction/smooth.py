"""A dense cloud smoothed over its grid, as far as noise explains what is evened out, and never over an edge.

Inverse depth w is smoothed along the camera's rays: a plane is linear in it, and its noise is even over the picture.
Each point takes the value of a quadric that is fitted to the window of cells around it, by one fixed filter a size,

    k(x, y) = s(x) / n + s(y) / n - 1 / n^2,    n = 2 h + 1,

s the filter of a parabola in one dimension. A window counts only where the surface goes on through all of it, so that
nothing is carried over a jump. What a quadric cannot follow in it, a crease or a tight bend, errs as noise does
(`lack_of_fit`): of all windows about a point that counts in which both together are least, and sigma holds both.
Where two sides are told to meet in a crease (`creases`), no window about the point counts, and both sides do.

Source: Savitzky, Golay, "Smoothing and differentiation of data by simplified least squares procedures", Analytical
Chemistry 36, 1964 (the filter).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from retrue.errors import InputError
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.robust import MAD_TO_SIGMA
from retrue.reconstruction.cloud import Cloud, require_cloud
from retrue.reconstruction.creases import find_creases
from retrue.reconstruction.lack_of_fit import centre_filter, filtered, lack_of_fit
from retrue.reconstruction.surface_grid import SurfaceGrid, surface_grid

HALVES = (1, 2, 4, 8)
"""Cells that a window reaches to either side of its own."""
AGREE = 3.0
"""Sigmas by which the middles of opposite neighbours may differ, of a cell without a point."""
INDEPENDENT = 0.75
"""Of what white noise would lose: neighbours that lose so much err each by itself."""
FEWEST = 500
"""Windows that tell how much a size evens out."""


@dataclass(frozen=True, slots=True, eq=False)
class _Window:
    """What one size of window makes of inverse depth, (H, W) each.

    Attributes
    ----------
    w : the value of the quadric in its middle.
    whole : where the surface goes on through all of the window.
    left : share of the variance that white noise leaves.
    variance : mean of the points' own in the window.
    lack : what a quadric is expected to be off in its middle, squared; infinite where there is no window.
    fits : whether it is more likely not off at all.
    """

    w: FloatArray
    whole: BoolArray
    left: float
    variance: FloatArray
    lack: FloatArray
    fits: BoolArray


def smoothed(cloud: Cloud) -> Cloud:
    """The cloud with less noise: each point moved along the camera's ray, and its `sigma` that of where it is now.

    How much of the noise each size of window takes away is measured on the cloud, since neighbours may err alike: a
    Gray code's points do, over some two stripes, and gain little. `Cloud.card` tells how many points were `smoothed`,
    and the median side of their windows, `smoothed_cells`.

    Raises
    ------
    InputError : the points have no grid, or nobody knows their noise.
    """
    require_cloud(cloud)
    if cloud.cells is None or cloud.sigma is None:
        raise InputError(
            "smooth: expected points of a capture with a grid, and their sigma, found scattered ones; decode a picture"
        )
    grid = surface_grid(cloud.points, cloud.cells, cloud.sigma)
    own = (cloud.sigma / (cloud.points[:, 2] * np.linalg.norm(cloud.points, axis=1))) ** 2  # variance of w
    variance = np.where(grid.index >= 0, own[grid.index], np.nan)
    windows = _windows(grid, variance)
    steps, last = _steps(windows)
    errors = [(sum(steps[number:]) + last) * window.variance + window.lack for number, window in enumerate(windows)]
    values, sides = [window.w for window in windows], [1, *(2 * half + 1 for half in HALVES)][: len(windows)]
    if len(windows) == 1 + len(HALVES):
        _beside_creases(grid, windows, last, values, errors)
        sides.append(sides[-1])
    size = np.where(grid.index >= 0, np.nan_to_num(errors, nan=np.inf).argmin(axis=0), 0)
    ratio, share = np.ones(len(cloud)), np.ones(len(cloud))
    for number in range(1, len(errors)):
        here = size == number
        rows = grid.index[here]
        ratio[rows] = grid.w[here] / values[number][here]
        share[rows] = np.sqrt(np.minimum(errors[number][here] / own[rows], 1.0))
    return _moved(cloud, ratio, share, np.array(sides)[size[size > 0]])


def _beside_creases(
    grid: SurfaceGrid, windows: list[_Window], last: float, values: list[FloatArray], errors: list[FloatArray]
) -> None:
    """Values and expected errors of the two sides of creases, added to those of windows, which do not count there.
    Neighbours that err alike leave what they leave of the largest window."""
    ends = ~np.isfinite(grid.w)
    ends[:, :-1] |= ~grid.right
    ends[:-1] |= ~grid.down
    around = windows[-1].variance
    found = find_creases(np.nan_to_num(grid.w), around, ends, windows[-1].fits, HALVES[-1])
    for number in range(1, len(windows)):
        errors[number] = np.where(found.told, np.inf, errors[number])
    left = found.left + max(last - windows[-1].left, 0.0)
    values.append(found.values)
    errors.append(np.where(found.told, left * around, np.inf))


def _moved(cloud: Cloud, ratio: FloatArray, share: FloatArray, sides: IntArray) -> Cloud:
    """The cloud with points that many times as far away, and that share of their sigma; of those moved the windows'
    sides."""
    assert cloud.sigma is not None
    sigma, known = cloud.sigma * share, cloud.uncertainty
    if known is not None:
        camera, projector = (share * own for own in (known.camera_sigma_px, known.projector_sigma_px))
        known = replace(known, camera_sigma_px=camera, projector_sigma_px=projector)
    card = {
        **cloud.card,
        "smoothed": len(sides),
        "smoothed_cells": int(np.median(sides)) if len(sides) else 1,
        "sigma": float(np.nanmedian(sigma)) if np.isfinite(sigma).any() else None,
    }
    return replace(cloud, points=cloud.points * ratio[:, None], sigma=sigma, uncertainty=known, card=card)


def _windows(grid: SurfaceGrid, variance: FloatArray) -> list[_Window]:
    """Of each size; the first is the point itself."""
    there = np.isfinite(grid.w)
    pairs, around = (_opposite(values) for values in (grid.w, variance))
    with np.errstate(invalid="ignore"):  # a cell without a point, about which opposite ones all have one middle
        bridged = ~there & (np.ptp(pairs, axis=0) <= AGREE * np.sqrt(around.mean(axis=0)))
    w, own = (np.where(bridged, of.mean(axis=0), at) for of, at in ((pairs, grid.w), (around, variance)))
    gap = ~(there | bridged)
    right = ~(grid.right | bridged[:, :-1] | bridged[:, 1:])
    down = ~(grid.down | bridged[:-1] | bridged[1:])
    level = np.nan_to_num(w)
    made = [_Window(grid.w, there, 1.0, variance, np.zeros(there.shape), there)]
    for half in HALVES:
        side = 2 * half + 1
        if side > min(there.shape):
            break
        whole = np.zeros(there.shape, np.bool_)
        inner = (slice(half, -half), slice(half, -half))
        whole[inner] = (
            _sums(gap, side, side) + _sums(right, side, side - 1) + _sums(down, side - 1, side) == 0
        ) & there[inner]
        mean, line = np.full(side, 1 / side), centre_filter(half, 2)
        value = filtered(level, mean, line) + filtered(level, line - mean, mean)
        filter_ = np.add.outer(line, line) / side - 1 / side**2
        of_points = filtered(np.nan_to_num(own), mean, mean)
        lack = lack_of_fit(level, of_points, whole & (of_points > 0), half)
        made.append(_Window(value, whole, float(np.sum(filter_**2)), of_points, lack.variance, lack.fits))
    return made


def _steps(windows: list[_Window]) -> tuple[list[float], float]:
    """Share of the variance that each window takes from the one before it; and what the last one leaves.

    Windows tell that in which a quadric fits. Where those are too few, it is what they would take were neighbours
    independent. Where all take hardly less than that, what is left goes on so; else neighbours err alike over more than
    the windows, and the rest is left.
    """
    level, steps = 1.0, list[float]()
    for finer, coarser in pairwise(windows):
        both = finer.whole & coarser.fits
        if np.count_nonzero(both) >= FEWEST:
            variance = (finer.left - coarser.left) * coarser.variance[both]
            level = (MAD_TO_SIGMA * float(np.median(np.abs(finer.w - coarser.w)[both] / np.sqrt(variance)))) ** 2
        steps.append(level * (finer.left - coarser.left))
    alike = sum(steps) < INDEPENDENT * (1 - windows[-1].left)
    return steps, 1 - sum(steps) if alike else level * windows[-1].left


def _opposite(values: FloatArray) -> FloatArray:
    """(4, H, W) means of the two cells on opposite sides of each, NaN beyond the border."""
    padded = np.pad(values, 1, constant_values=np.nan)
    height, width = values.shape

    def beside(down: int, right: int) -> FloatArray:
        return padded[1 + down : 1 + down + height, 1 + right : 1 + right + width]

    return np.stack([(beside(*way) + beside(-way[0], -way[1])) / 2 for way in ((0, 1), (1, 0), (1, 1), (1, -1))])


def _sums(mask: BoolArray, height: int, width: int) -> FloatArray:
    """(H - height + 1, W - width + 1) how many of each block of cells are true."""
    total = np.pad(np.cumsum(np.cumsum(mask, axis=0), axis=1), ((1, 0), (1, 0)))
    rows = total[height:] - total[: len(total) - height]
    return np.asarray(rows[:, width:] - rows[:, : rows.shape[1] - width], np.float64)
