"""Where a surface goes on: do two lines of the right colours cross there, and where exactly?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.decoding.lines.profiles import across_lines
from retrue.decoding.lines.surfaces import Code, Surfaces
from retrue.decoding.surface import Joints, lengths, slopes
from retrue.geometry.arrays import BoolArray, FloatArray, Image, IntArray
from retrue.geometry.nearest import nearest

SIDES = ((0, 1), (1, 0), (0, -1), (-1, 0))  # (down, right), in the order right, down, left, up
ROUNDS = 30
LOOKS = 3  # at one crossing, each from where the one before has found it
FARTHEST = 0.25  # pitches from where the surface would have a crossing
SETTLED = 0.06  # pitches that the last look may move it
LIKE_A_LINE = 0.5  # least correlation of a profile with a line
APART = 0.5  # pitches, least distance between two crossings


@dataclass(frozen=True, slots=True, eq=False)
class Looked:
    """What the picture shows at N expected crossings.

    Attributes
    ----------
    at : (N, 2).
    lights : (2, N, 3) what column and row add to their gaps.
    likeness : (N,) of their profiles to lines, the lesser one.
    crossing : (N,) whether two lines cross there at all, whatever their colours.
    """

    at: FloatArray
    lights: FloatArray
    likeness: FloatArray
    crossing: BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class Ahead:
    """The N places beside decoded crossings where none is: (row, column) (N, 2) of both, and the `side` (N,)."""

    source: IntArray
    target: IntArray
    side: IntArray


def look_at(picture: Image, start: FloatArray, u: FloatArray, v: FloatArray) -> Looked:
    """Crossings about `start` (N, 2), with the steps (N, 2) to the next column and to the next row."""
    p = start.copy()
    columns = rows = across_lines(picture, p, u, v)
    for _ in range(LOOKS):
        columns, rows = across_lines(picture, p, u, v), across_lines(picture, p, v, u)
        p = p + columns.offset[:, None] * u + rows.offset[:, None] * v
    moved = np.maximum(np.abs(columns.offset), np.abs(rows.offset))
    off, size = p - start, np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    away = [np.abs(off[:, 0] * w[:, 1] - off[:, 1] * w[:, 0]) for w in (u, v)]
    likeness = np.minimum(columns.likeness, rows.likeness)
    with np.errstate(invalid="ignore"):
        crossing = (moved < SETTLED) & (np.maximum(*away) < FARTHEST * size) & (likeness > LIKE_A_LINE)
        height, width = picture.shape[:2]
        crossing &= ((p >= 0) & (p <= np.array([width - 1, height - 1]))).all(axis=1)
    return Looked(p, np.stack([columns.light, rows.light]), likeness, crossing)


def measured(picture: Image, surfaces: Surfaces, code: Code) -> Surfaces:
    """`surfaces` with each crossing where its two lines are; without those that are not there."""
    u, v = slopes(surfaces.position, surfaces.joints)
    row, column = np.nonzero(surfaces.held & np.isfinite(u[..., 0] + v[..., 0]))
    found = look_at(picture, surfaces.position[row, column], u[row, column], v[row, column])
    good = found.crossing & code.right(row, column, found.lights)
    row, column = row[good], column[good]
    result = Surfaces.none(*code.shape)
    result.position[row, column] = found.at[good]
    result.lights[:, row, column] = found.lights[:, good]
    result.likeness[row, column] = found.likeness[good]
    return Surfaces(result.position, result.lights, result.likeness, surfaces.joints.between(result.held))


def grow(picture: Image, surfaces: Surfaces, code: Code) -> Surfaces:
    """`surfaces`, and the crossings beside them where the picture shows both lines, each of the code's colour."""
    position, lights, likeness = surfaces.position.copy(), surfaces.lights.copy(), surfaces.likeness.copy()
    right, down = surfaces.joints.right.copy(), surfaces.joints.down.copy()
    held = surfaces.held
    fresh = held.copy()
    for _ in range(ROUNDS):
        ahead, found, pitch = look_ahead(picture, Surfaces(position, lights, likeness, Joints(right, down)), fresh)
        good = np.flatnonzero(found.crossing & code.right(ahead.target[:, 0], ahead.target[:, 1], found.lights))
        if not len(good):
            break
        index = ahead.target[good] @ [held.shape[1], 1]
        good = good[_apart(found.at[good], APART * pitch[good], index, position[held])]
        r, c = ahead.target[good].T
        position[r, c], lights[:, r, c], likeness[r, c] = found.at[good], found.lights[:, good], found.likeness[good]
        fresh = np.zeros_like(held)
        fresh[r, c] = held[r, c] = True
        for k, (_, along) in enumerate(SIDES):
            r, c = np.minimum(ahead.source, ahead.target)[good[ahead.side[good] == k]].T
            (right if along else down)[r, c] = True
    return Surfaces(position, lights, likeness, Joints(right, down)).joined()


def look_ahead(picture: Image, surfaces: Surfaces, fresh: BoolArray) -> tuple[Ahead, Looked, FloatArray]:
    """The free places beside the `fresh` crossings (rows, columns), what is seen there, and the pitch (N,) in px."""
    u, v = slopes(surfaces.position, surfaces.joints)
    ahead = _ahead(fresh & np.isfinite(u[..., 0] + v[..., 0]), surfaces.held)
    step = np.array(SIDES)[ahead.side]
    r, c = ahead.source.T
    u, v = u[r, c], v[r, c]
    start = surfaces.position[r, c] + step[:, :1] * v + step[:, 1:] * u
    return ahead, look_at(picture, start, u, v), np.minimum(lengths(u), lengths(v))


def _ahead(able: BoolArray, held: BoolArray) -> Ahead:
    """The sides on which an `able` crossing (rows, columns) has none that is `held`."""
    rows, columns = held.shape
    padded = np.ones((rows + 2, columns + 2), dtype=bool)  # nothing is missing outside the code
    padded[1:-1, 1:-1] = held
    beside = [padded[1 + down : 1 + down + rows, 1 + right : 1 + right + columns] for down, right in SIDES]
    row, column, side = np.nonzero(able[..., None] & ~np.stack(beside, axis=-1))
    source = np.stack([row, column], axis=-1)
    return Ahead(source, source + np.array(SIDES)[side], side)


def _apart(p: FloatArray, least: FloatArray, crossing: IntArray, held: FloatArray) -> BoolArray:
    """(N,) whether each point is `least` or more from all held ones, and from all points of other crossings.

    Points of one and the same crossing must be close instead.
    """
    apart = nearest(held, p)[0] > least
    between = lengths(p[:, None] - p)
    same = crossing[:, None] == crossing
    right = np.where(same, between < 0.3 * least[:, None], between > least[:, None])
    return apart & np.asarray(right.all(axis=1))
