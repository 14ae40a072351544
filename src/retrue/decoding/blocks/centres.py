"""The image of each block's centre, to a small part of a pixel, and how far it may be off."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import erf

import cv2
import numpy as np

from retrue.decoding.blocks.growth import readable
from retrue.decoding.surface import (
    Joints,
    bends,
    between_neighbours,
    lengths,
    mean_around,
    median,
    odd_blocks,
    slopes,
    usual_variance,
)
from retrue.geometry.arrays import BoolArray, FloatArray, Image, IntArray
from retrue.kernels import profiles as kernel

LINES = 3  # profiles side by side, over the middle of the block
SIDE_LINES = 5  # along each side, where a print disturbs the profiles
SPREAD = 0.8  # of a block's side that the lines cover
PROFILE_REACH = 0.5  # pitches that a profile reaches to either side: to the middle of the gaps
SAMPLES = 9  # along a profile
BLUR = 1.0  # px, standard deviation of a typical edge; the fit hardly depends on it
BLURS = np.geomspace(0.02, 0.4, 25)  # in pitches: one filter each
BLUR_BORDERS: FloatArray = np.sqrt(BLURS[1:] * BLURS[:-1])  # where the next filter takes over
SIDE_SAMPLES = 9  # across one side
SIDE_WINDOW = 0.88  # of half a gap: how far those reach from the side
CHANNEL_TRUST = np.array([1.0, 2.0, 1.0])  # green is sampled twice as densely, and never subsampled
ROUNDS = 2
FARTHEST = 0.12  # of a pitch that a centre may lie off the middle of its blob
UNLIKE = 2.0  # times the usual distance between two ways to measure a block
STRAIGHT = 4.0  # sigmas by which lines through one block may differ on a smooth surface
SHADING_STEPS = 3  # of a walk from block to block: its mean is over a dozen of them
DISAGREEMENT = 0.06  # of a pitch between two ways to measure: more, and the block is cut
RIM_DISAGREEMENT = 0.03  # the same at the rim of a surface, where cut blocks are


@dataclass(frozen=True, slots=True, eq=False)
class Centres:
    """Of every block of the code, (rows, columns, ...); NaN where there is none.

    Attributes
    ----------
    camera_px : (rows, columns, 2) the image of the centre.
    doubt_px : (rows, columns) what it may be off beyond noise, one standard deviation; 0 of many.
    unlike : (rows, columns) bool, blocks that two ways to measure place further apart than they do others.
    """

    camera_px: FloatArray
    doubt_px: FloatArray
    unlike: BoolArray


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
    approximation. Perspective and bent surfaces bend the scale, x(u) = x0 + a u + b u^2 / 2 in grid units, so
    the middle of u = -h and u = +h lies b h^2 / 2 off x0; b comes from the neighbours. `duty` is block over pitch.

    A print on the surface disturbs whole profiles more than it disturbs the sides alone. So blocks that do
    not fit in with their neighbours are measured again by their sides; what still does not fit is where its
    neighbours say, if those agree, and gone if nothing agrees.
    """
    right, down = slopes(coarse, joints)
    pitch = np.minimum(lengths(right), lengths(down))
    known = np.isfinite(pitch)
    if not known.any():
        return Centres(np.full_like(coarse, np.nan), np.full(coarse.shape[:2], np.nan), known)
    smooth = _Smoothed.of(image, median(pitch[known]))
    weights = np.zeros((known.size, 3))
    there = coarse.reshape(-1, 2), right.reshape(-1, 2), down.reshape(-1, 2)
    kernel.weigh_channels(*readable(smooth.pixels), *there, CHANNEL_TRUST, weights)

    def measured(
        rows: BoolArray, start: FloatArray, profiles: _Profiles, bend: FloatArray, rounds: int = ROUNDS
    ) -> FloatArray:
        """`start` with the blocks `rows` measured anew; NaN where they run away from where they were seen."""
        position, blocks, off_centre = start.copy(), np.flatnonzero(rows), profiles.off_centre(bend, duty)
        for _ in range(rounds if len(blocks) else 0):
            right, down = slopes(position, joints)
            profiles.measure(weights, blocks, right, down, off_centre, position)
            position[~(lengths(position - coarse) < FARTHEST * pitch)] = np.nan
        return position

    sides = _Profiles.of_sides(_Smoothed(image, BLUR), duty)
    profiles, shaded = _Profiles.of(smooth, duty), _Profiles.of(smooth, duty, shaded=True)
    first = measured(known, coarse, profiles, bends(coarse, joints), 1)
    bend = bends(first, joints)
    whole = measured(known, first, profiles, bend, 1)
    whole -= _moved_by_shading(whole, measured(known, whole, shaded, bend, 1), joints)
    apart = measured(known, whole, sides, bend, 1) - whole
    fitted = _better_of(whole, whole + apart, joints)
    between = lengths(apart)
    told = np.isfinite(between)
    unlike = ~(between < UNLIKE * (median(between[told]) if told.any() else 0.0))
    disagree = _disagreement(apart)
    odd, sigma = odd_blocks(fitted, joints)
    again = known & (odd | ~np.isfinite(fitted[..., 0]))
    if not again.any():
        return Centres(fitted, np.where(np.isfinite(fitted[..., 0]), disagree, np.nan), unlike)
    by_sides = measured(again, np.where(again[..., None], coarse, fitted), sides, bend)
    odd, _ = odd_blocks(by_sides, joints)
    expected, spread = between_neighbours(by_sides, odd, joints)
    unsure = again & (odd | ~np.isfinite(by_sides[..., 0] + fitted[..., 0]))
    between = lengths(by_sides - fitted)
    straight = np.isfinite(expected[..., 0]) & (spread < STRAIGHT * sigma)
    position = np.where((unsure & straight)[..., None], expected, by_sides)
    limit = np.where(joints.inside(), DISAGREEMENT, RIM_DISAGREEMENT) * pitch
    position[unsure & ~straight & ~(between < limit)] = np.nan
    doubt = np.where(unsure, np.where(straight, spread, between), disagree)
    doubt[~np.isfinite(position[..., 0])] = np.nan
    return Centres(position, doubt, unlike)


def _better_of(whole: FloatArray, sides: FloatArray, joints: Joints) -> FloatArray:
    """(rows, columns, 2) the mean of two ways to measure, weighted by how little each scatters all over the picture."""
    of_whole, of_sides = (usual_variance(position, joints) for position in (whole, sides))
    share = of_whole / (of_whole + of_sides) if of_sides > 0 else 1.0  # of a drawing, which has no noise
    return np.where(np.isfinite(sides), share * sides + (1 - share) * whole, whole)


def _disagreement(apart: FloatArray) -> FloatArray:
    """(rows, columns) px that the mean of two ways to measure may be off beyond noise, one sigma, by how far they are
    `apart`.

    An edge, or the light of another surface, moves each of them as far as it likes: their mean is off by half of what
    they differ more than usual.
    """
    squares = (apart**2).mean(axis=-1)
    known = np.isfinite(squares)
    usual = median(squares[known]) / np.log(2) if known.any() else 0.0
    return np.where(known, np.sqrt(np.maximum(squares - usual, 0.0)) / 2, 0.0)


def _moved_by_shading(fitted: FloatArray, shaded: FloatArray, joints: Joints) -> FloatArray:
    """How far light that falls off across a block moves its profile's middle: (rows, columns, 2), 0 where unknown.

    That is where a fit which allows for the slope of the light has the centre otherwise, `shaded`. One block's own
    slope is mostly noise, but shading is slow: the mean of the blocks around tells, shrunk by how sure it is (the
    positive part of James and Stein's estimator).
    """
    moved = fitted - shaded
    mean, share = mean_around(moved, joints, SHADING_STEPS)
    off = moved - mean
    known = np.isfinite(off[..., 0])
    if not known.any():
        return np.zeros_like(fitted)
    variance = median((off[known] ** 2).sum(axis=-1)) / np.log(2)  # of both coordinates
    with np.errstate(invalid="ignore", divide="ignore"):
        kept = np.fmax(1 - variance * share / (mean**2).sum(axis=-1), 0)
    return np.where(known[..., None], kept[..., None] * mean, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class _Profiles:
    """How blocks are measured: by profiles of `picture` at `t` pitches along one axis, mean over `s` along the other.

    With `filters`, see `_filters`, by least squares of whole profiles. The profile is A B(t - d) + A1 B(t - 1) +
    A2 B(t + 1) + C: the block, its two neighbours' blur, the gap; `shaded` adds A g t B(t), light that falls off across
    the block. To first order in d that is linear, so A and A d are two fixed filters of the profile.

    Without, by the two sides alone: a print elsewhere on the block does not matter. Each side is where the area under
    its profile says: with levels taken at the ends of a window about the side, it is off the middle of the window by
    (mean height - 1/2) of the window's length.
    """

    picture: _Smoothed
    t: FloatArray
    s: FloatArray
    filters: FloatArray

    @classmethod
    def of(cls, picture: _Smoothed, duty: float, shaded: bool = False) -> _Profiles:
        t = np.linspace(-PROFILE_REACH, PROFILE_REACH, SAMPLES)
        return cls(picture, t, beside(LINES, duty), _filters(duty, shaded))

    @classmethod
    def of_sides(cls, picture: _Smoothed, duty: float) -> _Profiles:
        return cls(picture, side_window(duty), beside(SIDE_LINES, duty), np.empty((0, 2, SIDE_SAMPLES)))

    def off_centre(self, bend: FloatArray, duty: float) -> FloatArray:
        """(rows, columns, 2, 2) from the centre to the middle of the two sides, along the row and along the column.

        By second derivatives (rows, columns, 2, 2).
        """
        return off_centre(bend, duty, self.s)

    def measure(
        self,
        weights: FloatArray,
        blocks: IntArray,
        right: FloatArray,
        down: FloatArray,
        shift: FloatArray,
        position: FloatArray,
    ) -> None:
        """Move `position` of `blocks`, by their steps (rows, columns, 2) to the right and down, and `off_centre`."""
        picture, room = readable(self.picture.pixels), np.empty(len(self.t))
        there = right.reshape(-1, 2), down.reshape(-1, 2), shift.reshape(-1, 4)
        if len(self.filters):
            how = self.picture.blur_px, self.t, self.s, self.filters, BLUR_BORDERS, weights, blocks
            kernel.fit_profiles(*picture, *how, *there, room, position.reshape(-1, 2))
        else:
            kernel.fit_sides(*picture, self.t, self.s, weights, blocks, *there, room, position.reshape(-1, 2))


@cache
def _filters(duty: float, shaded: bool) -> FloatArray:
    """For each of BLURS, the filters (len(BLURS), 2, SAMPLES) that give A and A d of a profile."""
    t = np.linspace(-PROFILE_REACH, PROFILE_REACH, SAMPLES)
    filters: list[FloatArray] = []
    for blur in BLURS:

        def block(x: FloatArray, blur: float = blur) -> FloatArray:
            edges = (np.array([x + duty / 2, x - duty / 2]) / (blur * 2**0.5)).tolist()
            return np.array([erf(a) - erf(b) for a, b in zip(*edges, strict=True)]) / 2

        step = 1e-4
        slope = (block(t - step) - block(t + step)) / (2 * step)
        terms = [block(t), slope, block(t - 1), block(t + 1), np.ones_like(t)]
        if shaded:
            terms.append(t * block(t))
        filters.append(np.asarray(np.linalg.pinv(np.stack(terms, axis=-1))[:2], dtype=np.float64))
    return np.stack(filters)


def off_centre(bend: FloatArray, duty: float, s: FloatArray) -> FloatArray:
    """(..., 2, 2) px from a centre to the middle of two sides h away, mean over lines s beside the centre: half of
    h^2 x_uu + s^2 x_vv, with `bend` the second derivatives."""
    return 0.5 * ((duty / 2) ** 2 * bend + float((s**2).mean()) * bend[..., ::-1, :])


def side_window(duty: float) -> FloatArray:
    """Samples about one side, in pitches from the centre: nearly from the middle of the block to that of the gap."""
    window = SIDE_WINDOW * min(1 - duty, duty) / 2
    return duty / 2 + np.linspace(-window, window, SIDE_SAMPLES)


def beside(lines: int, duty: float) -> FloatArray:
    """Profiles side by side, in pitches from the centre."""
    return np.linspace(-0.5, 0.5, lines) * duty * SPREAD
