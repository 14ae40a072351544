"""The image of each block's centre, to a small part of a pixel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from retrue.decoding.grid_lines import agreement
from retrue.decoding.grid_sampling import PICTURES, in_two_threads, read_profile, sample
from retrue.decoding.grid_surface import Joints, slopes
from retrue.geometry.arrays import BoolArray, FloatArray, Image
from retrue.geometry.compiling import MATRIX, OUT_MATRIX, STACK, VECTOR, compiled, numba

LINES = 3  # profiles side by side, over the middle of the block
SIDE_LINES = 9  # along each side, where a print disturbs the profiles
SPREAD = 0.8  # of a block's side that the lines cover
REACH = 0.5  # pitches that a profile reaches to either side: to the middle of the gaps
SAMPLES = 9  # along a profile
BLUR = 1.0  # px, standard deviation of a typical edge; the fit hardly depends on it
BLURS = np.geomspace(0.02, 0.4, 25)  # in pitches: one filter each
BLUR_BORDERS = np.sqrt(BLURS[1:] * BLURS[:-1])  # where the next filter takes over
SIDE_SAMPLES = 9  # across one side
SIDE_WINDOW = 0.88  # of half a gap: how far those reach from the side
CHANNEL_TRUST = np.array([1.0, 2.0, 1.0])  # green is sampled twice as densely, and never subsampled
ROUNDS = 2
FARTHEST_FIT = 0.15  # pitches that one fit may move a centre
FARTHEST = 0.12  # of a pitch that a centre may lie off the middle of its blob
STRAIGHT = 4.0  # sigmas by which lines through one block may differ on a smooth surface
DISAGREEMENT = 0.06  # of a pitch between two ways to measure: more, and the block is cut
RIM_DISAGREEMENT = 0.03  # the same at the rim of a surface, where cut blocks are

_Offset = Callable[["_Smoothed", FloatArray, FloatArray, FloatArray, FloatArray, float], FloatArray]


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
    weights = np.zeros((*known.shape, 3))
    weights[known] = _color_weights(smooth, coarse[known], right[known], down[known])

    def measured(rows: BoolArray, start: FloatArray, picture: _Smoothed, offset: _Offset) -> FloatArray:
        """`start` with the blocks `rows` measured anew; NaN where they run away from where they were seen."""
        position = start.copy()
        for _ in range(ROUNDS):
            right, down, bend = slopes(position, joints)
            now = rows & np.isfinite(position[..., 0] + right[..., 0] + down[..., 0])
            if not now.any():
                break
            shift = 0.5 * (duty / 2) ** 2 * bend[now]
            p, u, v, w = position[now] + shift, right[now], down[now], weights[now]
            off = offset(picture, w, p, u, v, duty)
            position[now] = p + off[:, :1] * u + off[:, 1:] * v - shift
            position[~(_length(position - coarse) < FARTHEST * pitch)] = np.nan
        return position

    fitted = measured(known, coarse, smooth, _profile_offset)
    first = agreement(fitted, joints)
    again = known & (first.odd | ~np.isfinite(fitted[..., 0]))
    by_sides = measured(again, np.where(again[..., None], coarse, fitted), sharp, _side_offset)
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


def _color_weights(picture: _Smoothed, p: FloatArray, u: FloatArray, v: FloatArray) -> FloatArray:
    """Weights (N, 3) that make one number of a colour: most where block and gaps differ most."""
    seen = sample(picture.pixels, np.stack([p, p + u / 2, p - u / 2, p + v / 2, p - v / 2], axis=1))
    added = np.maximum(seen[:, 0] - seen[:, 1:].min(axis=1), 0) * CHANNEL_TRUST
    return added / np.maximum(added.sum(axis=1, keepdims=True), 1e-6)


def _profile_offset(
    picture: _Smoothed, weights: FloatArray, p: FloatArray, u: FloatArray, v: FloatArray, duty: float
) -> FloatArray:
    """How far along u and v, in pitches, the middles of the blocks are from p, (N, 2): least squares of whole profiles.

    The profile is A B(t - d) + A1 B(t - 1) + A2 B(t + 1) + C: the block, its two neighbours' blur, the gap. To first
    order in d that is linear, so A and A d are two fixed filters of the profile.
    """
    t, s, off = np.linspace(-REACH, REACH, SAMPLES), _beside(LINES, duty), np.empty((len(p), 2))
    filters = _filters(duty)

    def fit(n: slice) -> None:
        _fit_profiles(picture.pixels, weights[n], p[n], u[n], v[n], t, s, filters, picture.blur_px, off[n])

    in_two_threads(fit, len(p))
    return off


@compiled(
    [numba.void(kind, *[MATRIX] * 4, VECTOR, VECTOR, STACK, numba.float64, OUT_MATRIX) for kind in PICTURES], nogil=True
)
def _fit_profiles(
    picture: Image,
    weights: FloatArray,
    p: FloatArray,
    u: FloatArray,
    v: FloatArray,
    t: FloatArray,
    s: FloatArray,
    filters: FloatArray,
    blur_px: float,
    off: FloatArray,
) -> None:
    profile = np.empty(len(t))
    for n in range(len(p)):
        for axis in range(2):
            along, beside = (u[n], v[n]) if axis == 0 else (v[n], u[n])
            read_profile(picture, weights[n], p[n], along, beside, t, s, profile)
            blur = blur_px / max(np.sqrt(along[0] ** 2 + along[1] ** 2), 1e-6)
            kind = np.searchsorted(BLUR_BORDERS, blur)
            height, shift = 0.0, 0.0
            for i in range(len(t)):
                height += filters[kind, 0, i] * profile[i]
                shift += filters[kind, 1, i] * profile[i]
            off[n, axis] = min(max(shift / max(height, 1e-6), -FARTHEST_FIT), FARTHEST_FIT)


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
        filters.append(np.linalg.pinv(terms)[:2])
    return np.stack(filters)


def _side_offset(
    picture: _Smoothed, weights: FloatArray, p: FloatArray, u: FloatArray, v: FloatArray, duty: float
) -> FloatArray:
    """The same from the two sides alone: a print elsewhere on the block does not matter.

    Each side is where the area under its profile says: with levels taken at the ends of a window about the side, it is
    off the middle of the window by (mean height - 1/2) of the window's length.
    """
    window = SIDE_WINDOW * min(1 - duty, duty) / 2
    t = duty / 2 + np.linspace(-window, window, SIDE_SAMPLES)
    s, off = _beside(SIDE_LINES, duty), np.empty((len(p), 2))

    def find(n: slice) -> None:
        _find_sides(picture.pixels, weights[n], p[n], u[n], v[n], t, s, off[n])

    in_two_threads(find, len(p))
    return off


@compiled([numba.void(kind, *[MATRIX] * 4, VECTOR, VECTOR, OUT_MATRIX) for kind in PICTURES], nogil=True)
def _find_sides(
    picture: Image,
    weights: FloatArray,
    p: FloatArray,
    u: FloatArray,
    v: FloatArray,
    t: FloatArray,
    s: FloatArray,
    off: FloatArray,
) -> None:
    profile, window = np.empty(len(t)), (t[-1] - t[0]) / 2
    for n in range(len(p)):
        for axis in range(2):
            along, beside = (u[n], v[n]) if axis == 0 else (v[n], u[n])
            off[n, axis] = 0.0
            for sign in (1, -1):
                read_profile(picture, weights[n], p[n], along, beside, sign * t, s, profile)
                height = (profile.mean() - profile[-1]) / max(profile[0] - profile[-1], 1e-6)
                off[n, axis] += sign * (min(max(height, 0.0), 1.0) - 0.5) * window


def _beside(lines: int, duty: float) -> FloatArray:
    return np.linspace(-0.5, 0.5, lines) * duty * SPREAD
