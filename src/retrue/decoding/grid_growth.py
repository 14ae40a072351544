"""Where a surface goes on: the picture is asked for the blocks that the blobs did not give."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from retrue.decoding.grid_colors import Colors, local_level
from retrue.decoding.grid_surface import Joints, shifted, slopes
from retrue.geometry.arrays import BoolArray, FloatArray, Image, IntArray

SIDES = ((0, 1), (1, 0), (0, -1), (-1, 0))  # (down, right), in the order right, down, left, up
ROUNDS = 8
SAMPLES = 17  # along a side of a patch
REACH = 0.56  # pitches from the middle of a patch to its sides
FARTHEST = 0.06  # pitches from where the surface would have the block
STRETCH = 0.2  # of its sides
SKEW = 0.12  # pitches
UNEVEN = 0.3  # of the step from block to gap, within the block
SIDE_RANGE = 0.13  # pitches within which a side is looked for
APART = 0.5  # pitches, least distance between two blocks


@dataclass(frozen=True, slots=True, eq=False)
class Patches:
    """What the picture shows at N predicted blocks.

    Attributes
    ----------
    light : (N, 3) what the middle of the block adds to the darkest place of its pitch.
    offset : (N, 2) of the block from the prediction, along u and v in pitches; NaN where a side is missing.
    stretch : (N, 2) width and height over the expected ones, minus one.
    skew : (N,) largest distance between the two halves of one side, in pitches.
    uneven : (N,) 90th percentile of the distance from the middle's colour, in steps from block to gap.
    """

    light: FloatArray
    offset: FloatArray
    stretch: FloatArray
    skew: FloatArray
    uneven: FloatArray

    def whole(self) -> BoolArray:
        """(N,) whether there is one block, all of it, where it should be."""
        near = np.abs(self.offset).max(axis=1) < FARTHEST
        return near & (self.skew < SKEW) & (np.abs(self.stretch).max(axis=1) < STRETCH) & (self.uneven < UNEVEN)


def look_at(picture: Image, p: FloatArray, u: FloatArray, v: FloatArray, duty: float) -> Patches:
    """Blocks at p (N, 2) with pitches u and v; a side is where the colour turns half way into another one.

    The other colour is that of the gap, or of whatever hides the gap: only the block's own colour is known.
    """
    t = np.linspace(-REACH, REACH, SAMPLES)
    at = p[:, None, None] + t[:, None, None] * v[:, None, None] + t[:, None] * u[:, None, None]
    x, y = np.moveaxis(at.reshape(len(at), -1, 2), -1, 0).astype(np.float32)
    seen = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    patch = np.asarray(seen, dtype=np.float32).reshape(len(p), SAMPLES, SAMPLES, 3)

    def within(share: float) -> IntArray:
        return np.flatnonzero(np.abs(t) < share * duty / 2)

    middle, core = within(0.55), within(0.75)
    first, second = np.flatnonzero((t < 0) & (t > -0.4 * duty)), np.flatnonzero((t > 0) & (t < 0.4 * duty))
    color = np.median(patch[:, middle][:, :, middle].reshape(len(p), -1, 3), axis=1)
    light = np.maximum(color - patch.reshape(len(p), -1, 3).min(axis=1), 0)
    step = np.maximum(np.linalg.norm(light, axis=1), 1e-6)[:, None]
    inside = np.linalg.norm(patch[:, core][:, :, core] - color[:, None, None], axis=-1).reshape(len(p), -1) / step
    along_u = [patch[:, lines].mean(axis=1) for lines in (first, second)]
    along_v = [patch[:, :, lines].mean(axis=2) for lines in (first, second)]
    lines = np.stack([*along_u, *along_v], axis=1)
    change = np.linalg.norm(lines - color[:, None, None], axis=-1) / step[..., None]
    half = SAMPLES // 2
    ahead, behind = change[..., half:], change[..., half::-1]
    sides = np.stack([_side(ahead, t[half:], duty), _side(behind, t[half:], duty)]).reshape(2, len(p), 2, 2)
    after, before = sides.mean(axis=-1)
    skew = np.abs(sides[..., 0] - sides[..., 1]).max(axis=(0, 2))
    return Patches(light, (after - before) / 2, (after + before) / duty - 1, skew, np.percentile(inside, 90, axis=1))


def _side(change: FloatArray, t: FloatArray, duty: float) -> FloatArray:
    """Where profiles (N, M, T), at t >= 0 from the middle outwards, rise half way to another colour; NaN: nowhere."""
    inside = change[..., t < 0.6 * duty / 2].mean(axis=-1)
    outside = change[..., t > duty / 2].max(axis=-1)
    level = (inside + outside)[..., None] / 2
    first = np.argmax(change > level, axis=-1)[..., None]
    last = np.maximum(first - 1, 0)
    a, b = np.take_along_axis(change, last, -1), np.take_along_axis(change, first, -1)
    side = (t[last] + (t[1] - t[0]) * np.clip((level - a) / np.maximum(b - a, 1e-6), 0, 1))[..., 0]
    there = (first[..., 0] > 0) & (outside > 0.5) & (outside > 2 * inside) & (np.abs(side - duty / 2) < SIDE_RANGE)
    return np.where(there, side, np.nan)


@dataclass(frozen=True, slots=True, eq=False)
class Grown:
    """`position` (rows, columns, 2) with the blocks that were added, their `joints`, and which are `new`."""

    position: FloatArray
    joints: Joints
    amounts: FloatArray
    new: BoolArray


def grow(
    picture: Image, position: FloatArray, joints: Joints, amounts: FloatArray, colors: Colors, code: IntArray, duty: float
) -> Grown:
    """Blocks beside those that are held, added where the picture shows a whole one of the right colour.

    `position` (rows, columns, 2) in pixels of `picture`, `amounts` (rows, columns, 3) of the projector's colours, NaN
    where no block is held. Each block predicts its four neighbours by its own steps; what is found there
    predicts the next ones.
    """
    position, amounts = position.copy(), amounts.copy()
    right, down = joints.right.copy(), joints.down.copy()
    held = np.isfinite(position[..., 0])
    start, fresh = held.copy(), held
    for _ in range(ROUNDS):
        u, v, _ = slopes(position, Joints(right, down))
        able = fresh & np.isfinite(u + v).all(axis=-1)
        steps = np.array(SIDES)
        source = np.argwhere(able[..., None] & ~np.stack([shifted(held, step, True) for step in SIDES], axis=-1))
        side, source = source[:, 2], source[:, :2]
        target = source + steps[side]
        if not len(target):
            break
        r, c = source.T
        su, sv = u[r, c], v[r, c]
        p = position[r, c] + steps[side][:, :1] * sv + steps[side][:, 1:] * su
        found = look_at(picture, p, su, sv, duty)
        own = colors.amounts(found.light)
        around = np.concatenate([_neighbours(amounts, source), own[:, None]], axis=1)
        label, _ = colors.nearest(own, local_level(np.nan_to_num(around)))
        good = found.whole() & (label == code[target[:, 0], target[:, 1]])
        p = p + found.offset[:, :1] * su + found.offset[:, 1:] * sv
        pitch = np.minimum(np.linalg.norm(su, axis=1), np.linalg.norm(sv, axis=1))
        good = np.flatnonzero(good)
        good = good[_apart(p[good], APART * pitch[good], target[good] @ [code.shape[1], 1], position[held])]
        if not len(good):
            break
        fresh = np.zeros_like(held)
        r, c = target[good].T
        position[r, c], amounts[r, c] = p[good], own[good]
        fresh[r, c] = held[r, c] = True
        for k, (dr, dc) in enumerate(SIDES):
            r, c = np.minimum(source, target)[good[side[good] == k]].T
            (right if dc else down)[r, c] = True
    return Grown(position, Joints(right, down), amounts, held & ~start)


def _neighbours(amounts: FloatArray, cell: IntArray) -> FloatArray:
    """(N, 9, 3) amounts in the 3x3 blocks about each cell (N, 2)."""
    padded = np.pad(amounts, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
    return np.stack([padded[cell[:, 0] + r, cell[:, 1] + c] for r in range(3) for c in range(3)], axis=1)


def _apart(p: FloatArray, least: FloatArray, cell: IntArray, held: FloatArray) -> BoolArray:
    """(N,) whether each point is `least` or more from all held ones, and from all points of other cells.

    Points of one and the same cell must be close instead.
    """
    from scipy.spatial import KDTree

    good = KDTree(held).query(p)[0] > least
    between = np.linalg.norm(p[:, None] - p, axis=-1)
    same = cell[:, None] == cell
    return good & np.where(same, between < 0.3 * least[:, None], between > least[:, None]).all(axis=1)
