"""What a capture's points err by themselves, per pixel, measured on the capture itself.

Decoders say how sure one point is beside another, and often how sure it is; whether that is so, two families of
residuals tell. Rays miss each other ACROSS the epipolar line by nothing but noise, at every point. ALONG it, where an
error is one of depth, points scatter about the smooth surface that they lie on, where it is smooth. So across the line
it is measured how the noise goes with the decoder's own sigma, and how it grows at the rim of a surface, where
a pixel sees two; and along it, over steps of the capture's grid, how much there is in all, and in each part of the
picture.

A decoder that tells the two coordinates of the projector apart has measured each by its own scatter, and is believed:
across the line mostly the one errs, along it the other, and neighbours that rest on the same edges of stripes err alike
over more than the steps of any grid, so that their differences show too little.
"""

from __future__ import annotations

from math import erf, erfc, exp, pi
from typing import Any, cast

import numpy as np

from retrue.correspondences import Correspondences
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.reconstruction.sensitivity import miss_by_pixels, point_by_pixels
from retrue.reconstruction.surface_grid import SurfaceGrid, cells_from_rim
from retrue.rig import Rig

HALF = 0.6745
"""Median size of a normal number."""
CLIPPED = 2.0
CLIPPED_SQUARE = (
    erf(CLIPPED / 2**0.5) - CLIPPED * (2 / pi) ** 0.5 * exp(-(CLIPPED**2) / 2) + CLIPPED**2 * erfc(CLIPPED / 2**0.5)
)
"""Mean square of normal numbers that are clipped there."""
CUT_SQUARE = 1 - 2 * CLIPPED * exp(-(CLIPPED**2) / 2) / (2 * pi) ** 0.5 / erf(CLIPPED / 2**0.5)
"""Mean square of those that lie within."""
LEAST, LEAST_SIZE = 0.2, 0.2533
"""Share of normal numbers, and that quantile of their size."""
ROUNDS = 8
PER_LEVEL = 250  # points that tell the noise at one size of the decoder's sigma
MOST_LEVELS = 12
BELIEF = 2.0  # points that the decoder's own word counts as
SMALLEST = 1e-6  # of the stated sigma: made up of exact numbers
RIM = 3  # cells from the rim of a surface that are looked at one by one
STEPS_PER_SIDE = 80  # of the longest third differences, on the longer side of the grid: neighbours err alike over less
RISE = 1.1  # times the noise over a shorter step: neighbours err alike over that
THIRD = np.array([1.0, -3.0, 3.0, -1.0])
FEWEST_CHAINS = 100
DOUBTED = 2.0  # times the usual sigma
MOST_CHAINS = 200_000
PER_BLOCK, MOST_BLOCKS = 200, 32
"""Chains that tell the noise in one part of the picture, and how many parts there are on its longer side at most."""
BLOCK = 1 << 15


def point_noise(
    rig: Rig, points: Correspondences, X: FloatArray, residual_px: FloatArray, grid: SurfaceGrid | None
) -> tuple[FloatArray, FloatArray] | None:
    """One sigma (N,) per axis of the camera's and of the projector's pixels; None where nothing tells.

    Parameters
    ----------
    points : N, kept all.
    X : (N, 3) where they lie.
    residual_px : (N,) by which their rays miss each other; NaN or 0 of one coordinate.
    grid : of X; None where the points have none.
    """
    stated = points.camera_sigma_px is not None or points.projector_sigma_px is not None
    camera, projector = stated_sigmas(points)
    if points.projector_sigma_ratio is not None:
        return camera, projector
    across, along = _sigmas_of_residuals(rig, points, X, camera, projector)
    both = len(points.axes) == 2
    level = np.ones(len(X))
    if both:
        level = _levels(np.hypot(camera, projector), residual_px / across, BELIEF if stated else 0.0)
        if grid is not None:
            level = level * _rim_levels(residual_px / (across * level), cells_from_rim(grid, len(X), RIM))
    if grid is not None:
        found = _scatter_in_depth(X, along * level, grid)
        if found is not None:
            stated, level = True, level * found
    level = _of_noise(np.hypot(camera, projector), level)
    return (camera * level, projector * level) if both or stated else None


def stated_sigmas(points: Correspondences) -> tuple[FloatArray, FloatArray]:
    """(N,) of each device: as stated; a device that nothing is said of is exact, or as noisy where neither is named."""
    given = points.camera_sigma_px, points.projector_sigma_px
    if given[0] is None and given[1] is None:
        return np.ones(len(points)), np.ones(len(points))
    camera, projector = (np.zeros(len(points)) if sigma is None else np.abs(sigma) for sigma in given)
    total = np.hypot(camera, projector)
    known = np.isfinite(total) & (total > 0)
    usual = [float(np.median(sigma[known])) if known.any() else 1.0 for sigma in (camera, projector)]
    return np.where(known, camera, usual[0]), np.where(known, projector, usual[1])


def _sigmas_of_residuals(
    rig: Rig, points: Correspondences, X: FloatArray, camera: FloatArray, projector: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """What these sigmas make of the distance across the epipolar line (NaN of one coordinate), and of 1 / Z."""
    across, along = np.full(len(X), np.nan), np.empty(len(X))
    for first in range(0, len(X), BLOCK):
        part = slice(first, first + BLOCK)
        variances = np.stack([camera[part] ** 2] * 2 + [projector[part] ** 2] * len(points.axes), axis=1)
        depth = point_by_pixels(rig, X[part], points.axes)[:, 2]
        along[part] = np.sqrt((depth**2 * variances).sum(axis=1)) / X[part, 2] ** 2
        if len(points.axes) == 2:
            across[part] = np.sqrt((miss_by_pixels(rig, X[part]) ** 2 * variances).sum(axis=1))
    return across, along


def _levels(stated: FloatArray, z: FloatArray, belief: float) -> FloatArray:
    """(N,) true over stated sigma, as a function of the stated one: that of equal parts of the points, in between
    interpolated; z (N,) are residuals in stated sigmas.

    What a decoder doubts beyond its usual noise are edges and shadows. They lie across the epipolar lines and move
    points along them, where no residual shows it: so such a doubt is never made less of than the usual noise is.
    """
    told = np.flatnonzero(np.isfinite(z))
    if not len(told):
        return np.ones(len(z))
    order = told[np.argsort(stated[told], kind="stable")]
    parts = np.array_split(order, int(np.clip(len(order) // PER_LEVEL, 1, MOST_LEVELS)))
    sizes = np.log([float(np.median(stated[part])) for part in parts])
    logs = np.log([robust_size(z[part], belief) for part in parts])
    usual = len(parts) // 2
    logs[usual:] = np.maximum(logs[usual:], logs[usual])
    apart = np.append(True, np.diff(sizes) > 1e-9)
    return np.exp(np.interp(np.log(stated), sizes[apart], logs[apart]))


def _of_noise(stated: FloatArray, level: FloatArray) -> FloatArray:
    """(N,) `level` where the noise of most points is so many times theirs: what some are doubted beyond that, by edges
    that no residual shows, is not made less of since all have less noise than stated."""
    noise = np.minimum((float(np.median(stated)) / stated) ** 2, 1.0)  # share of the variance
    return np.sqrt(noise * level**2 + (1 - noise) * np.maximum(level, 1.0) ** 2)


def robust_size(z: FloatArray, belief: float = 0.0) -> float:
    """Robust sigma of z, of which so many more points are believed to have 1.

    Huber's proposal 2: the variance of z, clipped at `CLIPPED` sigmas, over that of normal numbers so clipped.
    """
    found = float(np.median(np.abs(z))) / HALF
    for _ in range(ROUNDS):
        found = float(np.sqrt(np.mean(np.minimum(z**2, (CLIPPED * found) ** 2)) / CLIPPED_SQUARE))
    return float(max(found, SMALLEST) ** (len(z) / (len(z) + belief)))


def _rim_levels(z: FloatArray, cells: IntArray) -> FloatArray:
    """(N,) how much more the points so many cells from the rim err than the others; never less."""
    level = np.ones(len(z))
    for distance in range(RIM + 1):
        there = (cells == distance) & np.isfinite(z)
        if there.any():
            level[cells == distance] = max(robust_size(z[there], BELIEF), 1.0)
    return level


def _scatter_in_depth(X: FloatArray, along: FloatArray, grid: SurfaceGrid) -> FloatArray | None:
    """(N,) how many times as much points scatter along the epipolar lines as expected; None where too few tell.

    `along` (N,) is the sigma of 1 / Z that is expected. Third differences over the grid free depth of what is smooth,
    over steps as short as noise allows (`_differences`): of a ball, of which a step covers a tenth of the radius, they
    leave a few thousandths of a step. A point that is doubted is mostly right, and would make the others look sure: it
    does not count. A decoder's sigma says little of the waves where its pattern and the camera's pixels beat, strong in
    one place, none in the next: so the picture is cut into blocks, the size of the differences (Huber's, as
    `robust_size`) is taken of all and of each, and interpolated between the blocks' middles.
    """
    from scipy import ndimage

    chains, off = _differences(X, along, grid)
    sure = (along[chains] <= DOUBTED * np.median(along)).all(axis=1)
    if sure.sum() >= FEWEST_CHAINS:
        chains, off = chains[sure], off[sure]
    if len(chains) < FEWEST_CHAINS:
        return None
    side = max(1, round(np.sqrt(grid.index.size * PER_BLOCK / len(chains))), -(-max(grid.index.shape) // MOST_BLOCKS))
    place = np.zeros((len(X), 2), dtype=np.int64)
    place[grid.index[grid.index >= 0]] = np.argwhere(grid.index >= 0)
    blocks = tuple(-(-extent // side) for extent in grid.index.shape)
    block = np.ravel_multi_index(tuple((place[chains[:, 1]] // side).T), blocks)
    everywhere = robust_size(off)
    off = off / everywhere

    told = np.bincount(block, minlength=blocks[0] * blocks[1])
    size = np.ones(len(told))
    for _ in range(ROUNDS):
        clipped = np.minimum(off**2, (CLIPPED * size[block]) ** 2)
        size = np.sqrt(np.bincount(block, clipped, len(told)) / CLIPPED_SQUARE / np.maximum(told, 1))
        size = np.where(told > 0, np.maximum(size, SMALLEST), 1.0)
    logs = (np.log(size) * told / (told + PER_BLOCK / 4)).reshape(blocks)
    between = (place.T + 0.5) / side - 0.5
    return everywhere * np.exp(cast("Any", ndimage).map_coordinates(logs, between, order=1, mode="nearest"))


def _differences(X: FloatArray, along: FloatArray, grid: SurfaceGrid) -> tuple[IntArray, FloatArray]:
    """Chains (M, 4), and the third difference (M,) of 1 / Z of each, in sigmas.

    Over the shortest step from which on a longer one finds no more noise: what neighbours err alike shows in long steps
    only, all over the scene; what a scene bends shows in long steps the most, here and there.
    """
    longest = max(1, max(grid.index.shape) // STEPS_PER_SIDE)
    steps = [*(2**k for k in range(longest.bit_length()) if 2**k < longest), longest]
    best, before = _over_step(X, along, grid, steps[0]), np.inf
    for number, step in enumerate(steps):
        found = _over_step(X, along, grid, step) if number else best
        if len(found[0]) < FEWEST_CHAINS:
            break
        usual = _most_have(found[1])
        best = found if usual > RISE * before else best
        before = usual
    return best


def _most_have(z: FloatArray) -> float:
    """Sigma of normal numbers that most of z are, the least of them, whatever the others."""
    size = np.abs(z)
    found = float(np.quantile(size, LEAST)) / LEAST_SIZE
    for _ in range(ROUNDS):
        inside = size[size <= CLIPPED * found]
        found = max(float(np.sqrt(np.mean(inside**2) / CUT_SQUARE)) if len(inside) else 0.0, SMALLEST)
    return found


def _over_step(X: FloatArray, along: FloatArray, grid: SurfaceGrid, step: int) -> tuple[IntArray, FloatArray]:
    chains = np.concatenate([_chains(grid.index, grid.right, step), _chains(grid.index.T, grid.down.T, step)])
    chains = chains[:: max(1, len(chains) // MOST_CHAINS)]
    return chains, ((1 / X[chains, 2]) @ THIRD) / np.sqrt(along[chains] ** 2 @ THIRD**2)


def _chains(index: IntArray, right: BoolArray, step: int) -> IntArray:
    """(M, 4) points at four places of a row, so many cells apart, between which the surface goes on without a jump."""
    count = index.shape[1] - 3 * step
    if count <= 0:
        return np.empty((0, 4), dtype=np.int64)
    linked = np.pad(np.cumsum(right, axis=1), ((0, 0), (1, 0)))
    whole = linked[:, 3 * step :] - linked[:, :count] == 3 * step
    return np.stack([index[:, k * step : k * step + count][whole] for k in range(4)], axis=1)
