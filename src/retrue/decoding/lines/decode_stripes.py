"""One colour picture of stripes, lines of one direction, -> one coordinate at every other pixel along each line.

As of a line grid, but that no line crosses another: rows of the picture, or columns where the lines run level, take
the place of the other family. What a line's neighbours in the same row say of its place, the rows next to it confirm.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from retrue.correspondences import Card, Correspondences
from retrue.decoding.light import around, saturated
from retrue.decoding.lines.colors import Colors, fit_colors
from retrue.decoding.lines.crossings import FARTHEST, NONE, Crossings, link
from retrue.decoding.lines.evidence import beats_chance
from retrue.decoding.lines.families import find_lines
from retrue.decoding.lines.growth import LIKE_A_LINE, SETTLED
from retrue.decoding.lines.look import WHITE_SHARE, halved, smoothed
from retrue.decoding.lines.places import Places, place_columns
from retrue.decoding.lines.profiles import across_lines
from retrue.decoding.lines.surfaces import FAINT, LEAST_NATS
from retrue.decoding.pictures import coverage, unusable_picture
from retrue.geometry.arrays import BoolArray, FloatArray, Image, IntArray
from retrue.geometry.robust import MAD_TO_SIGMA
from retrue.patterns.line_grid import LineGrid, Lines

LARGEST_SIDE = 800  # px: larger pictures are looked at from further away, and measured in full size
STEP = 2  # px along a line, from point to point
ASIDE = 5  # px in a row of which one line has one point
ABOUT = 33  # px, side of the square whose edges tell a line's direction
BESIDE = 5.0  # px along a line that its profile is averaged over
LOOKS = 3  # at one point, each from where the one before has found it
SPREAD = 8  # rounds in which a place spreads to neighbours of the right colour
APART = 4  # points along a line between which its noise is measured: nearer ones share it
LEAST_SIGMA = 0.02  # px
OUTLIER_SIGMAS = 5.0
GOOD_COUNT = 30


@dataclass(frozen=True, slots=True, eq=False)
class _Stripes:
    """The N points of lines that were found, and their places.

    Attributes
    ----------
    seen : as crossings of the lines with every STEP-th row, in pixels of the picture in full size.
    row : (N,) which of these rows.
    light : (N, 3) what the line adds to its gaps.
    column : (N,) line of the code, or -1.
    """

    seen: Crossings
    row: IntArray
    light: FloatArray
    column: IntArray

    def select(self, kept: BoolArray) -> _Stripes:
        seen = _linked(self.seen.at[kept], self.seen.axes[kept], self.row[kept])
        return _Stripes(seen, self.row[kept], self.light[kept], self.column[kept])


def decode_stripes(pattern: LineGrid, picture: Image, image: Image) -> Correspondences:
    """Points of the lines of a `pattern` of one family in `picture` (h, w, 3), which is `image` in the projector's
    light alone.

    Seen from behind or turned by half a turn the code is read backwards; no picture of stripes tells which it was.
    """
    lines, axis = (pattern.columns, 0) if pattern.columns is not None else (pattern.rows, 1)
    assert lines is not None
    along = stripe_direction(picture[:: max(1, max(picture.shape) // LARGEST_SIDE)])
    level = float(np.mean(np.abs(along[..., 0]))) > float(np.mean(np.abs(along[..., 1])))
    upright = np.ascontiguousarray(picture.transpose(1, 0, 2)) if level else picture
    found = _look(lines, upright)
    camera_px = found.seen.at[:, ::-1] if level else found.seen.at
    column, height, width = found.column, *picture.shape[:2]
    placed = column >= 0
    sigma = _sigma(found)
    projector_px = np.full((int(placed.sum()), 2), np.nan)
    projector_px[:, axis] = lines.middles()[column[placed]]
    camera_px = camera_px[placed]
    light = np.maximum(found.light[placed], 0.0)
    full = saturated(around(image, camera_px).reshape(-1, 3)).reshape(-1, 9).any(axis=1)
    return Correspondences(
        camera_px,
        projector_px,
        camera_sigma_px=np.full(len(camera_px), sigma),
        colors=np.clip(light, 0, 255).astype(np.uint8),
        cells=np.stack([found.row[placed], column[placed]], axis=1),
        card=Card(
            "pixels",
            seen=len(column),
            decoded=len(camera_px),
            rejected={"colours fit no place of the code": int((~placed).sum())},
            coverage=round(coverage(camera_px, width, height), 3),
            advice=tuple(filter(None, [_advice(picture, len(column), len(camera_px))])),
        ),
        light=np.where(full, np.nan, light.sum(axis=1)),
        light_class=np.array(lines.sequence)[column[placed]],
        camera_size=(width, height),
        projector_size=pattern.projector_size,
    )


def stripe_direction(picture: Image) -> FloatArray:
    """(h, w, 2) unit vectors (x, y) along the lines about each pixel, downwards.

    The direction in which the picture (h, w, 3) changes least: the structure tensor's, with the root of its strength,
    so that a print's few strong edges do not outvote many faint lines.

    Source: Bigun, Granlund, "Optimal orientation detection of linear symmetry", ICCV 1987.
    """
    smooth = cv2.GaussianBlur(picture, (0, 0), 0.8)
    gx, gy = (np.asarray(cv2.Sobel(smooth, cv2.CV_32F, *order)) for order in ((1, 0), (0, 1)))
    strength = np.sqrt(np.maximum(gx * gx + gy * gy, np.float32(1e-6)))
    tensor = [((gx * gx - gy * gy) / strength).sum(axis=-1), (2 * gx * gy / strength).sum(axis=-1)]
    across, twice = (np.asarray(cv2.blur(own, (ABOUT, ABOUT)), np.float64) for own in tensor)
    angle = np.arctan2(twice, across) / 2 + np.pi / 2
    vector = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.where(vector[..., 1:] < 0, -vector, vector)


def _look(lines: Lines, picture: Image) -> _Stripes:
    """The points of upright lines, measured in the `picture` (h, w, 3) in full size; those of the code with a place."""
    halvings = 0
    while max(picture.shape[:2]) / 2**halvings > LARGEST_SIDE:
        halvings += 1
    small, scale = halved(picture, halvings), 2**halvings
    direction = stripe_direction(small)
    family = find_lines(small, direction, np.stack([direction[..., 1], -direction[..., 0]], axis=-1))
    highest = family.height >= cv2.dilate(family.height, np.ones((1, ASIDE), np.uint8))  # where a slanting line has two
    row, column = np.nonzero((family.ridge & highest)[::STEP])
    axes = np.stack([np.tile([1.0, 0.0], (len(row), 1)), direction[row * STEP, column]], axis=1)
    at = np.stack([column, row * STEP], axis=1).astype(np.float64)
    seen = _linked(at, axes, row)
    light = _measured(small, seen, BESIDE)[1]
    found = _Stripes(seen, row, light, np.full(len(row), NONE))
    colors = _colors(lines, light)
    found = found.select(np.isfinite(light).all(axis=1) & ~colors.faint(light, FAINT))
    found = max((_placed(lines, found, colors, turned) for turned in (False, True)), key=_count)
    if not _count(found):
        return found
    large = replace(found.seen, at=(found.seen.at + 0.5) * scale - 0.5)
    pitch = float(np.nanmedian(large.steps()[0][:, 0])) if len(large) else 0.0
    at, light, whole = _measured(smoothed(picture, pitch), large, BESIDE * scale)
    nats = colors.likelihood(light)
    own = np.array(lines.sequence)[found.column]
    right = whole & (nats[np.arange(len(own)), own] > LEAST_NATS)
    column = np.where(right & (found.column >= 0), found.column, NONE)
    found = _Stripes(replace(large, at=at), found.row, light, column)
    return _smooth(_sure(found, nats, lines))


def _linked(at: FloatArray, axes: FloatArray, row: IntArray) -> Crossings:
    """Each with the next ones in its row, and along its line; `at` (N, 2) in order of rows and in them of x."""
    seen = link(at, axes)
    neighbour = seen.neighbour.copy()
    neighbour[:, 0] = neighbour[:, 2] = NONE
    left = np.flatnonzero((np.diff(row) == 0) & (np.diff(at[:, 0]) < FARTHEST))
    neighbour[left, 0], neighbour[left + 1, 2] = left + 1, left
    return Crossings(at, axes, neighbour)


def _count(found: _Stripes) -> int:
    return int((found.column >= 0).sum())


def _colors(lines: Lines, light: FloatArray) -> Colors:
    known = light[np.isfinite(light).all(axis=1)]
    gain = np.percentile(known, WHITE_SHARE, axis=0) if len(known) else np.ones(3)
    return fit_colors(light, lines.colors, gain)


def _measured(picture: Image, seen: Crossings, reach: float) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Where the lines' middles are (N, 2), what they add (N, 3), and whether a line is there (N,).

    All is NaN and False where no neighbour tells how far lines are apart.
    """
    step = seen.steps()[0]
    able = np.flatnonzero(np.isfinite(step[:, 0]))
    at, light, whole = seen.at.copy(), np.full((len(seen), 3), np.nan), np.zeros(len(seen), np.bool_)
    if not len(able):
        return at, light, whole
    u, v, p = step[able] * [1.0, 0.0], seen.axes[able, 1] * reach, seen.at[able]
    profile = across_lines(picture, p, u, v)
    for _ in range(LOOKS):
        p = p + np.clip(profile.offset, -0.5, 0.5)[:, None] * u
        profile = across_lines(picture, p, u, v)
    at[able], light[able] = p, profile.light
    moved = np.abs(p[:, 0] - seen.at[able, 0]) / np.abs(u[:, 0])
    whole[able] = (np.abs(profile.offset) < SETTLED) & (moved < 0.25) & (profile.likeness > LIKE_A_LINE)
    return at, light, whole


def _placed(lines: Lines, found: _Stripes, colors: Colors, turned: bool) -> _Stripes:
    """With the places of the code, read from left to right, or `turned` by half a turn."""
    seen = found.seen.turned(2) if turned else found.seen
    sequence, nats = np.array(lines.sequence), colors.likelihood(found.light)
    places = place_columns(seen.neighbour, nats, sequence, -found.row if turned else found.row)
    return replace(found, column=_spread(seen.neighbour, places, nats, sequence))


def _spread(neighbour: IntArray, places: Places, nats: FloatArray, sequence: IntArray) -> IntArray:
    """Places (N,), of neighbours too where all that are placed beside them say the same and the colour is right."""
    column = places.column.copy()
    for _ in range(SPREAD):
        said = np.full((4, len(column)), NONE)
        for k, ahead in enumerate((1, 0, -1, 0)):
            other = neighbour[:, k]
            there = (other >= 0) & (column[other] >= 0)
            said[k, there] = column[other[there]] - ahead
        most = said.max(axis=0)
        agree = ((said == most) | (said == NONE)).all(axis=0) & (most >= 0) & (most < len(sequence))
        fresh = np.flatnonzero(agree & (column < 0))
        fresh = fresh[nats[fresh, sequence[most[fresh]]] > 0]
        if not len(fresh):
            break
        column[fresh] = most[fresh]
    return column


def _sure(found: _Stripes, nats: FloatArray, lines: Lines) -> _Stripes:
    """Only places on pieces of surface whose lines beat chance."""
    from scipy import sparse
    from scipy.sparse import csgraph

    placed, neighbour = found.column >= 0, found.seen.neighbour
    pairs = [(np.flatnonzero(neighbour[:, k] >= 0), k) for k in (0, 1)]
    a, b = (np.concatenate(own) for own in zip(*((one, neighbour[one, k]) for one, k in pairs), strict=True))
    gone = np.abs(found.column[a] - found.column[b])
    across = np.concatenate([np.full(len(one), k == 0) for one, k in pairs])
    linked = placed[a] & placed[b] & (gone == across)
    graph = sparse.coo_array((np.ones(int(linked.sum())), (a[linked], b[linked])), shape=(len(placed), len(placed)))
    piece = np.asarray(csgraph.connected_components(graph, directed=False)[1], np.int64)
    own = nats[np.arange(len(placed)), np.array(lines.sequence)[found.column]]
    sure = beats_chance(piece[placed], found.column[placed], own[placed], len(lines.sequence), len(placed))
    return replace(found, column=np.where(placed & sure[piece], found.column, NONE))


def _smooth(found: _Stripes) -> _Stripes:
    """Without places where a line jumps aside between its neighbours, and one place for each line in a row."""
    grid = _grid(found)
    x = np.where(grid >= 0, found.seen.at[grid, 0], np.nan)
    off = np.full(x.shape, np.nan)
    off[1:-1] = x[1:-1] - (x[:-2] + x[2:]) / 2
    odd = np.abs(off) > OUTLIER_SIGMAS * np.sqrt(1.5) * max(_sigma(found), LEAST_SIGMA)
    kept = np.zeros(len(found.column), np.bool_)
    kept[grid[(grid >= 0) & ~odd]] = True
    return replace(found, column=np.where(kept, found.column, NONE))


def _grid(found: _Stripes) -> IntArray:
    """(rows, lines) which point is that of a line in a row, or -1."""
    placed = np.flatnonzero(found.column >= 0)
    shape = int(found.row.max(initial=0)) + 1, int(found.column.max(initial=0)) + 1
    grid = np.full(shape, NONE)
    grid[found.row[placed], found.column[placed]] = placed
    return grid


def _sigma(found: _Stripes) -> float:
    """Of a point across its line, from how lines bend between points that are APART, and from line to line.

    What a line's neighbours make of its profile is the same all along it, and differs from line to line.
    """
    if not _count(found):
        return 1.0
    grid = _grid(found)
    x = np.where(grid >= 0, found.seen.at[grid, 0], np.nan)
    bends = [of[: -2 * step] - 2 * of[step:-step] + of[2 * step :] for of, step in ((x, APART), (x.T, 1))]
    known = [np.abs(bend[np.isfinite(bend)]) for bend in bends]
    told = [MAD_TO_SIGMA * float(np.median(bend)) / 6**0.5 for bend in known if len(bend)]
    return max(*told, LEAST_SIGMA) if told else 1.0


def _advice(picture: Image, seen: int, decoded: int) -> str:
    if decoded >= GOOD_COUNT:
        return ""
    if unusable := unusable_picture(picture):
        return unusable
    if seen < GOOD_COUNT:
        return "no lines seen: out of focus, or closer than 5 px: focus, move closer or use a coarser pattern"
    return "not this pattern: there are lines, but their colours are not those of this code"
