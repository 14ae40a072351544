"""Where a surface goes on: is there a whole block, and where exactly? The picture is asked at that very place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.decoding.blocks.colors import Colors, local_level
from retrue.decoding.blocks.links import NONE
from retrue.decoding.surface import Joints, lengths, median, slopes
from retrue.geometry.arrays import BoolArray, FloatArray, Image, IntArray
from retrue.geometry.nearest import nearest
from retrue.kernels import patches as kernel
from retrue.kernels import profiles as profile_kernel

SIDES = ((0, 1), (1, 0), (0, -1), (-1, 0))  # (down, right), in the order right, down, left, up
ROUNDS = 8
MISFIT = 1.25  # most of a new block: wrong ones reached down to 1.6
CUT_MISFIT = 2.0  # most of a block that its colours placed
DOUBT = 0.017  # pitches that a block of misfit 1 is off, one standard deviation
APART = 0.5  # pitches, least distance between two blocks
SAMPLES = 15  # along a side of a patch
SPACING = 0.56 / 7  # pitches between them: a patch ends beyond the gap
FARTHEST = 0.06  # pitches from where the surface would have the block
STRETCH = 0.25  # of its sides
SKEW = 0.12  # pitches
UNEVEN = 0.3  # of the step from block to gap, within the block


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

    def misfit(self) -> FloatArray:
        """(N,) how unlike one whole block, where it should be, each is: sum of squares over their usual limits.

        NaN where a side is missing.
        """
        offset, stretch = _larger(self.offset) / FARTHEST, _larger(self.stretch) / STRETCH
        return offset**2 + stretch**2 + (self.skew / SKEW) ** 2 + (self.uneven / UNEVEN) ** 2


def _larger(pairs: FloatArray) -> FloatArray:
    return np.maximum(np.abs(pairs[:, 0]), np.abs(pairs[:, 1]))


def readable(picture: Image) -> tuple[Image, int, int, FloatArray]:
    """`picture` (h, w, 3) as kernels read it: its pixels in a row, height, width, and the number of each value."""
    height, width, _ = picture.shape
    return picture.reshape(-1), height, width, np.arange(256.0**picture.itemsize)


def look_at(picture: Image, p: FloatArray, u: FloatArray, v: FloatArray, duty: float) -> Patches:
    """Blocks at p (N, 2) with pitches u and v; a side is where the colour turns half way into another one.

    The other colour is that of the gap, or of whatever hides the gap: only the block's own colour is known.
    """
    patches, found = np.empty((len(p), SAMPLES, SAMPLES, 3)), np.empty((len(p), 9))
    profile_kernel.read_patches(*readable(picture), p, u, v, SPACING, patches)
    kernel.look_at_patches(patches, SPACING, duty, np.empty(SAMPLES**2), found)
    return Patches(found[:, :3], found[:, 3:5], found[:, 5:7], found[:, 7], found[:, 8])


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


def look_again(
    picture: Image, position: FloatArray, joints: Joints, unlike: BoolArray, duty: float
) -> tuple[BoolArray, FloatArray]:
    """Measured blocks (rows, columns) that are cut: at the rim of their surface, and not all there, or not where they
    were measured. And what the centres of those and of the `unlike` may be off by their look, one sigma in px; 0 of
    the others.

    What makes a block unlike a whole one, such as an edge, a crease or a print through it, moves its centre alike.
    """
    u, v = slopes(position, joints)
    held = np.isfinite(position[..., 0])
    rim = held & ~joints.inside()
    known = (rim | unlike) & np.isfinite(u[..., 0] + v[..., 0])
    misfit = np.where(held & (rim | unlike), CUT_MISFIT, 0.0)
    misfit[known] = np.fmin(look_at(picture, position[known], u[known], v[known], duty).misfit(), CUT_MISFIT)
    pitch = np.minimum(lengths(u), lengths(v))
    usual = median(pitch[known]) if known.any() else 0.0
    return rim & ~(misfit < CUT_MISFIT), DOUBT * np.where(known, pitch, usual) * misfit


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
        u, v = slopes(position, Joints(right, down))
        source, side = _ahead(fresh & np.isfinite(u[..., 0] + v[..., 0]), held)
        if not len(source):
            break
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
        pitch = np.minimum(lengths(u), lengths(v))
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


def _ahead(able: BoolArray, held: BoolArray) -> tuple[IntArray, IntArray]:
    """(row, column) (N, 2) of the `able` blocks, and the side (N,) on which each has none that is `held`."""
    rows, columns = held.shape
    padded = np.ones((rows + 2, columns + 2), dtype=bool)  # nothing is missing outside the code
    padded[1:-1, 1:-1] = held
    beside = [padded[1 + down : 1 + down + rows, 1 + right : 1 + right + columns] for down, right in SIDES]
    row, column, side = np.nonzero(able[..., None] & ~np.stack(beside, axis=-1))
    return np.stack([row, column], axis=-1), side


def _labels(colors: Colors, seen: FloatArray, light: FloatArray, source: IntArray) -> IntArray:
    """Colour index (N,) of `seen` light (N, 3), by the level of the blocks about each `source` (N, 2)."""
    rows, columns, _ = light.shape
    index = np.full((rows + 2, columns + 2), NONE)
    index[1:-1, 1:-1] = np.arange(rows * columns).reshape(rows, columns)
    around = [index[source[:, 0] + r, source[:, 1] + c] for r in range(3) for c in range(3)]
    itself = rows * columns + np.arange(len(seen))
    amounts = colors.amounts(np.concatenate([light.reshape(-1, 3), seen]))  # NaN is no brightest one
    return colors.nearest(amounts[itself], local_level(amounts, np.stack([*around, itself], axis=-1)))[0]


def _apart(p: FloatArray, least: FloatArray, block: IntArray, held: FloatArray) -> BoolArray:
    """(N,) whether each point is `least` or more from all held ones, and from all points of other blocks.

    Points of one and the same block must be close instead.
    """
    apart = nearest(held, p)[0] > least
    between = lengths(p[:, None] - p)
    same = block[:, None] == block
    right = np.where(same, between < 0.3 * least[:, None], between > least[:, None])
    return apart & np.asarray(right.all(axis=1))
