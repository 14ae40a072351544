"""Pictures of one sine at several shifts to its phase, modulation, and how well the phase is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from math import prod

import numpy as np
from numpy.typing import NDArray

from retrue.decoding.light import FULL
from retrue.decoding.sequence.noise import FloatImage, Noise
from retrue.geometry.arrays import BoolArray, FloatArray, Image
from retrue.kernels import sines as kernel
from retrue.patterns.sequence import Sine

SMALLEST_SQUARE = 1e-6
"""Of the modulation: of less there is no phase."""


@dataclass(frozen=True, slots=True, eq=False)
class Wrapped:
    """A sine's phase, but for whole turns, in each pixel of a band.

    Attributes
    ----------
    period_px : of the sine.
    phase : (x / period_px) modulo 1, in turns.
    variance : of the phase, in turns^2.
    modulation : half the difference of brightest and darkest, in grey levels.
    saturated : whether a picture is at the end of its scale.
    """

    period_px: float
    phase: FloatImage
    variance: FloatImage
    modulation: FloatImage
    saturated: BoolArray


def demodulate(pictures: Sequence[Image], sine: Sine, noise: Noise, pixels: NDArray[np.intp] | None = None) -> Wrapped:
    """Least squares of B + A cos(2 pi (phase - shift_k)) in each pixel, or in those of the flat indices `pixels`.

    For N equal shifts that is the phase atan2(sum I_k sin, sum I_k cos); its variance is propagated from each picture's
    own noise, sigma_phase = sigma_I sqrt(2 / N) / A radians where that is the same for all.

    Source: Bruning et al., "Digital wavefront measuring interferometer", Applied Optics 13, 1974.
    """
    shape, dtype = pictures[0].shape if pixels is None else pixels.shape, pictures[0].dtype
    cosine, sine_row = _weights(sine.shifts)
    floor = noise.floor * np.array([np.sum(cosine**2), np.sum(cosine * sine_row), np.sum(sine_row**2)])
    seen = np.empty((len(pictures), prod(shape)), dtype)
    for row, picture in zip(seen, pictures, strict=True):
        if pixels is None:
            row[:] = picture.reshape(-1)
        else:
            np.take(picture, pixels, out=row, mode="clip")
    found, saturated = np.empty((3, seen.shape[1]), np.float32), np.empty(seen.shape[1], np.uint8)
    kernel.demodulate(
        seen,
        np.stack([cosine, sine_row], axis=1, dtype=np.float32),
        floor.astype(np.float32),
        noise.gain,
        sine.offset_px / sine.period_px % 1.0,
        FULL * np.iinfo(dtype).max,
        SMALLEST_SQUARE,
        found,
        saturated,
    )
    phase, variance, modulation = found.reshape(3, *shape)
    return Wrapped(sine.period_px, phase, variance, modulation, saturated.view(np.bool_).reshape(shape))


@cache
def _weights(shifts: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    """Of the pictures, in A cos(phase) and A sin(phase)."""
    angles = 2 * np.pi * np.array(shifts)
    design = np.stack([np.ones_like(angles), np.cos(angles), np.sin(angles)], axis=1)
    _, cosine, sine = np.linalg.pinv(design)
    return cosine, sine


def beat(short: Wrapped, long: Wrapped) -> Wrapped:
    """The sine that two of unlike periods make: as many periods fewer as they differ by.

    1 / period = 1 / short - 1 / long, phase the difference.
    """
    phase = short.phase - long.phase
    phase -= np.floor(phase)
    period = 1 / (1 / short.period_px - 1 / long.period_px)
    return Wrapped(
        period,
        phase,
        short.variance + long.variance,
        np.minimum(short.modulation, long.modulation),
        short.saturated | long.saturated,
    )


def harmonics(phase: NDArray[np.floating], orders: Sequence[int]) -> NDArray[np.floating]:
    """(2 M, ...) cosine and sine of each multiple of the phase, which is in turns."""
    angles = [2 * np.pi * order * phase for order in orders]
    return np.stack([wave(angle) for angle in angles for wave in (np.cos, np.sin)])
