"""How noisy the pictures of sines are, measured on themselves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from retrue.decoding.light import FULL
from retrue.geometry.arrays import BoolArray, FloatArray, Image
from retrue.geometry.robust import MAD_TO_SIGMA
from retrue.patterns.sequence import Sine

FloatImage = NDArray[np.float32]
FLOOR = 1 / 12
"""Grey levels squared: what rounding leaves."""
SAMPLE_BLOCKS, BLOCK = 10, 32
"""Along each side of the picture, and rows and columns of each block that is looked at."""
HIGH_PASS_GAIN = 36.0
"""Variance of white noise behind the high-pass along rows and columns."""
LEVELS = 8
"""Of brightness, with as many pixels in each."""
LEAST_PIXELS = 200
LIT = 0.1
"""Of the strongest modulation: less tells little of noise where there is light."""
NULL = 1e-8


@dataclass(frozen=True, slots=True)
class Noise:
    """Variance of a pixel: floor + gain * brightness, in grey levels squared.

    >>> Noise(1.0, 0.02).at(np.array([0.0, 50.0])).tolist()
    [1.0, 2.0]
    """

    floor: float
    gain: float

    def at(self, brightness: NDArray[np.floating]) -> NDArray[np.floating]:
        """Variance at that brightness."""
        return self.floor + self.gain * brightness


def measure_noise(pictures: Sequence[Image], sines: Sequence[Sequence[Sine]]) -> Noise:
    """From what no scene explains: combinations of pictures that any brightness and any sines leave at zero.

    All sines share the brightness of the scene. Where there are three pictures alone, nothing is left at zero, and each
    picture tells for itself. What changes slowly over the picture, as gamma's harmonics do, is filtered out; of each
    level of brightness the median counts, so that edges do not.

    Source of the filter: Immerkaer, "Fast noise variance estimation", 1996.

    Parameters
    ----------
    pictures : of the sequence, grey.
    sines : of each axis that has any.
    """
    shown = sorted({index for axis in sines for sine in axis for index in sine.pictures})
    blocks = _blocks(pictures[shown[0]].shape)
    stacks = np.stack([np.stack([pictures[index][block] for block in blocks]) for index in shown]).astype(np.float32)
    told = _lit(stacks, FULL * np.iinfo(pictures[shown[0]].dtype).max)
    combinations = unexplained(shown, sines)
    combinations = combinations if len(combinations) else np.eye(len(shown))
    flat, weights = stacks.reshape(len(shown), -1), combinations.astype(np.float32)
    seen, brightness = ((own @ flat).reshape(-1, *stacks.shape[1:]) for own in (weights, weights**2))
    scatter = [_high_pass(own)[told] / np.float32(np.sqrt(HIGH_PASS_GAIN)) for own in seen]
    levels = [own[:, 1:-1, 1:-1][told] for own in brightness]
    return _fitted(np.concatenate(levels), np.concatenate(scatter))


def _lit(stacks: FloatImage, full: float) -> BoolArray:
    """Where the sines are seen, and no neighbour is at an end of the scale; less a border of one.

    Where hardly any is above its lower end, all count that are below the upper one.
    """
    low, high = stacks.min(axis=0), stacks.max(axis=0)
    lit = high - low > LIT * np.percentile(high - low, 99)
    inside = high < full
    if np.count_nonzero(inside & lit & (low > 0)) > LEVELS * LEAST_PIXELS:
        inside &= low > 0
    around = [inside[:, r : r + inside.shape[1] - 2, c : c + inside.shape[2] - 2] for r in range(3) for c in range(3)]
    return lit[:, 1:-1, 1:-1] & np.all(around, axis=0)


def unexplained(shown: Sequence[int], sines: Sequence[Sequence[Sine]]) -> FloatArray:
    """(M, N) combinations of unit length of the N pictures that any brightness and any sines leave at zero."""
    where = {index: row for row, index in enumerate(shown)}
    columns = [np.ones(len(shown))]
    for axis in sines:
        for sine in axis:
            for wave in (np.cos, np.sin):
                column = np.zeros(len(shown))
                column[[where[index] for index in sine.pictures]] = wave(2 * np.pi * np.array(sine.shifts))
                columns.append(column)
    _, values, rows = np.linalg.svd(np.stack(columns))
    return rows[int(np.sum(values > NULL * values[0])) :]


def _blocks(shape: tuple[int, ...]) -> list[tuple[slice, slice]]:
    """Blocks of one size, spread over the picture."""
    height, width = shape
    rows, columns = min(BLOCK, height), min(BLOCK, width)
    tops = np.linspace(0, height - rows, SAMPLE_BLOCKS).astype(int)
    lefts = np.linspace(0, width - columns, SAMPLE_BLOCKS).astype(int)
    return [(slice(top, top + rows), slice(left, left + columns)) for top in tops for left in lefts]


def _high_pass(seen: FloatImage) -> FloatImage:
    """Second differences along rows and columns of each block."""
    rows = seen[:, :-2] - 2 * seen[:, 1:-1] + seen[:, 2:]
    return np.asarray(rows[..., :-2] - 2 * rows[..., 1:-1] + rows[..., 2:], np.float32)


def _fitted(levels: FloatImage, scatter: FloatImage) -> Noise:
    """Floor and gain from the scatter at several levels of brightness."""
    if not len(levels):
        return Noise(FLOOR, 0.0)
    ends = np.cumsum([len(part) for part in np.array_split(levels, LEVELS)])[:-1]
    order = np.argpartition(levels, ends[ends < len(levels)])
    least = max(min(LEAST_PIXELS, len(order) // LEVELS), 1)
    parts = [part for part in np.split(order, ends) if len(part) >= least]
    brightness = np.array([float(np.mean(levels[part])) for part in parts])
    variance = np.array([(MAD_TO_SIGMA * float(np.median(np.abs(scatter[part])))) ** 2 for part in parts])
    if float(np.ptp(brightness)) > 1:
        weight = 1 / np.maximum(variance, FLOOR)
        design = np.stack([np.ones_like(brightness), brightness], axis=1)
        floor, gain = np.linalg.lstsq(design * weight[:, None], variance * weight, rcond=None)[0]
        if gain >= 0 and floor >= FLOOR:
            return Noise(float(floor), float(gain))
        if gain > 0:
            return Noise(FLOOR, max(float(np.average((variance - FLOOR) / brightness, weights=weight**2)), 0.0))
    return Noise(max(float(np.median(variance)), FLOOR), 0.0)
