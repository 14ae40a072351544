"""Small faces: groups of linked blobs that no window placed, laid as a whole over what is left of the code."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np

from retrue.decoding.blocks.blobs import Blocks
from retrue.decoding.blocks.links import NONE, Links, lengths_and_bends
from retrue.decoding.blocks.nearest import nearest
from retrue.decoding.blocks.surface import Joints, slopes
from retrue.decoding.blocks.windows import COSINE, SINE, Code, rotated
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.compiling import OUT_VECTOR, VECTOR, compiled, numba

FEWEST = 6  # blobs of an island
FAR = 0.15  # nats, for each cell that an island lies from where the nearest surface would continue
FARTHEST = 40.0  # cells, beyond which no island is looked for
LEAST_FREE = 0.7  # of the cells that an island takes
STRAIGHT = 0.15  # of a step: its change to the one before or after it
ALONG = 0.5  # least cosine between the axes of an island and those of the nearest surface
USUAL_STEP = 1.25  # most and least of the picture's usual step, in sides of the blobs
MISREAD = -3.0  # nats that a clear blob of another colour than the code's costs
SIGNIFICANCE = 8.0  # nats by which an island must beat chance
LEAST_AREA = 1.0  # px^2 of a pitch squared
STEPS = ((0, 1), (1, 0), (0, -1), (-1, 0))  # (down, right) of a link in each direction
LEAD = 4.0  # nats by which it must beat its second place


@dataclass(frozen=True, slots=True, eq=False)
class _Island:
    """K blobs in one frame of their own: their `at` (row, column) in it (K, 2), and the `turn` of their frames (K,)."""

    member: IntArray
    at: IntArray
    turn: IntArray


def place_islands(
    code: Code,
    blocks: Blocks,
    links: Links,
    label: IntArray,
    clear: BoolArray,
    left: BoolArray,
    position: FloatArray,
    joints: Joints,
) -> IntArray:
    """Place (N,) in the code of blobs that are `left`, or -1.

    `position` (rows, columns, 2), in pixels of the blobs, and `joints` are what is decoded. Only free cells are
    open to an island, rather near than far from where the surface beside it would have it, and only turned as that
    surface is: so few ways to lie remain, and few blobs settle which.
    """
    place = np.full(len(blocks), NONE)
    u, v, _ = slopes(position, joints)
    held = np.isfinite(position + u + v).all(axis=-1)
    cells, free = np.argwhere(held), ~np.isfinite(position[..., 0])
    if not len(cells) or not left.any():
        return place
    islands = [island for island in _islands(_sound(blocks, links, left), links.turn) if len(island.member) >= FEWEST]
    if not islands:
        return place
    beside_u, beside_v, beside_position = u[held], v[held], position[held]
    middles = np.stack([blocks.centre[island.member].mean(axis=0) for island in islands])
    near = nearest(beside_position, middles)[1]
    laid: list[tuple[float, _Island, IntArray]] = []
    ways = 1.0
    for island, middle, beside in zip(islands, middles, near, strict=True):
        surface = np.stack([beside_u[beside], beside_v[beside]], axis=1)
        quarter = _quarter_turns(_axes(blocks.centre[island.member], island.at), surface)
        if quarter == NONE:
            continue
        offset = rotated(island.at, np.array(quarter))
        away = cast(FloatArray, np.linalg.solve(surface, middle - beside_position[beside]))
        continued = np.asarray(cells[beside] + away[::-1], dtype=np.float64)
        misread = np.where(clear[island.member], MISREAD, MISREAD / 3)
        where, nats = np.zeros(2, np.int64), np.full(2, -np.inf)
        ways += _lay(free, code.cells, code.base, offset, label[island.member], misread, continued, where, nats)
        if nats[0] > LEAD + nats[1]:
            row, column = (where + offset).T
            right = free[row, column] & (code.cells[row, column] == label[island.member])
            held_at = (row * code.columns + column) * 4 + (quarter - island.turn) % 4
            laid.append((float(nats[0]), island, np.where(right, held_at, NONE)))
    for nats, island, where in sorted(laid, key=lambda way: way[0]):
        if nats > SIGNIFICANCE + np.log(ways):
            place[island.member] = where
    return place


def _sound(blocks: Blocks, links: Links, left: BoolArray) -> IntArray:
    """Neighbours (N, 4) among blobs that are `left`, at the usual distance and straight on; or -1."""
    length, bend = lengths_and_bends(blocks, links)
    known = length[np.isfinite(length)]
    usual = np.median(known) if len(known) else np.nan
    sound = (length < USUAL_STEP * usual) & (length > usual / USUAL_STEP) & ~(bend > STRAIGHT)
    return np.where(sound & left[:, None] & left[links.neighbour], links.neighbour, NONE)


_INTEGERS = numba.types.Array(numba.int64, 1, "C")
_CELLS = numba.types.Array(numba.int64, 2, "A", readonly=True)


@compiled(
    numba.float64(
        numba.types.Array(numba.boolean, 2, "C"), _CELLS, numba.int64, _CELLS, _INTEGERS, VECTOR, VECTOR, _INTEGERS,
        OUT_VECTOR,
    )
)  # fmt: skip
def _lay(
    free: BoolArray,
    code: IntArray,
    base: int,
    offset: IntArray,
    label: IntArray,
    misread: FloatArray,
    continued: FloatArray,
    where: IntArray,
    nats: FloatArray,
) -> float:
    """Lay blobs of `offset` (K, 2) and `label` (K,) wherever most of the cells are free.

    `nats` (2,) <- of the best way and of the second; `where` (2,) <- (row, column) to add to the offsets of the best.
    A way is unlikely when it is far from where the surface beside is `continued` to the middle of the blobs; the sum of
    these likelihoods is how many ways there are.
    """
    count, ways, match = len(offset), 0.0, np.log(base - 1)
    top, bottom, left, right, down, along = offset[0, 0], offset[0, 0], offset[0, 1], offset[0, 1], 0.0, 0.0
    for k in range(count):
        top, bottom = min(top, offset[k, 0]), max(bottom, offset[k, 0])
        left, right = min(left, offset[k, 1]), max(right, offset[k, 1])
        down, along = down + offset[k, 0] / count, along + offset[k, 1] / count
    for r in range(-top, free.shape[0] - bottom):
        for c in range(-left, free.shape[1] - right):
            distance = np.sqrt((r + down - continued[0]) ** 2 + (c + along - continued[1]) ** 2)
            if not distance < FARTHEST:
                continue
            open_cells, score = 0, -FAR * distance
            for k in range(count):
                open_cells += free[r + offset[k, 0], c + offset[k, 1]]
            if not open_cells / count > LEAST_FREE:
                continue
            for k in range(count):
                i, j = r + offset[k, 0], c + offset[k, 1]
                score += match if free[i, j] and code[i, j] == label[k] else misread[k]
            ways += np.exp(-FAR * distance)
            if score > nats[0]:
                nats[1], nats[0], where[0], where[1] = nats[0], score, r, c
            elif score > nats[1]:
                nats[1] = score
    return ways


def _islands(neighbour: IntArray, turn: IntArray) -> list[_Island]:
    """Linked blobs, with their (row, column) and quarter turns in the frame of the first; none that contradict."""
    islands: list[_Island] = []
    known = np.zeros(len(neighbour), dtype=bool)
    linked = np.flatnonzero((neighbour >= 0).any(axis=1))
    others = dict(zip(linked.tolist(), neighbour[linked].tolist(), strict=True))
    turns = dict(zip(linked.tolist(), turn[linked].tolist(), strict=True))
    for root in others:
        if known[root]:
            continue
        at, turned, queue = {root: (0, 0)}, {root: 0}, [root]
        for blob in queue:
            for k, other in enumerate(others.get(blob, ())):
                direction = (k - turned[blob]) % 4
                if other == NONE or other in at:
                    continue
                at[other] = at[blob][0] + STEPS[direction][0], at[blob][1] + STEPS[direction][1]
                turned[other] = (turned[blob] + turns[blob][k]) % 4
                queue.append(other)
        known[queue] = True
        if len(set(at.values())) == len(at):
            member = [np.array(values) for values in (queue, [at[b] for b in queue], [turned[b] for b in queue])]
            islands.append(_Island(*member))
    return islands


def _axes(centre: FloatArray, at: IntArray) -> FloatArray:
    """(2, 2) steps to the right and down, as columns, of blobs at (row, column)."""
    terms = np.column_stack([at[:, ::-1], np.ones(len(at))])
    normal = terms.T @ terms + 1e-6 * np.eye(3)  # a single row tells nothing of the other axis: 0
    return np.asarray(np.linalg.solve(normal, terms.T @ centre), dtype=np.float64)[:2].T


def _quarter_turns(axes: FloatArray, surface: FloatArray) -> int:
    """Quarter turns of an island's frame against the code's, so that both its axes lie along the surface's; or -1."""
    if not (abs(np.linalg.det(surface)) > LEAST_AREA):
        return NONE
    for quarter in range(4):
        c, s = COSINE[quarter], SINE[quarter]
        turned = np.stack([c * axes[:, 0] - s * axes[:, 1], s * axes[:, 0] + c * axes[:, 1]], axis=1)
        along = (turned * surface).sum(axis=0)
        if (along > ALONG * np.linalg.norm(turned, axis=0) * np.linalg.norm(surface, axis=0)).all():
            return quarter
    return NONE
