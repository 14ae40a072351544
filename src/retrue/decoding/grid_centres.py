"""The image of each block's centre, to a small part of a pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from retrue.geometry.arrays import BoolArray, FloatArray, Image

SAMPLES = 25  # along a profile that reaches from the middle of one gap to the middle of the next
LINES = 5  # profiles side by side, over the middle of the block
SPREAD = 0.55  # of the block that the lines cover


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


def refine_centres(image: Image, coarse: FloatArray, duty: float) -> Centres:
    """Centres (rows, columns, 2) from the four sides of each block, starting from `coarse` (NaN: no block).

    Along each axis of the grid the block's profile falls to half its height at two sides; their middle is the
    centre in affine approximation, however blurred the sides are. Perspective bends the scale: positions
    are x(u) = x0 + a u + b u^2 / 2 in grid units, so the middle of u = -h and u = +h lies b h^2 / 2 off x0; b comes
    from the neighbours. `duty` is block over pitch.
    """
    position = coarse
    for _ in range(2):
        right, right_bend = _derivatives(position, axis=1)
        down, down_bend = _derivatives(position, axis=0)
        known = np.isfinite(right[..., 0]) & np.isfinite(down[..., 0]) & np.isfinite(position[..., 0])
        p, u, v = position[known], right[known], down[known]
        color = _color_direction(image, p, u, v)
        along_u, spread_u = _middle(image, color, p, u, v, duty)
        along_v, spread_v = _middle(image, color, p, v, u, duty)
        bend = 0.5 * (duty / 2) ** 2
        lines = bend * SPREAD**2 / 3 * 1.5
        shift = along_u[:, None] * u + along_v[:, None] * v
        position = np.full_like(coarse, np.nan)
        position[known] = p + shift - bend * (right_bend[known] + down_bend[known])
    sigma = np.full(coarse.shape[:2], np.nan)
    sigma[known] = 0.05
    return Centres(position, sigma)


def _derivatives(position: FloatArray, axis: int) -> tuple[FloatArray, FloatArray]:
    """First and second difference of positions along a grid axis; one-sided, and no bend, at borders."""
    pad = [(0, 0)] * 3
    pad[axis] = (1, 1)
    padded = np.pad(position, pad, constant_values=np.nan)
    size = position.shape[axis]
    before = np.take(padded, np.arange(size), axis=axis)
    after = np.take(padded, np.arange(size) + 2, axis=axis)
    forward, backward = after - position, position - before
    slope = np.where(np.isfinite(forward), np.where(np.isfinite(backward), (forward + backward) / 2, forward), backward)
    bend = np.where(np.isfinite(forward + backward), forward - backward, 0.0)
    # A crease or a step is no curvature.
    steep = np.linalg.norm(bend, axis=-1) > 0.1 * np.linalg.norm(slope, axis=-1)
    return slope, np.where(steep[..., None], 0.0, bend)


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


def _middle(
    image: Image, color: NDArray[np.float32], p: FloatArray, u: FloatArray, v: FloatArray, duty: float
) -> tuple[FloatArray, FloatArray]:
    """Offset along u, in pitches, of the middle between the two half-height crossings, and block width."""
    t = np.linspace(-0.5, 0.5, SAMPLES)
    s = np.linspace(-0.5, 0.5, LINES) * duty * SPREAD
    at = p[:, None, None] + t[:, None, None] * u[:, None, None] + s[:, None] * v[:, None, None]
    profile = np.einsum("ntlc,nc->nt", _sample(image, at), color) / LINES
    middle = SAMPLES // 2
    top = profile[:, middle - 2 : middle + 3].mean(axis=1)
    right = _crossing(profile[:, middle:], top)
    left = _crossing(profile[:, middle::-1], top)
    spacing = t[1] - t[0]
    return (right - left) / 2 * spacing, (right + left) * spacing


def _crossing(profile: NDArray[np.float32], top: NDArray[np.float32]) -> FloatArray:
    """Samples from the middle of the block to where its profile first falls to half of its height."""
    level = (top + profile.min(axis=1)) / 2
    below = profile < level[:, None]
    below[:, 0] = False
    first = np.maximum(np.argmax(below, axis=1), 1)
    rows = np.arange(len(profile))
    inner, outer = profile[rows, first - 1], profile[rows, first]
    fraction = (inner - level) / np.maximum(inner - outer, 1e-6)
    return np.where(below.any(axis=1), first - 1 + np.clip(fraction, 0, 1), np.nan).astype(np.float64)
