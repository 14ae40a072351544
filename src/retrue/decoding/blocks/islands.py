"""Small faces: groups of linked blobs that no window placed, laid as a whole over what is left of the code."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot

import numpy as np

from retrue.decoding.blocks.blobs import Blocks
from retrue.decoding.blocks.links import NONE, Links, lengths_and_bends
from retrue.decoding.blocks.places import Code
from retrue.decoding.surface import Joints, median, slopes
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.nearest import nearest
from retrue.kernels import links as link_kernel
from retrue.kernels import places as kernel

FEWEST = 6  # blobs of an island
STRAIGHT = 0.15  # of a step: its change to the one before or after it
ALONG = 0.5  # least cosine between the axes of an island and those of the nearest surface
USUAL_STEP = 1.25  # most and least of the picture's usual step, in sides of the blobs
MISREAD = -3.0  # nats that a clear blob of another colour than the code's costs
SIGNIFICANCE = 8.0  # nats by which an island must beat chance
LEAST_AREA = 1.0  # px^2 of a pitch squared
LEAD = 4.0  # nats by which it must beat its second place
Vector = tuple[float, float]


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

    `position` (rows, columns, 2), in pixels of the blobs, and `joints` are what is decoded. Only free places
    are open to an island, rather near than far from where the surface beside it would have it, and only turned as that
    surface is: so few ways to lie remain, and few blobs settle which.
    """
    place = np.full(len(blocks), NONE)
    u, v = slopes(position, joints)
    held = np.isfinite(position[..., 0] + u[..., 0] + v[..., 0])
    if not held.any() or not left.any():
        return place
    islands = _islands(_sound(blocks, links, left), links.turn)
    if not islands:
        return place
    free = ~np.isfinite(position[..., 0])
    row_column, beside = np.argwhere(held), position[held]
    axes_u, axes_v = u[held], v[held]
    middles = np.stack([blocks.centre[island.member].mean(axis=0) for island in islands])
    laid: list[tuple[float, _Island, IntArray]] = []
    ways, nearby = np.zeros(len(islands)), nearest(beside, middles)[1]
    for k, (island, middle, near) in enumerate(zip(islands, middles, nearby, strict=True)):
        surface = axes_u[near].tolist(), axes_v[near].tolist()
        quarter = _quarter_turns(_axes(blocks.centre[island.member], island.at), surface)
        if quarter == NONE:
            continue
        offset = _rotated(island.at, quarter)
        continued = row_column[near] + np.array(_away((middle - beside[near]).tolist(), surface))
        misread = np.where(clear[island.member], MISREAD, MISREAD / 3)
        where, nats = np.zeros(2, np.int64), np.full(2, -np.inf)
        color, match = label[island.member], float(np.log(code.base - 1))
        ways[k] = kernel.lay_island(free, code.colors, match, offset, color, misread, continued, where, nats)
        if nats[0] > LEAD + nats[1]:
            row, column = (where + offset).T
            fits = free[row, column] & (code.colors[row, column] == color)
            held_at = code.place(row, column, (quarter - island.turn) % 4)
            laid.append((float(nats[0]), island, np.where(fits, held_at, NONE)))
    for nats, island, where in sorted(laid, key=lambda way: way[0]):
        if nats > SIGNIFICANCE + np.log(1 + ways.sum()):
            place[island.member] = where
    return place


def _sound(blocks: Blocks, links: Links, left: BoolArray) -> IntArray:
    """Neighbours (N, 4) among blobs that are `left`, at the usual distance and straight on; or -1."""
    length, bend = lengths_and_bends(blocks, links)
    known = length[np.isfinite(length)]
    usual = median(known) if len(known) else np.nan
    sound = (length < USUAL_STEP * usual) & (length > usual / USUAL_STEP) & ~(bend > STRAIGHT)
    return np.where(sound & left[:, None] & left[links.neighbour], links.neighbour, NONE)


def _islands(neighbour: IntArray, turn: IntArray) -> list[_Island]:
    """Linked blobs, FEWEST or more, in the frame of the first; none that contradict."""
    count = len(neighbour)
    at, turned, member = np.empty((count, 2), np.int64), np.full(count, NONE), np.empty(count, np.int64)
    first = np.empty(count + 1, np.int64)
    first = first[: link_kernel.gather_islands(neighbour, turn, at, turned, member, first) + 1]
    islands: list[_Island] = []
    for k in np.flatnonzero(np.diff(first) >= FEWEST):
        blobs = member[first[k] : first[k + 1]]
        if len(np.unique(at[blobs] @ [2 * count, 1])) == len(blobs):
            islands.append(_Island(blobs, at[blobs], turned[blobs]))
    return islands


def _axes(centre: FloatArray, at: IntArray) -> tuple[Vector, Vector]:
    """Steps to the right and down of blobs at (row, column), by least squares."""
    at, centre = at - at.sum(axis=0) / len(at), centre - centre.sum(axis=0) / len(at)
    (rr, rc), (_, cc) = (at.T @ at + 1e-6 * np.eye(2)).tolist()  # a single row tells nothing of the other axis: 0
    (rx, ry), (cx, cy) = (at.T @ centre).tolist()
    size = rr * cc - rc * rc
    return ((rr * cx - rc * rx) / size, (rr * cy - rc * ry) / size), (
        (cc * rx - rc * cx) / size,
        (cc * ry - rc * cy) / size,
    )


def _quarter_turns(axes: tuple[Vector, Vector], surface: tuple[Vector, Vector]) -> int:
    """Quarter turns of an island's frame against the code's, so that both its axes lie along the surface's; or -1."""
    (ux, uy), (vx, vy) = surface
    if not (abs(ux * vy - vx * uy) > LEAST_AREA):
        return NONE
    (ax, ay), (bx, by) = axes
    limit_u, limit_v = ALONG * hypot(ux, uy), ALONG * hypot(vx, vy)
    for quarter in range(4):
        if ax * ux + ay * uy > limit_u * hypot(ax, ay) and bx * vx + by * vy > limit_v * hypot(bx, by):
            return quarter
        ax, ay, bx, by = -bx, -by, ax, ay
    return NONE


def _away(offset: Vector, surface: tuple[Vector, Vector]) -> Vector:
    """`offset` in steps (down, right) of the surface."""
    (x, y), ((ux, uy), (vx, vy)) = offset, surface
    size = ux * vy - vx * uy
    return (ux * y - uy * x) / size, (vy * x - vx * y) / size


def _rotated(at: IntArray, quarter_turns: int) -> IntArray:
    """(row, column) (K, 2), turned so that right becomes down at one quarter turn."""
    for _ in range(quarter_turns):
        at = np.stack([at[:, 1], -at[:, 0]], axis=-1)
    return at
