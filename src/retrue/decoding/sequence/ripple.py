"""What a curve of brightness (gamma) does to the phase of a sine: measured on the scene, and taken out.

N equal shifts see harmonics of the sine as a ripple of N periods a turn, phase seen = phase + a sin(N phase + b). All
phases are equally frequent along the projector, whatever the scene; so the N-th moment of the phases seen, each
weighted by the length of projector that its pixel covers, is -N a / 2 exp(i b).

Source: the principle of Guo, He, Zhang, "Gamma correction for digital fringe projection profilometry", Applied
Optics 43, 2004, who use the histogram of brightness.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from retrue.decoding.sequence.noise import FloatImage
from retrue.decoding.sequence.sines import Wrapped
from retrue.geometry.arrays import BoolArray

SIGNIFICANT = 4.0
"""Standard errors, between parts of the picture: a smaller ripple is none."""
MATTERS = 0.1
"""Of the phase's own noise."""
ROUNDS = 3
FEWEST_PARTS = 4
LEAST_WEIGHT = 30.0
"""Turns of projector that must be seen."""


def measure_ripple(parts: Sequence[tuple[Wrapped, BoolArray]], shifts: int) -> complex:
    """a exp(i b) of the ripple, in turns, from parts of the picture and where they are lit; 0 where none is seen."""
    noise = [float(np.median(sine.variance[lit])) for sine, lit in parts if lit.any()]
    ripple = 0j
    for _ in range(ROUNDS):
        seen = [_moment(straightened(sine, ripple, shifts).phase, lit, shifts) for sine, lit in parts]
        moments = np.array([moment for moment, _ in seen])
        weights = np.array([weight for _, weight in seen])
        if np.count_nonzero(weights) < FEWEST_PARTS or not weights.sum() > LEAST_WEIGHT:
            return 0j
        mean = complex(np.sum(weights * moments) / np.sum(weights))
        spread = float(np.sqrt(np.sum(weights**2 * np.abs(moments - mean) ** 2)) / np.sum(weights))
        step = -mean / (np.pi * shifts)
        if ripple == 0j and not abs(mean) > SIGNIFICANT * spread:
            return 0j
        ripple += step
    return ripple if abs(ripple) > MATTERS * np.sqrt(np.median(noise)) else 0j


def straightened(sine: Wrapped, ripple: complex, shifts: int) -> Wrapped:
    """The same without that ripple."""
    if not ripple:
        return sine
    size, angle = np.float32(abs(ripple)), np.float32(np.angle(ripple))
    turns = np.float32(2 * np.pi * shifts)
    phase = sine.phase
    for _ in range(2):
        phase = sine.phase - size * np.sin(turns * phase + angle)
    return Wrapped(sine.period_px, phase - np.floor(phase), sine.variance, sine.modulation, sine.saturated)


def _moment(phase: FloatImage, lit: BoolArray, shifts: int) -> tuple[complex, float]:
    """The N-th moment of the phases of a part, and how many turns of projector it covers."""
    steps = [_slope(phase, lit, axis, 1) for axis in range(2)]
    usual = [float(np.median(step[step > 0])) / 2 if (step > 0).any() else 0.0 for step in steps]
    axis = int(np.argmax(usual))
    if not usual[axis] > 0:
        return 0j, 0.0
    reach = max(round(0.5 / (shifts * usual[axis])), 1)  # so that the slope is taken over one ripple
    if not 2 * reach < phase.shape[axis]:
        return 0j, 0.0
    weight = _slope(phase, lit, axis, reach) / (2 * reach)
    inner = phase[:, reach:-reach] if axis == 1 else phase[reach:-reach]
    total = float(weight.sum(dtype=np.float64))
    turns = np.float32(2 * np.pi * shifts) * inner
    along, across = (float(np.sum(weight * wave(turns), dtype=np.float64)) for wave in (np.cos, np.sin))
    return (complex(along, -across) / total, total) if total > 0 else (0j, 0.0)


def _slope(phase: FloatImage, lit: BoolArray, axis: int, reach: int) -> FloatImage:
    """How far the phase goes on between the neighbours `reach` before and behind, along an array axis; 0 if not lit."""
    before, behind = (slice(None, -2 * reach), slice(2 * reach, None))
    here = slice(reach, -reach)
    cuts = [(cut, slice(None)) if axis == 0 else (slice(None), cut) for cut in (before, behind, here)]
    gone = phase[cuts[1]] - phase[cuts[0]]
    gone -= np.rint(gone)
    return np.where(lit[cuts[0]] & lit[cuts[1]] & lit[cuts[2]], np.abs(gone), np.float32(0))
