"""Pictures of one sine at several shifts to its phase, modulation, and how well the phase is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from retrue.decoding.light import FULL
from retrue.decoding.sequence.noise import FloatImage, Noise
from retrue.geometry.arrays import BoolArray, Image
from retrue.patterns.sequence import Sine

TURN = np.float32(2 * np.pi)
SMALLEST_MODULATION = np.float32(1e-6)


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


def demodulate(pictures: Sequence[Image], sine: Sine, noise: Noise) -> Wrapped:
    """Least squares of B + A cos(2 pi (phase - shift_k)) in each pixel.

    For N equal shifts that is the phase atan2(sum I_k sin, sum I_k cos); its variance is propagated from each picture's
    own noise, sigma_phase = sigma_I sqrt(2 / N) / A radians where that is the same for all.

    Source: Bruning et al., "Digital wavefront measuring interferometer", Applied Optics 13, 1974.
    """
    shape, dtype = pictures[0].shape, pictures[0].dtype
    angles = 2 * np.pi * np.array(sine.shifts)
    design = np.stack([np.ones_like(angles), np.cos(angles), np.sin(angles)], axis=1)
    _, cosine, sine_row = np.linalg.pinv(design)
    seen = np.stack([picture.reshape(-1) for picture in pictures])
    saturated = (seen.max(axis=0) >= FULL * np.iinfo(dtype).max).reshape(shape)
    rows = np.stack([cosine, sine_row, cosine**2, cosine * sine_row, sine_row**2]).astype(np.float32)
    c, s, cc, cs, ss = rows @ seen.astype(np.float32)
    square = c * c + s * s
    dark = square < SMALLEST_MODULATION
    square[dark] = SMALLEST_MODULATION
    floor = noise.floor * np.array([np.sum(cosine**2), np.sum(cosine * sine_row), np.sum(sine_row**2)])
    gain = np.float32(noise.gain)
    cc, cs, ss = (np.float32(own) + gain * shot for own, shot in zip(floor, (cc, cs, ss), strict=True))
    variance = (s * s * cc - 2 * s * c * cs + c * c * ss) / (square * square * TURN * TURN)
    variance[dark] = np.inf
    phase = np.arctan2(s, c) / TURN + np.float32(sine.offset_px / sine.period_px % 1.0)
    phase -= np.floor(phase)
    return Wrapped(
        sine.period_px,
        phase.reshape(shape),
        variance.reshape(shape),
        np.sqrt(square).reshape(shape),
        saturated,
    )


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
