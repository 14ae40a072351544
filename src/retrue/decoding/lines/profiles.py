"""What the picture shows across the lines of a crossing: where each line's middle is, and what light it adds."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from retrue.geometry.arrays import FloatArray, Image

SAMPLES = 13  # across a line
ACROSS = 0.55  # pitches that a profile reaches to either side
BESIDE = (-0.6, -0.5, -0.4, 0.4, 0.5, 0.6)  # pitches along a line, where profiles lie: in the gaps of the other family
CORE = 0.14  # pitches about the middle, that are line
ROUNDS = 3
WINDOW = np.linspace(-0.25, 0.25, 11)  # pitches about the middle, whose centre of gravity is the next guess
FOOT = 0.3  # of the height above the window's ends: what is below does not count
GAP = 0.42  # pitches from the middle, from where on it is gap


@dataclass(frozen=True, slots=True, eq=False)
class Profiles:
    """Of N lines.

    Attributes
    ----------
    offset : (N,) of the line's middle from where it was expected, in pitches.
    light : (N, 3) what the line adds to its gaps.
    likeness : (N,) of the profile to that of a line, as a correlation.
    """

    offset: FloatArray
    light: FloatArray
    likeness: FloatArray


def across_lines(picture: Image, p: FloatArray, across: FloatArray, along: FloatArray) -> Profiles:
    """Lines through p (N, 2), with steps (N, 2) to the next line `across` and to the next crossing `along` it."""
    t = np.linspace(-ACROSS, ACROSS, SAMPLES)
    s = np.array(BESIDE)
    place = p[:, None, None] + s[:, None, None] * along[:, None, None] + t[:, None] * across[:, None, None]
    seen = sampled(picture, place)
    profile = seen.mean(axis=1)
    core, left, right = np.abs(t) <= CORE, t <= -GAP, t >= GAP
    gap = (profile[:, left].mean(axis=1) + profile[:, right].mean(axis=1)) / 2
    light = profile[:, core].mean(axis=1) - gap
    norm = np.linalg.norm(light, axis=-1, keepdims=True)
    weights = np.clip(light, 0, None) / np.maximum(norm, 1e-9)
    grey = np.einsum("nsc,nc->ns", profile, weights)
    return Profiles(_middle(t, grey), light, _likeness(t, grey))


def _middle(t: FloatArray, grey: FloatArray) -> FloatArray:
    """Offset (N,) of the peak of profiles (N, SAMPLES): the centre of gravity of its upper part."""
    index, step = np.arange(len(grey))[:, None], t[1] - t[0]
    offset = t[grey[:, 2:-2].argmax(axis=1) + 2]
    for _ in range(ROUNDS):
        place = offset[:, None] + WINDOW
        at = np.clip((place - t[0]) / step, 0, len(t) - 1.001)
        below = at.astype(np.int64)
        height = grey[index, below] + (at - below) * (grey[index, below + 1] - grey[index, below])
        base = np.minimum(height[:, :1], height[:, -1:])
        base = base + FOOT * (height.max(axis=1, keepdims=True) - base)
        weight = np.maximum(height - base, 0.0)
        offset = (weight * place).sum(axis=1) / np.maximum(weight.sum(axis=1), 1e-9)
    return offset


def _likeness(t: FloatArray, grey: FloatArray) -> FloatArray:
    line = np.exp(-0.5 * (t / 0.2) ** 2)
    line = line - line.mean()
    centred = grey - grey.mean(axis=1, keepdims=True)
    return centred @ line / np.maximum(np.linalg.norm(centred, axis=1) * np.linalg.norm(line), 1e-9)


def sampled(picture: Image, place: FloatArray) -> FloatArray:
    """(..., 3) `picture` at `place` (..., 2), between pixels; its rim beyond it."""
    flat = place.reshape(-1, 2).astype(np.float32)
    rows = -(-len(flat) // 1024) if len(flat) else 0
    if not rows:
        return np.empty((*place.shape[:-1], 3))
    padded = np.zeros((rows * 1024, 2), np.float32)
    padded[: len(flat)] = flat
    grid = padded.reshape(rows, 1024, 2)
    seen = cv2.remap(picture, grid[..., 0], grid[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return seen.reshape(-1, 3)[: len(flat)].reshape(*place.shape[:-1], 3).astype(np.float64)
