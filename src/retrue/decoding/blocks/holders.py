"""Which blob holds which block of the code, before anything is measured: evidence, and what surfaces allow."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from retrue.decoding.blocks.blobs import Blocks
from retrue.decoding.blocks.links import NONE, Links
from retrue.decoding.blocks.places import Code
from retrue.decoding.blocks.sight import Verdict
from retrue.decoding.surface import Joints, in_squares, sound_joints, whole_blocks
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.kernels import places as kernel

SIGNIFICANCE = 28.0  # nats by which a surface must beat chance; pictures of other grids reach 22
SURROUNDED = 5  # agreeing neighbours of eight, from which on a block's own colour need not be beyond doubt
LEAST_AGREEING = 3  # of all other blocks, which may also have one neighbour whose colour is clearly another


def held_by(holder: IntArray, values: NDArray[Any], fill: float) -> NDArray[Any]:
    """`values` (N, ...) of the blob that holds each block (rows, columns), `fill` where none does."""
    if not len(values):
        return np.full((*holder.shape, *values.shape[1:]), fill, dtype=values.dtype)
    result = values.take(holder, axis=0, mode="wrap")
    result[holder < 0] = fill
    return result


def hold_places(
    code: Code, blocks: Blocks, links: Links, label: IntArray, clear: BoolArray, place: IntArray
) -> tuple[IntArray, IntArray, Joints]:
    """A verdict (N,) on each blob, the blob that holds each block (rows, columns) or -1, and their joints.

    Of two blobs in one place, the one on the surer surface holds it. Blobs whose neighbours' colours speak against
    them hold none, nor those whose size, or distance from their neighbours, is not their surface's.
    """
    right = label == code.color(place)
    nats = _surface_evidence(code, links, right, place)
    verdict = np.full(len(place), int(Verdict.DECODED))
    verdict[~(nats > SIGNIFICANCE)] = Verdict.TOO_FEW
    verdict[place < 0] = Verdict.NO_PLACE
    verdict[links.neighbour.max(axis=1) < 0] = Verdict.ALONE
    index = np.flatnonzero(verdict == Verdict.DECODED)
    index = index[np.argsort(nats[index], kind="stable")]
    row, column, _ = code.split(place[index])
    holder = np.full((code.rows, code.columns), NONE)
    holder[row, column] = index
    verdict[index[holder[row, column] != index]] = Verdict.DOUBLED

    agreeing, contradicting = _neighbours_colors(code, links, label, clear, place)
    sure = (agreeing >= SURROUNDED) | ((agreeing >= LEAST_AGREEING) & (contradicting < 2) & right & clear)
    holder = np.where(held_by(holder, sure, False), holder, NONE)
    joints = Joints.none(code.rows, code.columns)
    for _ in range(2):
        holder, joints = on_surfaces(blocks, links, place, holder)
        nats = _patch_evidence(code, joints, holder >= 0, held_by(holder, right, False))
        holder = np.where(nats > SIGNIFICANCE, holder, NONE)
    held = holder >= 0
    verdict[verdict == Verdict.DECODED] = Verdict.OFF_SURFACE
    verdict[holder[held]] = Verdict.DECODED
    return verdict, holder, joints.between(held)


def on_surfaces(blocks: Blocks, links: Links, place: IntArray, holder: IntArray) -> tuple[IntArray, Joints]:
    """`holder` without the blocks that are not in squares, or not as large as their neighbours; and their joints."""
    position = held_by(holder, blocks.centre, np.nan)
    joints = sound_joints(position, _joined_blocks(links, place, holder))
    keep = in_squares(joints) & whole_blocks(held_by(holder, blocks.shape, np.nan), position, joints)
    return np.where(keep, holder, NONE), joints.between(keep)


def _joined_blocks(links: Links, place: IntArray, holder: IntArray) -> Joints:
    """Which blocks of the code, held by blobs, are linked to the next one of their row and of their column."""
    joints = Joints.none(*holder.shape)
    kernel.link_blocks(links.neighbour, place, holder, joints.right, joints.down)
    return joints


def _neighbours_colors(
    code: Code, links: Links, label: IntArray, clear: BoolArray, place: IntArray
) -> tuple[IntArray, IntArray]:
    """How many of the eight neighbours of each blob (N,) stand where it says and have the colour that the code has
    there; and how many are `clear`ly of another colour, wherever they stand."""
    agreeing, contradicting = np.empty_like(place), np.empty_like(place)
    kernel.count_neighbours(*code.flat, links.around, links.around_turn, label, clear, place, agreeing, contradicting)
    return agreeing, contradicting


def _surface_evidence(code: Code, links: Links, right: BoolArray, place: IntArray) -> FloatArray:
    """By how many nats the surface of each blob (N,), held by agreeing links, matches the code beyond chance."""
    surface = np.empty_like(place)
    kernel.join_agreeing(links.around, links.around_turn, place, code.rows, code.columns, surface)
    return _evidence(code, surface, place >= 0, right)


def _patch_evidence(code: Code, joints: Joints, held: BoolArray, right: BoolArray) -> FloatArray:
    """The same (rows, columns), of blocks that are `held` and of the `right` colour, linked by joints."""
    surface = np.empty(held.size, np.int64)
    kernel.join_linked(joints.right, joints.down, surface)
    return _evidence(code, surface, held.ravel(), (held & right).ravel()).reshape(held.shape)


def _evidence(code: Code, surface: IntArray, placed: BoolArray, right: BoolArray) -> FloatArray:
    """Nats (N,) of the `surface` (N,) of each, of which those that are `placed` count.

    m of n colours right has probability C(n, m) q^m, q of one colour by chance; and a surface could have been laid
    over any place of the code, starting from any of its blocks.
    """
    count = len(placed)
    n = np.bincount(surface[placed], minlength=count)
    m = np.bincount(surface[placed & right], minlength=count)
    factorial = np.concatenate([[0.0], np.cumsum(np.log(np.arange(1, max(int(n.max(initial=0)), 1) + 1)))])
    log_chance = factorial[n] - factorial[m] - factorial[n - m] - m * np.log(max(code.base - 1, 2))
    log_trials = np.log(code.windows) + np.log(max(int(placed.sum()), 1))
    return np.where(placed, -(log_chance + log_trials)[surface], -np.inf)
