"""Where a surface goes on: the picture is asked for the blocks that the blobs did not give."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.decoding.grid_colors import Colors, local_level
from retrue.decoding.grid_patches import look_at
from retrue.decoding.grid_surface import Joints, shifted, slopes
from retrue.geometry.arrays import BoolArray, FloatArray, Image, IntArray

SIDES = ((0, 1), (1, 0), (0, -1), (-1, 0))  # (down, right), in the order right, down, left, up
ROUNDS = 8
MISFIT = 1.25  # most of a new block: wrong ones reached down to 1.6
CUT_MISFIT = 2.0  # most of a block that its colours placed
APART = 0.5  # pitches, least distance between two blocks


def cut_blocks(picture: Image, position: FloatArray, joints: Joints, duty: float) -> BoolArray:
    """(rows, columns) blocks at the rim of their surface that are not all there, or not where they were measured."""
    u, v, _ = slopes(position, joints)
    held = np.isfinite(position[..., 0])
    rim = held & ~joints.inside()
    cut = rim & ~np.isfinite(u + v).all(axis=-1)
    rim &= ~cut
    cut[rim] = ~(look_at(picture, position[rim], u[rim], v[rim], duty).misfit() < CUT_MISFIT)
    return cut


@dataclass(frozen=True, slots=True, eq=False)
class Grown:
    """`position` (rows, columns, 2) with the blocks that were added, their `joints`, and which are `new`."""

    position: FloatArray
    joints: Joints
    amounts: FloatArray
    new: BoolArray


def grow(
    picture: Image,
    position: FloatArray,
    joints: Joints,
    amounts: FloatArray,
    fresh: BoolArray,
    colors: Colors,
    code: IntArray,
    duty: float,
) -> Grown:
    """Blocks beside those that are held, added where the picture shows a whole one of the right colour.

    `position` (rows, columns, 2) in pixels of `picture`, `amounts` (rows, columns, 3) of the projector's colours, NaN
    where no block is held. Each `fresh` block predicts its four neighbours by its own steps; what is found there
    predicts the next ones.
    """
    position, amounts = position.copy(), amounts.copy()
    right, down = joints.right.copy(), joints.down.copy()
    held = np.isfinite(position[..., 0])
    start = held.copy()
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
        good = (found.misfit() < MISFIT) & (label == code[target[:, 0], target[:, 1]])
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
