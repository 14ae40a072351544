"""Creases of a surface: where two smooth sides meet, and what the surface is beside them.

A quadric through a window rounds a crease off, and in windows that are small enough to come near one, noise hides it.
So two explanations are held against each other on both sides of a line through each point, over half discs: one
surface, or two that meet in a crease. L and R are what the quadrics of the two halves, each by itself, have at the
point, and J is by how much their slopes away from the line add up. Of one quadric L = R and J = 0, but for noise. Of a
crease J is the jump of slope, and the point lies on the side whose quadric the other one, continued, stays below where
J > 0, and above where J < 0. So the surface is

    max(L, R) where J > 0, min(L, R) where J < 0,

on whichever side of the crease the point is. A few cells further, where the crease lies within one half, that one's
quadric overshoots, J turns its sign, and the other half is still the one that is taken. Lines are asked in eight
directions; the one with the surest jump counts.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, cast

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.geometry.robust import MAD_TO_SIGMA

DIRECTIONS = 8
SURE = 4.0
"""Sigmas of a jump: of noise one point in two thousand has that in any direction, of which few are wrong by much."""
FEWEST = 500  # differences that tell their noise


@dataclass(frozen=True, slots=True, eq=False)
class Creases:
    """What is beside a crease, (H, W).

    Attributes
    ----------
    told : where there is one.
    values : of the surface there.
    left : share of the variance of one value that noise leaves.
    """

    told: BoolArray
    values: FloatArray
    left: FloatArray


def find_creases(values: FloatArray, variance: FloatArray, ends: BoolArray, fits: BoolArray, radius: int) -> Creases:
    """Creases of `values` (H, W), finite everywhere.

    Parameters
    ----------
    variance : (H, W) of the values. ends : (H, W) cells in which the surface ends, or without one.
    fits : (H, W) where one quadric fits all of the disc, so that differences are noise; it may be less than independent
        neighbours have, or more.
    radius : of the discs, in cells.
    """
    sigma = np.sqrt(np.where(variance > 0, variance, np.inf))
    one, apart, jump = _noise(radius).T
    levels: list[float] = []
    for direction in (0, DIRECTIONS // 2):
        line = _Line.of(values, ends, radius, direction)
        for part, noise in ((line.apart, apart), (line.jump, jump)):
            levels.append(_level((part / sigma)[line.whole & fits] / noise[direction]))
    apart_level, jump_level = (float(np.mean(levels[k::2])) for k in (0, 1))
    surest, left, found = np.full(values.shape, SURE), np.ones(values.shape), values.copy()
    for direction in range(DIRECTIONS):
        line = _Line.of(values, ends, radius, direction)
        sure = np.where(line.whole, np.abs(line.jump) / (jump_level * jump[direction] * sigma), 0.0)
        here = sure > surest
        surest[here], found[here], left[here] = sure[here], line.value[here], (apart_level * one[direction]) ** 2
    return Creases(surest > SURE, found, left)


@dataclass(frozen=True, slots=True, eq=False)
class _Line:
    """What the halves on both sides of a line say, (H, W): `whole` where the surface goes on through both."""

    whole: BoolArray
    value: FloatArray
    apart: FloatArray
    jump: FloatArray

    @classmethod
    def of(cls, values: FloatArray, ends: BoolArray, radius: int, direction: int) -> _Line:
        first, second = (_half(values, ends, radius, direction + turn) for turn in (0, DIRECTIONS))
        jump = first[1] + second[1]
        value = np.where(jump > 0, np.maximum(first[0], second[0]), np.minimum(first[0], second[0]))
        return cls(first[2] & second[2], value, first[0] - second[0], jump)


def _level(differences: FloatArray) -> float:
    """How many times as large they are as independent neighbours make them; of few, as large."""
    return MAD_TO_SIGMA * float(np.median(np.abs(differences))) if len(differences) >= FEWEST else 1.0


def _half(values: FloatArray, ends: BoolArray, radius: int, direction: int) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Of the half disc on that side: value and slope at the point, and whether the surface goes on through it."""
    filters, disc = _halves(radius)[direction]
    value, slope = (_correlated(values, filter_) for filter_ in filters)
    reached = _correlated(np.pad(ends, radius, constant_values=True).astype(np.float64), disc.astype(np.float64))
    return value, slope, reached[radius:-radius, radius:-radius] < 0.5


def _correlated(values: FloatArray, filter_: FloatArray) -> FloatArray:
    """(H, W) values, weighted; 0 beyond the border."""
    from scipy import signal

    return np.asarray(cast("Any", signal).oaconvolve(values, filter_[::-1, ::-1], mode="same"), np.float64)


@cache
def _noise(radius: int) -> FloatArray:
    """(DIRECTIONS, 3) sigma of a half's value, of the difference of both, and of their jump, of white noise of 1."""
    first, second = np.split(np.stack([filters for filters, _ in _halves(radius)]), 2)
    parts = first[:, 0], first[:, 0] - second[:, 0], first[:, 1] + second[:, 1]
    return np.sqrt(np.stack([(part**2).sum(axis=(1, 2)) for part in parts], axis=1))


@cache
def _halves(radius: int) -> list[tuple[FloatArray, BoolArray]]:
    """Of each direction the filters (2, side, side) of value and slope at the middle of the line, and the half disc."""
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1] / radius
    found: list[tuple[FloatArray, BoolArray]] = []
    for angle in np.arange(2 * DIRECTIONS) * np.pi / DIRECTIONS:
        away, along = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
        disc = (away > -1e-9) & (away**2 + along**2 < 1 + 1e-9)
        u, v = away[disc], along[disc]
        terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=1)
        filters = np.zeros((2, *disc.shape))
        filters[:, disc] = np.linalg.pinv(terms)[:2]
        filters[1] /= radius
        found.append((filters, disc))
    return found
