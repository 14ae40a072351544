"""Which blob holds which place of the code, before anything is measured."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from retrue.decoding.blocks.blobs import Blocks
from retrue.decoding.blocks.evidence import (
    SIGNIFICANCE,
    joined_places,
    neighbours_colors,
    patch_evidence,
    surface_evidence,
)
from retrue.decoding.blocks.links import NONE, Links
from retrue.decoding.blocks.sight import Verdict
from retrue.decoding.blocks.surface import Joints, in_squares, sound_joints, whole_blocks
from retrue.decoding.blocks.windows import Code
from retrue.geometry.arrays import BoolArray, IntArray

SURROUNDED = 5  # agreeing neighbours of eight, from which on a block's own colour need not be beyond doubt
LEAST_AGREEING = 3  # of all other blocks, which may also have one neighbour whose colour is clearly another


def held_by(holder: IntArray, values: NDArray[Any], fill: float) -> NDArray[Any]:
    """`values` (N, ...) of the blob that holds each place (rows, columns), `fill` where none does."""
    held = holder >= 0
    result = np.full((*holder.shape, *values.shape[1:]), fill, dtype=values.dtype)
    result[held] = values[holder[held]]
    return result


def hold_places(
    code: Code, blocks: Blocks, links: Links, label: IntArray, clear: BoolArray, place: IntArray
) -> tuple[IntArray, IntArray, Joints]:
    """A verdict (N,) on each blob, the blob that holds each place (rows, columns) or -1, and their joints.

    Of two blobs in one place, the one on the surer surface holds it. Blobs whose neighbours' colours speak against
    them hold none, nor those whose size, or distance from their neighbours, is not their surface's.
    """
    nats = surface_evidence(code, links, label, place)
    verdict = np.full(len(place), int(Verdict.DECODED))
    verdict[~(nats > SIGNIFICANCE)] = Verdict.TOO_FEW
    verdict[place < 0] = Verdict.NO_PLACE
    verdict[(links.neighbour < 0).all(axis=1)] = Verdict.ALONE
    index = np.flatnonzero(verdict == Verdict.DECODED)
    index = index[np.argsort(nats[index], kind="stable")]
    row, column, _ = code.split(place[index])
    holder = np.full((code.rows, code.columns), NONE)
    holder[row, column] = index
    verdict[index[holder[row, column] != index]] = Verdict.DOUBLED

    right = label == code.color(place)
    agreeing, contradicting = neighbours_colors(code, links, label, clear, place)
    sure = (agreeing >= SURROUNDED) | ((agreeing >= LEAST_AGREEING) & (contradicting < 2) & right & clear)
    holder = np.where(held_by(holder, sure, False), holder, NONE)
    joints = joined_places(links, place, holder)
    for _ in range(2):
        holder, joints = on_surfaces(blocks, links, place, holder)
        held = holder >= 0
        nats = patch_evidence(code, joints, held, held_by(holder, right, False))
        holder = np.where(nats > SIGNIFICANCE, holder, NONE)
    held = holder >= 0
    verdict[verdict == Verdict.DECODED] = Verdict.OFF_SURFACE
    verdict[holder[held]] = Verdict.DECODED
    return verdict, holder, joints.between(held)


def on_surfaces(blocks: Blocks, links: Links, place: IntArray, holder: IntArray) -> tuple[IntArray, Joints]:
    """`holder` without the blocks that are not in squares, or not as large as their neighbours; and their joints."""
    position = held_by(holder, blocks.centre, np.nan)
    joints = sound_joints(position, joined_places(links, place, holder))
    keep = in_squares(joints) & whole_blocks(held_by(holder, blocks.shape, np.nan), position, joints)
    return np.where(keep, holder, NONE), joints.between(keep)
