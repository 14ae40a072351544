"""Where a surface goes on: the picture is asked for the blocks that the blobs did not give."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.decoding.blocks.colors import Colors, local_level
from retrue.decoding.blocks.nearest import nearest
from retrue.decoding.blocks.patches import look_at
from retrue.decoding.blocks.surface import Joints, shifted, slopes
from retrue.geometry.arrays import BoolArray, FloatArray, Image, IntArray

SIDES = ((0, 1), (1, 0), (0, -1), (-1, 0))  # (down, right), in the order right, down, left, up
ROUNDS = 8
MISFIT = 1.25  # most of a new block: wrong ones reached down to 1.6
CUT_MISFIT = 2.0  # most of a block that its colours placed
DOUBT = 0.017  # pitches that a new block of misfit 1 is off, one standard deviation
APART = 0.5  # pitches, least distance between two blocks


@dataclass(frozen=True, slots=True, eq=False)
class Surfaces:
    """The blocks that are decoded; (rows, columns, ...) of the code, NaN where there is none.

    Attributes
    ----------
    position : (rows, columns, 2) of the centres, in pixels of the picture.
    light : (rows, columns, 3) what each block adds to its surroundings.
    doubt : (rows, columns) px, what each centre may be off beyond noise, one standard deviation.
    misfit : (rows, columns) of the blocks that growth added, see `Patches`; NaN of all others.
    joints : which of them are neighbours on one surface.
    """

    position: FloatArray
    light: FloatArray
    doubt: FloatArray
    misfit: FloatArray
    joints: Joints

    @property
    def held(self) -> BoolArray:
        return np.isfinite(self.position[..., 0])


def cut_blocks(picture: Image, position: FloatArray, joints: Joints, duty: float) -> BoolArray:
    """(rows, columns) blocks at the rim of their surface that are not all there, or not where they were measured."""
    u, v, _ = slopes(position, joints)
    rim = np.isfinite(position[..., 0]) & ~joints.inside()
    cut = rim & ~np.isfinite(u + v).all(axis=-1)
    rim &= ~cut
    cut[rim] = ~(look_at(picture, position[rim], u[rim], v[rim], duty).misfit() < CUT_MISFIT)
    return cut


def grow(
    picture: Image, gain: float, surfaces: Surfaces, fresh: BoolArray, colors: Colors, code: IntArray, duty: float
) -> Surfaces:
    """`surfaces`, and the blocks beside them where the picture shows a whole one of the right colour.

    Each `fresh` block (rows, columns) predicts its four neighbours by its own steps; what is found there predicts the
    next ones. `gain` times what the picture shows is `light`.
    """
    position, light = surfaces.position.copy(), surfaces.light.copy()
    doubt, misfit = surfaces.doubt.copy(), surfaces.misfit.copy()
    right, down = surfaces.joints.right.copy(), surfaces.joints.down.copy()
    held = surfaces.held
    for _ in range(ROUNDS):
        u, v, _ = slopes(position, Joints(right, down))
        able = fresh & np.isfinite(u + v).all(axis=-1)
        ahead = np.argwhere(able[..., None] & ~np.stack([shifted(held, side, True) for side in SIDES], axis=-1))
        if not len(ahead):
            break
        source, side = ahead[:, :2], ahead[:, 2]
        step = np.array(SIDES)[side]
        target = source + step
        r, c = source.T
        u, v = u[r, c], v[r, c]
        p = position[r, c] + step[:, :1] * v + step[:, 1:] * u
        found = look_at(picture, p, u, v, duty)
        unlike, seen = found.misfit(), gain * found.light
        label = _labels(colors, seen, light, source)
        good = np.flatnonzero((unlike < MISFIT) & (label == code[target[:, 0], target[:, 1]]))
        p = p + found.offset[:, :1] * u + found.offset[:, 1:] * v
        pitch = np.minimum(np.linalg.norm(u, axis=1), np.linalg.norm(v, axis=1))
        good = good[_apart(p[good], APART * pitch[good], target[good] @ [code.shape[1], 1], position[held])]
        if not len(good):
            break
        r, c = target[good].T
        position[r, c], light[r, c], misfit[r, c] = p[good], seen[good], unlike[good]
        doubt[r, c] = DOUBT * pitch[good] * np.sqrt(unlike[good])
        fresh = np.zeros_like(held)
        fresh[r, c] = held[r, c] = True
        for k, (_, along) in enumerate(SIDES):
            r, c = np.minimum(source, target)[good[side[good] == k]].T
            (right if along else down)[r, c] = True
    return Surfaces(position, light, doubt, misfit, Joints(right, down))


def _labels(colors: Colors, seen: FloatArray, light: FloatArray, source: IntArray) -> IntArray:
    """Colour index (N,) of `seen` light (N, 3), by the level of the blocks about each `source` (N, 2)."""
    padded = np.pad(light, ((1, 1), (1, 1), (0, 0)))
    around = [padded[source[:, 0] + r, source[:, 1] + c] for r in range(3) for c in range(3)]
    amounts = colors.amounts(np.nan_to_num(np.stack([*around, seen], axis=1)))
    return colors.nearest(amounts[:, -1], local_level(amounts))[0]


def _apart(p: FloatArray, least: FloatArray, cell: IntArray, held: FloatArray) -> BoolArray:
    """(N,) whether each point is `least` or more from all held ones, and from all points of other cells.

    Points of one and the same cell must be close instead.
    """
    apart = nearest(held, p)[0] > least
    between: FloatArray = np.linalg.norm(p[:, None] - p, axis=-1)
    same = cell[:, None] == cell
    right = np.where(same, between < 0.3 * least[:, None], between > least[:, None])
    return apart & np.asarray(right.all(axis=1))
