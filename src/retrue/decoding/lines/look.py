"""One look at a picture, from a given distance: find lines, cross them, name them, place them, measure, grow."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from retrue.decoding.lines.colors import fit_colors
from retrue.decoding.lines.crossings import NONE, Crossings, find_crossings
from retrue.decoding.lines.directions import line_directions
from retrue.decoding.lines.evidence import significant
from retrue.decoding.lines.families import find_lines
from retrue.decoding.lines.growth import grow, measured
from retrue.decoding.lines.places import Places, place_crossings
from retrue.decoding.lines.profiles import across_lines
from retrue.decoding.lines.sight import LineSight
from retrue.decoding.lines.surfaces import FAINT, Code, Surfaces
from retrue.decoding.surface import Joints, lengths, noise_of, odd_blocks, slopes
from retrue.geometry.arrays import FloatArray, Image
from retrue.patterns.line_grid import LineGrid, Lines

ROUNDS = 3  # of growth, each without what the one before left off its surface
WHITE_SHARE = 90  # percentile of the lines' light that white is taken to add


def look(pattern: LineGrid, columns: Lines, rows: Lines, picture: Image, halvings: int) -> LineSight:
    """What `picture` (h, w, 3), halved so many times, shows of both families; crossings are measured in full size."""
    small = halved(picture, halvings)
    seen = _crossings(small)
    placed = max((_place(columns, rows, small, seen.turned(turn)) for turn in range(4)), key=_Placed.count)
    surfaces = _surfaces(picture, 2**halvings, placed)
    return LineSight(
        pattern=pattern,
        picture=picture,
        halvings=halvings,
        crossings=placed.crossings,
        places=placed.places,
        surfaces=surfaces,
        sigma_px=noise_of(surfaces.position, surfaces.joints),
        pitch_px=_pitch(surfaces, placed.crossings, 2**halvings),
    )


def seen_lines(picture: Image) -> tuple[Crossings, FloatArray]:
    """Crossings in `picture` (h, w, 3) of any lines, and what both lines of each add to their gaps, (2, N, 3)."""
    crossings = _crossings(picture)
    return crossings, _lights(picture, crossings)


def _crossings(picture: Image) -> Crossings:
    along = line_directions(picture)
    return find_crossings(find_lines(picture, along[0], along[1]), find_lines(picture, along[1], along[0]))


@dataclass(frozen=True, slots=True, eq=False)
class _Placed:
    """Crossings, named as the code has its directions, and their places."""

    crossings: Crossings
    places: Places
    code: Code

    def count(self) -> int:
        return int((self.places.column >= 0).sum())


def _place(columns: Lines, rows: Lines, picture: Image, crossings: Crossings) -> _Placed:
    """Places of the crossings if the code's right is their right. Lines too faint for their colour go first: the gap
    between two sharpened lines looks like one."""
    lights = _lights(picture, crossings)
    both = lights[np.isfinite(lights).all(axis=-1)]
    gain = np.percentile(both, WHITE_SHARE, axis=0) if len(both) else np.ones(3)
    colors = [fit_colors(light, lines.colors, gain) for light, lines in zip(lights, (columns, rows), strict=True)]
    code = Code(np.array(columns.sequence), np.array(rows.sequence), *colors)
    whole = ~(colors[0].faint(lights[0], FAINT) | colors[1].faint(lights[1], FAINT))
    crossings, lights = crossings.select(whole), lights[:, whole]
    nats = [color.likelihood(light) for color, light in zip(colors, lights, strict=True)]
    return _Placed(crossings, place_crossings(crossings.neighbour, nats[0], code.columns, nats[1], code.rows), code)


def _lights(picture: Image, crossings: Crossings) -> FloatArray:
    """(2, N, 3) what the two lines of each crossing add to their gaps; NaN where no neighbour tells their distance."""
    u, v = crossings.steps()
    able = np.isfinite(u[:, 0] + v[:, 0])
    lights = np.full((2, len(crossings), 3), np.nan)
    lights[0, able] = across_lines(picture, crossings.at[able], u[able], v[able]).light
    lights[1, able] = across_lines(picture, crossings.at[able], v[able], u[able]).light
    return lights


def _surfaces(picture: Image, scale: int, placed: _Placed) -> Surfaces:
    """The placed crossings, measured in the `picture` in full size, and what grows from them; only what is sure."""
    code = placed.code
    surfaces = _on_code(placed).scaled(scale)
    if not surfaces.held.any():
        return surfaces
    smooth = smoothed(picture, _pitch(surfaces, placed.crossings, scale))
    for _ in range(ROUNDS):
        surfaces = grow(smooth, measured(smooth, surfaces, code), code)
        surfaces = surfaces.only(~odd_blocks(surfaces.position, surfaces.joints)[0])
    return significant(smooth, surfaces, code)


def _on_code(placed: _Placed) -> Surfaces:
    """The placed crossings (rows, columns) of the code, the surest one in each place."""
    places, crossings, shape = placed.places, placed.crossings, placed.code.shape
    index = np.flatnonzero(places.column >= 0)
    if not len(index):
        return Surfaces.none(*shape)
    index = index[np.argsort(places.lead[index], kind="stable")]
    holder = np.full(shape, NONE)
    holder[places.row[index], places.column[index]] = index
    held = holder >= 0
    right = held[:, :-1] & held[:, 1:] & (crossings.neighbour[holder[:, :-1], 0] == holder[:, 1:])
    down = held[:-1] & held[1:] & (crossings.neighbour[holder[:-1], 1] == holder[1:])
    none = Surfaces.none(*shape)
    position = np.where(held[..., None], crossings.at[holder], np.nan)
    return Surfaces(position, none.lights, none.likeness, Joints(right, down))


def _pitch(surfaces: Surfaces, crossings: Crossings, scale: int) -> float:
    """Median distance between lines in px, of the surfaces, or of all crossings; 0: none."""
    u, v = slopes(surfaces.position, surfaces.joints)
    steps = np.minimum(lengths(u), lengths(v))[surfaces.held]
    if not np.isfinite(steps).any():
        u, v = crossings.steps()
        steps = scale * np.minimum(lengths(u), lengths(v))
    steps = steps[np.isfinite(steps)]
    return float(np.median(steps)) if len(steps) else 0.0


def halved(picture: Image, halvings: int) -> Image:
    """In eight bits, halved so many times."""
    if picture.dtype != np.uint8:
        gain = 255.0 / max(float(np.percentile(picture[::4, ::4], 99.9)), 1.0)
        picture = np.asarray(cv2.convertScaleAbs(picture, alpha=gain), dtype=np.uint8)
    scale = 2**halvings
    h, w = picture.shape[0] // scale, picture.shape[1] // scale
    if not halvings:
        return picture
    return np.asarray(cv2.resize(picture[: h * scale, : w * scale], (w, h), interpolation=cv2.INTER_AREA))


def smoothed(picture: Image, pitch: float) -> Image:
    """`picture` in eight bits of light, averaged over a box about as wide as samples of a profile lie apart."""
    gain = 1.0
    if picture.dtype != np.uint8:
        gain = 255.0 / max(float(np.percentile(picture[::4, ::4], 99.9)), 1.0)
    side = 2 * round(pitch / 24) + 1
    pixels = picture.astype(np.float32) * np.float32(gain)
    return pixels if side < 3 else np.asarray(cv2.blur(pixels, (side, side)))
