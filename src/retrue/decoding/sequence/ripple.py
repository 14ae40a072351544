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
    covered = [own for sine, lit in parts if len((own := _covered(sine.phase, lit, shifts))[0])]
    weights = np.array([float(weight.sum(dtype=np.float64)) for _, weight in covered])
    if len(weights) < FEWEST_PARTS or not weights.sum() > LEAST_WEIGHT:
        return 0j
    ripple = 0j
    for _ in range(ROUNDS):
        moments = np.array([_moment(_straight(phase, ripple, shifts), weight, shifts) for phase, weight in covered])
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
    phase = _straight(sine.phase, ripple, shifts)
    return Wrapped(sine.period_px, phase - np.floor(phase), sine.variance, sine.modulation, sine.saturated)


def _straight(seen: FloatImage, ripple: complex, shifts: int) -> FloatImage:
    """Phases, but for whole turns, without that ripple."""
    phase, size, angle = seen, np.float32(abs(ripple)), np.float32(np.angle(ripple))
    for _ in range(2 if ripple else 0):
        phase = seen - size * np.sin(np.float32(2 * np.pi * shifts) * phase + angle)
    return phase


def _covered(phase: FloatImage, lit: BoolArray, shifts: int) -> tuple[FloatImage, FloatImage]:
    """The phases of a part, and how many turns of projector each pixel covers; those that cover none are left out.

    By the slope over one ripple, which the ripple leaves as it is.
    """
    none = np.zeros(0, np.float32), np.zeros(0, np.float32)
    steps = [_slope(phase, lit, axis, 1) for axis in range(2)]
    usual = [float(np.median(step[step > 0])) / 2 if (step > 0).any() else 0.0 for step in steps]
    axis = int(np.argmax(usual))
    if not usual[axis] > 0:
        return none
    reach = max(round(0.5 / (shifts * usual[axis])), 1)
    if not 2 * reach < phase.shape[axis]:
        return none
    weight = _slope(phase, lit, axis, reach) / np.float32(2 * reach)
    inner = phase[:, reach:-reach] if axis == 1 else phase[reach:-reach]
    told = weight > 0
    return inner[told], weight[told]


def _moment(phase: FloatImage, weight: FloatImage, shifts: int) -> complex:
    """The N-th moment of those phases."""
    turns = np.float32(2 * np.pi * shifts) * phase
    along, across = (float(np.sum(weight * wave(turns), dtype=np.float64)) for wave in (np.cos, np.sin))
    return complex(along, -across) / float(weight.sum(dtype=np.float64))


def _slope(phase: FloatImage, lit: BoolArray, axis: int, reach: int) -> FloatImage:
    """How far the phase goes on between the neighbours `reach` before and behind, along an array axis; 0 if not lit."""
    before, behind = (slice(None, -2 * reach), slice(2 * reach, None))
    here = slice(reach, -reach)
    cuts = [(cut, slice(None)) if axis == 0 else (slice(None), cut) for cut in (before, behind, here)]
    gone = phase[cuts[1]] - phase[cuts[0]]
    gone -= np.rint(gone)
    return np.where(lit[cuts[0]] & lit[cuts[1]] & lit[cuts[2]], np.abs(gone), np.float32(0))
