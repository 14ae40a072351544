"""The image of each block's centre, to a small part of a pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from retrue.geometry.arrays import BoolArray, FloatArray, Image

SAMPLES = 9  # across each side of a block
LINES = 9  # side by side, along each side
SPREAD = 0.8  # of the side that the lines cover
WINDOW = 0.88  # of half a gap: how far the samples reach to either side
ROUNDS = 3
CREASE = 0.1  # change of the pitch from one block to the next that no smooth surface shows
FARTHEST = 0.3  # of a pitch that a centre may lie off the middle of its blob


@dataclass(frozen=True, slots=True, eq=False)
class Centres:
    """Of every cell of the code, (rows, columns, ...); NaN where there is none.

    Attributes
    ----------
    camera_px : (rows, columns, 2) the image of the centre.
    sigma_px : (rows, columns) standard deviation per axis.
    """

    camera_px: FloatArray
    sigma_px: FloatArray


def refine_centres(image: Image, coarse: FloatArray, joined: tuple[BoolArray, BoolArray], duty: float) -> Centres:
    """Centres (rows, columns, 2) from the four sides of each block, starting from `coarse` (NaN: no block).

    `joined` says which blocks are on one surface with the next block of their row (rows, columns - 1), and with the
    next one of their column (rows - 1, columns).

    Along each axis of the grid the block's profile falls to half its height at two sides; their middle is the
    centre in affine approximation, however blurred the sides are. Perspective bends the scale: positions
    are x(u) = x0 + a u + b u^2 / 2 in grid units, so the middle of u = -h and u = +h lies b h^2 / 2 off x0; b comes
    from the neighbours. `duty` is block over pitch.
    """
    right, right_bend = _derivatives(coarse, joined[0], axis=1)
    down, down_bend = _derivatives(coarse, joined[1], axis=0)
    known = np.isfinite(right[..., 0]) & np.isfinite(down[..., 0]) & np.isfinite(coarse[..., 0])
    position = np.full_like(coarse, np.nan)
    sigma = np.full(coarse.shape[:2], np.nan)
    if known.any():
        u, v = right[known], down[known]
        bend = 0.5 * (duty / 2) ** 2 * (right_bend[known] + down_bend[known])
        start = p = coarse[known] + bend
        color = _color_direction(image, p, u, v)
        for _ in range(ROUNDS):
            p = p + _offset(image, color, p, u, v, duty)[:, None] * u + _offset(image, color, p, v, u, duty)[:, None] * v
        moved = np.linalg.norm(p - start, axis=-1)
        near = moved < FARTHEST * np.minimum(np.linalg.norm(u, axis=-1), np.linalg.norm(v, axis=-1))
        position[known] = np.where(near[:, None], p - bend, np.nan)
        sigma[known] = 0.05
    return Centres(position, sigma)


def _derivatives(position: FloatArray, joined: BoolArray, axis: int) -> tuple[FloatArray, FloatArray]:
    """First and second difference of positions along a grid axis; one-sided, and no bend, at the ends of a surface."""
    step = np.where(joined[..., None], np.diff(position, axis=axis), np.nan)
    end = np.full_like(np.take(position, [0], axis=axis), np.nan)
    forward, backward = np.concatenate([step, end], axis=axis), np.concatenate([end, step], axis=axis)
    one_sided = np.where(np.isfinite(forward), forward, backward)
    both = np.isfinite(forward + backward)
    slope = np.where(both, (forward + backward) / 2, one_sided)
    bend = np.where(both, forward - backward, 0.0)
    # A crease is no curvature.
    sharp = ~(np.linalg.norm(bend, axis=-1) < CREASE * np.linalg.norm(slope, axis=-1))
    return slope, np.where(sharp[..., None], 0.0, bend)


def _sample(image: Image, at: FloatArray) -> NDArray[np.float32]:
    maps = at.astype(np.float32)
    shape = maps.shape[:-1]
    flat = maps.reshape(shape[0], -1, 2)
    out = cv2.remap(image, flat[..., 0], flat[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return cast(NDArray[np.float32], np.asarray(out, dtype=np.float32).reshape(*shape, 3))


def _color_direction(image: Image, p: FloatArray, u: FloatArray, v: FloatArray) -> NDArray[np.float32]:
    """Weights (N, 3) that make one number of a colour: most where block and gaps differ most."""
    gaps = np.stack([p + u / 2, p - u / 2, p + v / 2, p - v / 2, p], axis=1)
    seen = _sample(image, gaps)
    added = np.maximum(seen[:, 4] - seen[:, :4].min(axis=1), 0)
    return added / np.maximum(added.sum(axis=1, keepdims=True), 1e-6)


def _offset(
    image: Image, color: NDArray[np.float32], p: FloatArray, u: FloatArray, v: FloatArray, duty: float
) -> FloatArray:
    """How far along u, in pitches, the middle between the two sides of each block is from p.

    A side lies where the area under its profile says: among samples from inside to outside, levels taken at
    the two ends, it is off the middle of the window by (mean height - 1/2) of the window's length.
    Areas do not care how the sides are blurred, nor where a colour mosaic happens to sample them.
    """
    window = WINDOW * min(1 - duty, duty) / 2
    t = np.linspace(-window, window, SAMPLES)
    s = np.linspace(-0.5, 0.5, LINES) * duty * SPREAD
    across = np.concatenate([duty / 2 + t, -(duty / 2 + t)])
    at = p[:, None, None] + across[:, None, None] * u[:, None, None] + s[:, None] * v[:, None, None]
    profile = np.einsum("ntlc,nc->nt", _sample(image, at), color).reshape(len(p), 2, SAMPLES).astype(np.float64) / LINES
    inside, outside = profile[..., 0], profile[..., -1]
    height = profile.mean(axis=-1) - outside
    edge = (height / np.maximum(inside - outside, 1e-6) - 0.5) * 2 * window
    return np.clip((edge[:, 0] - edge[:, 1]) / 2, -window, window)
