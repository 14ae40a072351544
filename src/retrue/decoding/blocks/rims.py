"""Blocks at the rim of a surface, of which an edge may have cut a part: placed by the side that it cannot have cut.

What an edge takes from a block, it takes where the surface ends. The side towards a neighbour is whole, and half a
block from there lies the centre; the middle of both sides lies further in, by half of what is missing. There are two
explanations of how far apart, d, the two places are. The block is whole, and d is noise. Or it is cut, and d is up to a
quarter of a pitch. Both are as likely before anything is seen: the centre moves by what is expected of d.

Where a surface is one block wide, or nothing tells which side is cut, the block stays, and half of what it lacks is its
doubt. Beside a cut that runs aslant, the other two sides are read on that half of them which is further from it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from retrue.decoding.blocks.centres import CHANNEL_TRUST, SIDE_LINES, beside, off_centre, side_window
from retrue.decoding.blocks.growth import Surfaces, readable
from retrue.decoding.surface import Joints, bends_of, lengths, median, slopes
from retrue.geometry.arrays import BoolArray, FloatArray, Image, IntArray
from retrue.kernels import profiles as kernel

ROUNDS = 6
"""Of placing a block by its step, and measuring that step by the place: each halves what is left."""
AMPLIFIED = 2.7
"""Noise of such a place, of that of one side beside the middle of both: sqrt(2) of the side alone, and 1.9 as the step
at a rim is 1.5 times the place, of which half a block is 0.32."""
CHANGE_OF_BEND = 0.1
"""Pitches that a place is off on a surface that bends by one pitch a block: bends change by a third a block there."""
MOST = 0.25  # pitches that a cut moves the middle of a block
CERTAIN = 1.5  # times its noise: nearer to the middle of both sides than that, a whole side says that nothing is cut
ENOUGH = 300  # blocks that tell the noise
LEAST_NOISE = 5e-4  # pitches, of a drawing that has none


def at_rims(picture: Image, surfaces: Surfaces, duty: float) -> Surfaces:
    """`surfaces` with the blocks at rims moved outwards as far as they seem cut, and what is left in doubt then.

    The noise of one side is told by blocks inside, where both have one middle.
    """
    position, joints = surfaces.position, surfaces.joints
    before, after = joints.linked()
    outward = before.astype(np.float64) - after
    sides = _Sides.of(picture, position, joints, outward, duty)
    inside, rim = sides.known & joints.inside(), sides.known & ~joints.inside()
    if not (inside.any() and rim.any()):
        return surfaces
    told, rows = np.flatnonzero(inside)[:: max(1, int(inside.sum()) // ENOUGH)], np.flatnonzero(rim)
    apart, steps = sides.apart(position, np.append(told, rows))
    noise = max(median(np.abs(apart[: len(told)]).ravel()) / 0.6745, LEAST_NOISE)

    outward = outward.reshape(-1, 2)
    maybe = _may_be_cut(apart[len(told) :], outward[rows], noise)
    apart, steps = apart[len(told) :][maybe], steps[len(told) :][maybe]
    rows, outward = rows[maybe], outward[rows[maybe]]
    shift, near = np.zeros((len(rows), 2, 2)), np.ones((len(rows), 2), dtype=np.bool_)
    farthest, moved = MOST * lengths(steps), position
    for _ in range(ROUNDS):
        by_side: FloatArray = np.where(outward > 0, apart[..., 0], apart[..., 1])
        off: FloatArray = np.where(outward != 0, by_side, apart.mean(axis=-1))
        shift += off[..., None] * steps
        near &= lengths(shift) < farthest  # no cut moves a block further: it stays, and its step is none to others
        shift[~near] = 0.0
        moved = _with_rows(position, rows, shift[:, 0] + shift[:, 1])
        apart, steps = sides.apart(moved, rows)
    pitches = lengths(steps)
    bend = lengths(bends_of(rows, moved, joints)) / pitches
    sigma = np.hypot(AMPLIFIED * noise, CHANGE_OF_BEND * bend)
    alone = ~(before | after).reshape(-1, 2)[rows]
    lack: FloatArray = (apart[..., 0] - apart[..., 1]) / 2
    d: FloatArray = np.where(alone, lack, outward * (shift * steps).sum(axis=-1) / pitches**2)
    whole: FloatArray = np.exp(-0.5 * (d / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi))
    cut: FloatArray = np.where((d > 0) & (d < MOST), 1 / (1 + MOST * whole), 0.0)
    most = cut.max(axis=-1)
    share: FloatArray = np.where(outward != 0, cut, most[..., None])
    variance = share * sigma**2 + cut * np.where(alone, 1.0, 1 - cut) * d**2
    doubt = surfaces.doubt.copy()
    doubt.flat[rows] = np.sqrt((variance * pitches**2).sum(axis=-1) + (1 - most) * doubt.flat[rows] ** 2)
    return replace(surfaces, position=_with_rows(position, rows, (share[..., None] * shift).sum(axis=1)), doubt=doubt)


def _with_rows(position: FloatArray, rows: IntArray, shift: FloatArray) -> FloatArray:
    """(rows, columns, 2) the places, some of them shifted."""
    moved = position.reshape(-1, 2).copy()
    moved[rows] += shift
    return moved.reshape(position.shape)


def _may_be_cut(apart: FloatArray, outward: FloatArray, noise: float) -> BoolArray:
    """(N,) blocks that some side has further out than noise makes it."""
    before, after = apart[..., 0], apart[..., 1]
    off: FloatArray = np.where(outward > 0, before, np.where(outward < 0, -after, (before - after) / 2))
    return np.asarray((off > CERTAIN * noise).any(axis=-1), dtype=np.bool_)


@dataclass(frozen=True, slots=True, eq=False)
class _Sides:
    """How single sides of blocks are read.

    Attributes
    ----------
    outward : (rows, columns, 2) 1 where the surface ends after a block, -1 where before it, 0 where both or neither.
    known : (rows, columns) blocks whose steps to their neighbours are known.
    weights : (rows columns, 3) what makes one number of a colour of each block.
    """

    picture: Image
    joints: Joints
    outward: FloatArray
    duty: float
    known: BoolArray
    weights: FloatArray

    @classmethod
    def of(cls, picture: Image, position: FloatArray, joints: Joints, outward: FloatArray, duty: float) -> _Sides:
        right, down = slopes(position, joints)
        known = np.isfinite(position[..., 0] + right[..., 0] + down[..., 0])
        weights = np.zeros((known.size, 3))
        there = position.reshape(-1, 2), right.reshape(-1, 2), down.reshape(-1, 2)
        kernel.weigh_channels(*readable(picture), *there, CHANNEL_TRUST, weights)
        return cls(picture, joints, outward, duty, known, weights)

    def apart(self, position: FloatArray, blocks: IntArray) -> tuple[FloatArray, FloatArray]:
        """(N, 2, 2) pitches along the row and the column from `position` to where N blocks are by the side before and
        by that after; and those pitches (N, 2, 2) themselves.

        At a rim the step from the only neighbour is that of half a step before.
        """
        bend = bends_of(blocks, position, self.joints)
        outward, there = self.outward.reshape(-1, 2), np.ascontiguousarray(position).reshape(-1, 2)
        right, down = (slope.reshape(-1, 2) for slope in slopes(position, self.joints))
        steps = np.stack([right[blocks], down[blocks]], axis=1) + outward[blocks][..., None] * bend / 2
        right[blocks], down[blocks] = steps[:, 0], steps[:, 1]
        s, t = beside(SIDE_LINES, self.duty), np.append(0.0, side_window(self.duty))
        shift, apart = np.empty((len(there), 4)), np.zeros((len(there), 4))
        shift[blocks] = off_centre(bend, self.duty, s).reshape(-1, 4)
        where = blocks, right, down, shift, outward, np.empty(len(t))
        lines = t, s, (s + s[-1]) / 2
        kernel.fit_single_sides(*readable(self.picture), *lines, self.weights, *where, there, apart)
        return apart[blocks].reshape(-1, 2, 2), steps
