"""Small faces: groups of linked blobs that no window placed, laid as a whole over what is left of the code."""

from __future__ import annotations

import numpy as np

from retrue.decoding.grid_blocks import Blocks
from retrue.decoding.grid_links import NONE, Links, bends, whitened_lengths
from retrue.decoding.grid_surface import Joints, slopes
from retrue.decoding.grid_windows import COSINE, SINE, Code, rotated
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray

FEWEST = 6  # blobs of an island
FAR = 0.15  # nats, for each cell that an island lies from where the nearest surface would continue
LEAST_FREE = 0.7  # of the cells that an island takes
STRAIGHT = 0.15  # of a step: its change to the one before or after it
ALONG = 0.5  # least cosine between the axes of an island and those of the nearest surface
USUAL_STEP = 1.25  # most and least of the picture's usual step, in sides of the blobs
MISREAD = -3.0  # nats that a clear blob of another colour than the code's costs
SIGNIFICANCE = 8.0  # nats by which an island must beat chance
LEAD = 4.0  # nats by which it must beat its second place


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
    cells = np.argwhere(np.isfinite(position + u + v).all(axis=-1))
    if not len(cells):
        return place
    from scipy.spatial import KDTree

    held = tuple(cells.T)
    tree = KDTree(position[held])
    free = ~np.isfinite(position[..., 0])
    lengths = whitened_lengths(blocks, links)
    usual = np.nanmedian(lengths)
    sound = (lengths < USUAL_STEP * usual) & (lengths > usual / USUAL_STEP) & left[:, None] & left[links.neighbour]
    sound &= ~(bends(blocks, links) > STRAIGHT)
    tried: list[tuple[float, IntArray, IntArray]] = []
    ways = 1.0
    for member, at, turn in _groups(np.where(sound, links.neighbour, NONE), links.turn):
        if len(member) < FEWEST:
            continue
        axes = _axes(blocks.centre[member], at)
        middle = blocks.centre[member].mean(axis=0)
        near = int(tree.query(middle)[1])
        there = cells[near]
        uv = np.stack([u[held][near], v[held][near]], axis=1)
        quarter = _quarter_turns(axes, uv)
        if quarter == NONE:
            continue
        offset = rotated(at, np.array(quarter))
        start = there + np.linalg.solve(uv, middle - position[held][near])[::-1] - offset.mean(axis=0)
        corner = offset.min(axis=0)
        shift = np.argwhere(np.ones(np.maximum(code.cells.shape - offset.max(axis=0) + corner, 0))) - corner
        cell = shift[:, None] + offset
        open_ = free[cell[..., 0], cell[..., 1]]
        mostly = open_.mean(axis=1) > LEAST_FREE
        shift, cell, open_ = shift[mostly], cell[mostly], open_[mostly]
        if not len(cell):
            continue
        far = FAR * np.linalg.norm(shift - start, axis=1)
        ways += float(np.exp(-far).sum())
        right = open_ & (code.cells[cell[..., 0], cell[..., 1]] == label[member])
        nats = np.where(right, np.log(code.base - 1), np.where(clear[member], MISREAD, MISREAD / 3)).sum(axis=1) - far
        best = int(np.argmax(nats))
        second = np.partition(nats, -2)[-2] if len(nats) > 1 else -np.inf
        if nats[best] - second > LEAD:
            where = (cell[best, :, 0] * code.columns + cell[best, :, 1]) * 4 + (quarter - turn) % 4
            tried.append((float(nats[best]), member, np.where(right[best], where, NONE)))
    for nats, member, where in tried:
        if nats > SIGNIFICANCE + np.log(ways):
            place[member] = where
    return place


def _groups(neighbour: IntArray, turn: IntArray) -> list[tuple[IntArray, IntArray, IntArray]]:
    """Linked blobs, with their (row, column) and quarter turns in the frame of the first; none that contradict."""
    groups: list[tuple[IntArray, IntArray, IntArray]] = []
    known = np.zeros(len(neighbour), dtype=bool)
    for root in np.flatnonzero((neighbour >= 0).any(axis=1)):
        if known[root]:
            continue
        at, turned = {int(root): (0, 0)}, {int(root): 0}
        queue = [int(root)]
        for blob in queue:
            for k in range(4):
                other = int(neighbour[blob, k])
                direction = (k - turned[blob]) % 4
                if other == NONE or other in at:
                    continue
                at[other] = (at[blob][0] + int(SINE[direction]), at[blob][1] + int(COSINE[direction]))
                turned[other] = int((turned[blob] + turn[blob, k]) % 4)
                queue.append(other)
        known[queue] = True
        if len(set(at.values())) == len(at):
            groups.append((np.array(queue), np.array([at[b] for b in queue]), np.array([turned[b] for b in queue])))
    return groups


def _axes(centre: FloatArray, at: IntArray) -> FloatArray:
    """(2, 2) steps to the right and down, as columns, of blobs at (row, column)."""
    terms = np.column_stack([at[:, ::-1], np.ones(len(at))])
    normal = terms.T @ terms + 1e-6 * np.eye(3)  # a single row tells nothing of the other axis: 0
    return np.linalg.solve(normal, terms.T @ centre)[:2].T


def _quarter_turns(axes: FloatArray, surface: FloatArray) -> int:
    """Quarter turns of an island's frame against the code's, so that both its axes lie along the surface's; or -1."""
    for quarter in range(4):
        c, s = COSINE[quarter], SINE[quarter]
        turned = np.stack([c * axes[:, 0] - s * axes[:, 1], s * axes[:, 0] + c * axes[:, 1]], axis=1)
        along = (turned * surface).sum(axis=0)
        if (along > ALONG * np.linalg.norm(turned, axis=0) * np.linalg.norm(surface, axis=0)).all():
            return quarter
    return NONE
