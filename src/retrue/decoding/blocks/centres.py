"""The image of each block's centre, to a small part of a pixel."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from retrue.decoding.blocks.lines import agreement
from retrue.decoding.blocks.sampling import PICTURES, bilinear, in_two_threads, read_profile
from retrue.decoding.blocks.surface import Joints, slopes
from retrue.geometry.arrays import BoolArray, FloatArray, Image, IntArray
from retrue.geometry.compiling import MATRIX, OUT_MATRIX, STACK, VECTOR, compiled, numba

LINES = 3  # profiles side by side, over the middle of the block
SIDE_LINES = 9  # along each side, where a print disturbs the profiles
SPREAD = 0.8  # of a block's side that the lines cover
REACH = 0.5  # pitches that a profile reaches to either side: to the middle of the gaps
SAMPLES = 9  # along a profile
BLUR = 1.0  # px, standard deviation of a typical edge; the fit hardly depends on it
BLURS = np.geomspace(0.02, 0.4, 25)  # in pitches: one filter each
BLUR_BORDERS: FloatArray = np.sqrt(BLURS[1:] * BLURS[:-1])  # where the next filter takes over
SIDE_SAMPLES = 9  # across one side
SIDE_WINDOW = 0.88  # of half a gap: how far those reach from the side
CHANNEL_TRUST = np.array([1.0, 2.0, 1.0])  # green is sampled twice as densely, and never subsampled
ROUNDS = 2
FARTHEST_FIT = 0.15  # pitches that one fit may move a centre
FARTHEST = 0.12  # of a pitch that a centre may lie off the middle of its blob
STRAIGHT = 4.0  # sigmas by which lines through one block may differ on a smooth surface
DISAGREEMENT = 0.06  # of a pitch between two ways to measure: more, and the block is cut
RIM_DISAGREEMENT = 0.03  # the same at the rim of a surface, where cut blocks are


@dataclass(frozen=True, slots=True, eq=False)
class Centres:
    """Of every cell of the code, (rows, columns, ...); NaN where there is none.

    Attributes
    ----------
    camera_px : (rows, columns, 2) the image of the centre.
    doubt_px : (rows, columns) what it may be off beyond noise, one standard deviation; 0 of most.
    """

    camera_px: FloatArray
    doubt_px: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class _Smoothed:
    """A picture averaged over a box about as wide as samples lie apart, so that few samples see all pixels."""

    pixels: Image
    blur_px: float

    @classmethod
    def of(cls, image: Image, pitch: float) -> _Smoothed:
        side = max(3, 2 * round(pitch / (2 * (SAMPLES - 1))) + 1)
        return cls(np.asarray(cv2.blur(image, (side, side))), float(np.hypot(BLUR, side / 12**0.5)))


def refine_centres(image: Image, coarse: FloatArray, joints: Joints, duty: float) -> Centres:
    """Centres (rows, columns, 2) from the profiles of the blocks, starting from `coarse` (NaN: no block).

    A profile across a block gives the middle of its two sides, however blurred: the centre, in affine
    approximation. Perspective bends the scale, x(u) = x0 + a u + b u^2 / 2 in grid units, so the middle of
    u = -h and u = +h lies b h^2 / 2 off x0; b comes from the neighbours. `duty` is block over pitch.

    A print on the surface disturbs whole profiles more than it disturbs the sides alone. So blocks that do
    not fit in with their neighbours are measured again by their sides; what still does not fit is where its
    neighbours say, if those agree, and gone if nothing agrees.
    """
    right, down, _ = slopes(coarse, joints)
    pitch = np.minimum(_length(right), _length(down))
    known = np.isfinite(pitch)
    if not known.any():
        return Centres(np.full_like(coarse, np.nan), np.full(coarse.shape[:2], np.nan))
    smooth, sharp = _Smoothed.of(image, float(np.median(pitch[known]))), _Smoothed(image, BLUR)
    weights = np.zeros((known.size, 3))
    _weigh(smooth.pixels, *(np.reshape(a, (-1, 2)) for a in (coarse, right, down)), np.flatnonzero(known), weights)
    profiles, sides = _Profiles.of(smooth, duty), _Profiles.of_sides(sharp, duty)

    def measured(rows: BoolArray, start: FloatArray, profiles: _Profiles) -> FloatArray:
        """`start` with the blocks `rows` measured anew; NaN where they run away from where they were seen."""
        position, cells = start.copy(), np.flatnonzero(rows)
        for _ in range(ROUNDS if len(cells) else 0):
            right, down, bend = slopes(position, joints)
            there = [np.reshape(a, (-1, 2)) for a in (right, down, 0.5 * (duty / 2) ** 2 * bend, coarse, position)]
            profiles.measure(weights, cells, pitch.ravel(), *there)
            position[~known] = np.nan
        return position

    fitted = measured(known, coarse, profiles)
    first = agreement(fitted, joints)
    again = known & (first.odd | ~np.isfinite(fitted[..., 0]))
    by_sides = measured(again, np.where(again[..., None], coarse, fitted), sides)
    second = agreement(by_sides, joints) if again.any() else first
    lost = ~np.isfinite(by_sides[..., 0])
    unsure = again & (second.odd | lost | ~np.isfinite(fitted[..., 0]))
    between = _length(by_sides - fitted)
    straight = np.isfinite(second.expected[..., 0]) & (second.spread < STRAIGHT * first.sigma)
    position = np.where((unsure & straight)[..., None], second.expected, by_sides)
    limit = np.where(joints.inside(), DISAGREEMENT, RIM_DISAGREEMENT) * pitch
    position[unsure & ~straight & ~(between < limit)] = np.nan
    doubt = np.where(unsure, np.where(straight, second.spread, between), 0.0)
    doubt[~np.isfinite(position[..., 0])] = np.nan
    return Centres(position, doubt)


def _length(vector: FloatArray) -> FloatArray:
    return np.hypot(vector[..., 0], vector[..., 1])


_CELLS = numba.types.Array(numba.int64, 1, "C")


@compiled([numba.void(kind, *[MATRIX] * 3, _CELLS, OUT_MATRIX) for kind in PICTURES])
def _weigh(picture: Image, p: FloatArray, u: FloatArray, v: FloatArray, cells: IntArray, weights: FloatArray) -> None:
    """Weights (N, 3) that make one number of a colour: most where block and gaps differ most."""
    darkest = np.empty(3)
    for n in cells:
        darkest[:] = np.inf
        for a, b in ((0.5, 0.0), (-0.5, 0.0), (0.0, 0.5), (0.0, -0.5)):
            red, green, blue = bilinear(
                picture, p[n, 0] + a * u[n, 0] + b * v[n, 0], p[n, 1] + a * u[n, 1] + b * v[n, 1]
            )
            darkest[0], darkest[1] = min(darkest[0], red), min(darkest[1], green)
            darkest[2] = min(darkest[2], blue)
        red, green, blue = bilinear(picture, p[n, 0], p[n, 1])
        weights[n, 0] = max(red - darkest[0], 0.0) * CHANNEL_TRUST[0]
        weights[n, 1] = max(green - darkest[1], 0.0) * CHANNEL_TRUST[1]
        weights[n, 2] = max(blue - darkest[2], 0.0) * CHANNEL_TRUST[2]
        total = max(weights[n, 0] + weights[n, 1] + weights[n, 2], 1e-6)
        for k in range(3):
            weights[n, k] /= total


@dataclass(frozen=True, slots=True, eq=False)
class _Profiles:
    """How blocks are measured: by profiles of `picture` at `t` pitches along one axis, mean over `s` along the other.

    With `filters`, see `_filters`, by least squares of whole profiles. The profile is A B(t - d) + A1 B(t - 1) +
    A2 B(t + 1) + C: the block, its two neighbours' blur, the gap. To first order in d that is linear, so A and A d are
    two fixed filters of the profile.

    Without, by the two sides alone: a print elsewhere on the block does not matter. Each side is where the area under
    its profile says: with levels taken at the ends of a window about the side, it is off the middle of the window by
    (mean height - 1/2) of the window's length.
    """

    picture: _Smoothed
    t: FloatArray
    s: FloatArray
    filters: FloatArray

    @classmethod
    def of(cls, picture: _Smoothed, duty: float) -> _Profiles:
        return cls(picture, np.linspace(-REACH, REACH, SAMPLES), _beside(LINES, duty), _filters(duty))

    @classmethod
    def of_sides(cls, picture: _Smoothed, duty: float) -> _Profiles:
        window = SIDE_WINDOW * min(1 - duty, duty) / 2
        t = duty / 2 + np.linspace(-window, window, SIDE_SAMPLES)
        return cls(picture, t, _beside(SIDE_LINES, duty), np.empty((0, 2, SIDE_SAMPLES)))

    def measure(self, weights: FloatArray, cells: IntArray, pitch: FloatArray, *there: FloatArray) -> None:
        """Move the last of `there`, all (N, 2): right, down, shift from centre to middle, coarse, position."""
        how = self.picture.pixels, self.picture.blur_px, self.t, self.s, self.filters, weights
        in_two_threads(lambda n: _measure(*how, cells[n], pitch, *there), len(cells))


@compiled(
    [
        numba.void(
            kind, numba.float64, VECTOR, VECTOR, STACK, MATRIX, _CELLS, VECTOR, *[MATRIX] * 4, OUT_MATRIX
        )
        for kind in PICTURES
    ],
    nogil=True,
)  # fmt: skip
def _measure(
    picture: Image,
    blur_px: float,
    t: FloatArray,
    s: FloatArray,
    filters: FloatArray,
    weights: FloatArray,
    cells: IntArray,
    pitch: FloatArray,
    right: FloatArray,
    down: FloatArray,
    shift: FloatArray,
    coarse: FloatArray,
    position: FloatArray,
) -> None:
    profile, off = np.empty(len(t)), np.empty(2)
    for n in cells:
        x, y = position[n, 0] + shift[n, 0], position[n, 1] + shift[n, 1]
        if not np.isfinite(position[n, 0] + right[n, 0] + down[n, 0]):
            continue
        for axis in range(2):
            u, v = (right[n], down[n]) if axis == 0 else (down[n], right[n])
            if len(filters) > 0:
                read_profile(picture, weights[n], x, y, u, v, 1.0, t, s, profile)
                blur: float = blur_px / max(np.sqrt(u[0] ** 2 + u[1] ** 2), 1e-6)
                kind = 0
                while kind < len(BLUR_BORDERS) and BLUR_BORDERS[kind] < blur:
                    kind += 1
                height, moved = 0.0, 0.0
                for i in range(len(t)):
                    height += filters[kind, 0, i] * profile[i]
                    moved += filters[kind, 1, i] * profile[i]
                off[axis] = min(max(moved / max(height, 1e-6), -FARTHEST_FIT), FARTHEST_FIT)
            else:
                off[axis] = 0.0
                for sign in (1.0, -1.0):
                    read_profile(picture, weights[n], x, y, u, v, sign, t, s, profile)
                    total, last = 0.0, profile[len(t) - 1]
                    for i in range(len(t)):
                        total += profile[i]
                    height = (total / len(t) - last) / max(profile[0] - last, 1e-6)
                    off[axis] += sign * (min(max(height, 0.0), 1.0) - 0.5) * (t[-1] - t[0]) / 2
        for k in range(2):
            position[n, k] += off[0] * right[n, k] + off[1] * down[n, k]
        if not np.hypot(position[n, 0] - coarse[n, 0], position[n, 1] - coarse[n, 1]) < FARTHEST * pitch[n]:
            position[n] = np.nan


@cache
def _filters(duty: float) -> FloatArray:
    """For each of BLURS, the filters (len(BLURS), 2, SAMPLES) that give A and A d of a profile."""
    from scipy.special import ndtr

    t = np.linspace(-REACH, REACH, SAMPLES)
    filters: list[FloatArray] = []
    for blur in BLURS:

        def block(x: FloatArray, blur: float = blur) -> FloatArray:
            return ndtr((x + duty / 2) / blur) - ndtr((x - duty / 2) / blur)

        step = 1e-4
        slope = (block(t - step) - block(t + step)) / (2 * step)
        terms = np.stack([block(t), slope, block(t - 1), block(t + 1), np.ones_like(t)], axis=-1)
        filters.append(np.asarray(np.linalg.pinv(terms)[:2], dtype=np.float64))
    return np.stack(filters)


def _beside(lines: int, duty: float) -> FloatArray:
    return np.linspace(-0.5, 0.5, lines) * duty * SPREAD
