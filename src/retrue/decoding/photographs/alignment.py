"""Each match to a fraction of a pixel: the patch about it, warped until it looks like its partner.

right(A u + t) = g left(p + u) + c for the pixels u of a patch about p: the affine A and t, gain g and offset c are the
least-squares solution, by Gauss-Newton steps whose Jacobian is the left patch's own (inverse composition). Its residual
and its Jacobian say how well t is known: sigma^2 = var(residual) (J^T J)^-1, whatever the matcher thinks of it.

Sources: Gruen, "Adaptive least squares correlation", 1985; Baker and Matthews, "Lucas-Kanade 20 years on", 2004.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import cv2
import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray, Image, IntArray
from retrue.patterns.photographs import Matches

HALF = 7  # px of the patch at its own level: side 15
WINDOW_SIGMA = HALF / 1.5
LEVEL_SIZE = (
    12.0  # px: features up to this size are aligned in the picture itself, twice as large ones in its half, ...
)
MOST_LEVELS = 3
UPRIGHT = 0.35  # rad: features turned by less start unturned; their direction is no better known
STEPS = 10
GAINS = 0.1, 10.0  # contrast of the right photograph in that of the left one
SETTLED_PX = 0.02
FARTHEST = 2.0  # px of its level that an alignment may go from the match
LEAST_AREA, MOST_AREA = 0.15, 6.0  # of a patch seen in the other picture
BATCH = 256


@dataclass(frozen=True, slots=True, eq=False)
class Aligned:
    """N matches, as their patches have them.

    Attributes
    ----------
    right_px : (N, 2) where the left place is in the right photograph.
    sigma_px : (N,) of that, per axis, as far as noise of the pictures explains it.
    likeness : (N,) share of the patch's contrast that its partner explains.
    settled : (N,) whether the steps came to rest, near the match and within both pictures.
    """

    right_px: FloatArray
    sigma_px: FloatArray
    likeness: FloatArray
    settled: BoolArray


def align(left: Image, right: Image, matches: Matches) -> Aligned:
    """Align every match of two grey pictures (h, w), float32."""
    count = len(matches)
    found = Aligned(matches.right_px.copy(), np.full(count, np.inf), np.zeros(count), np.zeros(count, dtype=np.bool_))
    size = np.full((count, 2), LEVEL_SIZE / 2) if matches.size is None else matches.size
    levels = np.clip(np.ceil(np.log2(np.maximum(size.min(axis=1), 1e-3) / LEVEL_SIZE)), 0, MOST_LEVELS).astype(int)
    for level in range(MOST_LEVELS + 1):
        if level:
            if min(*left.shape, *right.shape) < 8 * HALF:
                break
            left, right = cv2.pyrDown(left), cv2.pyrDown(right)
        rows = np.flatnonzero(levels == level)
        for first in range(0, len(rows), BATCH):
            _align(left, right, matches, size, rows[first : first + BATCH], 2.0**level, found)
    return found


def _align(
    left: Image, right: Image, matches: Matches, size: FloatArray, rows: IntArray, pixel: float, found: Aligned
) -> None:
    """The matches of those rows, in pictures whose pixels are so many times the photograph's."""
    place, start = matches.left_px[rows] / pixel, matches.right_px[rows] / pixel
    patch, jacobian, variance = _patches(left, place)
    normal: FloatArray = np.asarray((jacobian * WEIGHTS[:, None]).transpose(0, 2, 1) @ jacobian, dtype=np.float64)
    normal[:, np.arange(8), np.arange(8)] *= 1 + 1e-6
    normal += np.eye(8) * 1e-6
    inverse = cast(FloatArray, np.linalg.inv(normal))
    warp, there = _first_warps(matches, size, rows), start.copy()
    residual, moved = np.zeros_like(patch), np.full(len(rows), np.inf)
    gains = np.ones(len(rows))
    active = np.arange(len(rows))
    for _ in range(STEPS):
        points = there[active, None] + OFFSETS @ warp[active].transpose(0, 2, 1)
        difference = _sampled(right, points) - patch[active]
        weighted = (difference * WEIGHTS)[:, None, :] @ jacobian[active]
        step = (inverse[active] @ weighted.transpose(0, 2, 1).astype(np.float64))[..., 0]
        residual[active] = difference - (jacobian[active] @ step[..., None].astype(np.float32))[..., 0]
        gain = np.clip(1 + step[:, 6:7], *GAINS)  # the slopes of the right patch are so many times the left one's
        step = step[:, :6] / gain
        local = np.eye(2) + step[:, 2:].reshape(-1, 2, 2)
        sound = np.abs(np.linalg.det(local)) > 1e-3
        local[~sound] = np.eye(2)
        warp[active] = warp[active] @ np.linalg.inv(local)
        shift = (warp[active] @ step[:, :2, None])[..., 0]
        there[active] -= shift
        gains[active] = gain[:, 0]
        moved[active] = np.where(sound, np.linalg.norm(shift, axis=1), np.inf)
        lost = ~(np.linalg.norm(there[active] - start[active], axis=1) < 2 * FARTHEST)
        moved[active[lost]] = np.inf
        active = active[~lost & (moved[active] > SETTLED_PX / 4)]
        if not len(active):
            break
    unexplained = (WEIGHTS * residual.astype(np.float64) ** 2).sum(axis=1) / WEIGHTS.sum()
    determinant = np.linalg.det(warp)
    slope = warp / gains[:, None, None]
    shape = slope @ inverse[:, :2, :2] @ slope.transpose(0, 2, 1)
    known = np.sqrt(np.maximum(unexplained * (shape[:, 0, 0] + shape[:, 1, 1]) / 2, 0.0))
    inside = _inside(left, place) & _inside(right, there)
    found.right_px[rows] = there * pixel
    found.sigma_px[rows] = known * pixel
    found.likeness[rows] = 1 - unexplained / np.maximum(variance, 1e-9)
    found.settled[rows] = (
        inside
        & (moved <= SETTLED_PX)
        & (np.linalg.norm(there - start, axis=1) <= FARTHEST)
        & (determinant >= LEAST_AREA)
        & (determinant <= MOST_AREA)
    )


def _patches(picture: Image, place: FloatArray) -> tuple[Any, Any, FloatArray]:
    """(N, P) patches, their Jacobian (N, P, 8) by shift, warp, gain and offset, and their variance (N,)."""
    side = 2 * HALF + 1
    wide = _sampled(picture, place[:, None] + WIDE).reshape(-1, side + 2, side + 2)
    patch = wide[:, 1:-1, 1:-1].reshape(len(place), -1)
    x = ((wide[:, 1:-1, 2:] - wide[:, 1:-1, :-2]) / 2).reshape(len(place), -1)
    y = ((wide[:, 2:, 1:-1] - wide[:, :-2, 1:-1]) / 2).reshape(len(place), -1)
    u, v = OFFSETS[:, 0].astype(np.float32), OFFSETS[:, 1].astype(np.float32)
    mean = (patch * WEIGHTS).sum(axis=1, keepdims=True) / WEIGHTS.sum()
    centred = patch - mean
    jacobian = np.stack([x, y, x * u, x * v, y * u, y * v, centred, np.ones_like(patch)], axis=-1)
    variance = (WEIGHTS * centred.astype(np.float64) ** 2).sum(axis=1) / WEIGHTS.sum()
    return patch, jacobian, variance


def _first_warps(matches: Matches, size: FloatArray, rows: IntArray) -> FloatArray:
    """(N, 2, 2) right from left, as size and direction of the features have it."""
    if matches.size is None or matches.turn is None:
        return np.tile(np.eye(2), (len(rows), 1, 1))
    turn = np.angle(np.exp(1j * matches.turn[rows]))
    turn = np.where(np.abs(turn) < UPRIGHT, 0.0, turn)
    scale = size[rows, 1] / size[rows, 0]
    scale = np.where(np.abs(np.log(scale)) < UPRIGHT, 1.0, scale)
    cos, sin = scale * np.cos(turn), scale * np.sin(turn)
    return np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=-2)


def _sampled(picture: Image, points: FloatArray) -> Any:
    """float32 (N, P) of the picture at points (N, P, 2)."""
    return cv2.remap(
        picture, points.astype(np.float32), cast(Any, None), cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
    )


def _inside(picture: Image, place: FloatArray) -> BoolArray:
    height, width = picture.shape
    return np.all((place >= HALF / 2) & (place <= np.array([width, height]) - 1 - HALF / 2), axis=1)


def _grid(half: int) -> FloatArray:
    """(P, 2) offsets of a square patch, row by row."""
    y, x = np.mgrid[-half : half + 1, -half : half + 1]
    return np.stack([x, y], axis=-1).reshape(-1, 2).astype(np.float64)


OFFSETS, WIDE = _grid(HALF), _grid(HALF + 1)
WEIGHTS = np.exp(-(OFFSETS**2).sum(axis=1) / (2 * WINDOW_SIGMA**2)).astype(np.float32)
