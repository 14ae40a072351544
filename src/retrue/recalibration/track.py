"""Where a rig was at each frame of a whole record: what came after a frame says as much of it as what came before.

The model is the filter's, see `creep`: five offsets that follow a local linear trend, each frame with its own
covariance. Here its two kinds of noise, of the place and of the rate, are those that the record itself makes most
likely, axis by axis where frames are white (Harvey 1989, section 4.2); then every frame is estimated from all of them
(Rauch, Tung, Striebel 1965). At a bump all that is known of the place is forgotten, and nothing of the rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from retrue.errors import InputError
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray, finite_array
from retrue.recalibration.creep import BUMP_FRAMES, LEAST_SCATTER, SIZE, Creep, after_offset
from retrue.recalibration.streak import CreepOptions

PLACE_NOISE = np.array([0.0, *np.geomspace(1e-7, 1.0, 15)])
RATE_NOISE = np.array([0.0, *np.geomspace(1e-13, 0.1, 13)])
"""Variances a frame, of a frame's own, that are tried."""

ANYWHERE = 1e6  # times a frame's covariance
FEWEST_FRAMES = 3


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """Of N frames, radians: a rotation vector and the direction of t, as `Creep` has them.

    Attributes
    ----------
    offset : (N, 5) from the rig's pose.
    covariance : (N, 5, 5).
    bumps : (B,) frames from which on the rig stood elsewhere.
    used : (N,) frames that are no strays.
    scatter : variance of frames about the track, as a multiple of what they say; the mean of all axes.
    """

    offset: FloatArray
    covariance: FloatArray
    bumps: IntArray
    used: BoolArray
    scatter: float


def smoothed(
    offsets: FloatArray,
    covariances: FloatArray,
    times: Sequence[float] | FloatArray | None = None,
    options: CreepOptions | None = None,
) -> Track:
    """The most probable track, given all frames.

    Parameters
    ----------
    offsets, covariances : (N, 5) and (N, 5, 5) of each frame, see `measured_offset`.
    times : (N,) when, in any unit, increasing; by default one step a frame.

    Raises
    ------
    InputError : fewer than three frames, or times that do not increase.

    >>> rng = np.random.default_rng(0)
    >>> true = np.outer(np.arange(200), [1e-4, 0, 0, 2e-4, 0])  # creeps about x
    >>> found = smoothed(true + rng.normal(0, 0.01, true.shape), np.tile(np.eye(5) * 1e-4, (200, 1, 1)))
    >>> bool(np.abs(found.offset - true).max() < 0.004), found.bumps.tolist()
    (True, [])
    """
    y = finite_array(offsets, (None, SIZE), "offsets")
    R = finite_array(covariances, (len(y), SIZE, SIZE), "covariances")
    if len(y) < FEWEST_FRAMES:
        raise InputError(f"track: expected {FEWEST_FRAMES} frames or more, found {len(y)}")
    steps = _steps(len(y), times)
    bumps, used = _bumps(y, R, options or CreepOptions())
    values, vectors = np.linalg.eigh(R.mean(axis=0))
    axes, whitening = vectors * np.sqrt(values), (vectors / np.sqrt(values)).T
    place, rate, scatter = _likeliest_noise(y, R, whitening, steps, bumps, used)
    scaling = axes * np.sqrt(scatter) @ whitening
    place, rate = (axes * (variance * scatter) @ axes.T for variance in (place, rate))
    offset, covariance = rauch(y, scaling @ R @ scaling.T, place, rate, steps, bumps, used)
    return Track(offset, covariance, bumps, used, float(scatter.mean()))


def _steps(count: int, times: Sequence[float] | FloatArray | None) -> FloatArray:
    """(N,) time since the frame before, of the usual one; the first is 0."""
    if times is None:
        return np.append(0.0, np.ones(count - 1))
    gaps = np.diff(finite_array(times, (count,), "times"))
    if not (gaps > 0).all():
        raise InputError("times: expected increasing ones, each frame after the one before")
    return np.append(0.0, gaps / np.median(gaps))


def _bumps(y: FloatArray, R: FloatArray, options: CreepOptions) -> tuple[IntArray, BoolArray]:
    """Where the live filter began anew, and which frames it took."""
    creep: Creep | None = None
    bumps: list[int] = []
    used = np.ones(len(y), dtype=np.bool_)
    for k, (offset, frame) in enumerate(zip(y, R, strict=True)):
        before, creep = creep, after_offset(creep, offset, frame, options)
        used[k] = creep.jumps is None
        if before is not None and before.jumps is not None and creep.frames == BUMP_FRAMES:  # it began anew
            first = k + 1 - BUMP_FRAMES
            used[first : k + 1] = True
            bumps += [first] * (creep.bumps - before.bumps)
    return np.array(bumps, dtype=np.int64), used


def _likeliest_noise(
    y: FloatArray, R: FloatArray, whitening: FloatArray, steps: FloatArray, bumps: IntArray, used: BoolArray
) -> FloatArray:
    """(3, 5) of place, rate, and how frames scatter: on each axis on which frames are white, the likeliest.

    Every pair of the first two, as multiples of the third, has a filter of its own, of one axis, with two states and
    three variances; the third is the mean square of its innovations.
    """
    white = y @ whitening.T
    variances = np.einsum("ij,njk,ik->ni", whitening, R, whitening)
    place, rate = (grid.ravel() for grid in np.meshgrid(PLACE_NOISE, RATE_NOISE, indexing="ij"))
    x, v = np.repeat(white[:1].T, len(place), axis=1), np.zeros((SIZE, len(place)))
    xx, xv, vv = np.full_like(x, variances[0].max()), np.zeros_like(x), np.full_like(x, 0.1)
    squares, logs, count, forgotten = np.zeros_like(x), np.zeros_like(x), 0, set(bumps.tolist())
    for k in range(1, len(y)):
        step = steps[k]
        x = x + step * v
        xx = xx + step * (2 * xv + step * vv) + step * place
        xv, vv = xv + step * vv, vv + step * rate
        if k in forgotten:
            xx = xx + ANYWHERE
        if not used[k]:
            continue
        spread = xx + variances[k][:, None]
        innovation = white[k][:, None] - x
        if k not in forgotten:
            squares += innovation**2 / spread
            logs += np.log(spread)
            count += 1
        gain_x, gain_v = xx / spread, xv / spread
        x, v = x + gain_x * innovation, v + gain_v * innovation
        xx, xv, vv = xx - gain_x * xx, xv - gain_x * xv, vv - gain_v * xv
    scatter = np.maximum(squares / max(count, 1), LEAST_SCATTER**2)
    best = np.argmin(count * np.log(scatter) + logs, axis=1)
    return np.stack([place[best], rate[best], scatter[np.arange(SIZE), best]])


def _moved(trend: FloatArray, state: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    return trend @ state, trend @ covariance @ trend.T


def _divided(cross: FloatArray, spread: FloatArray) -> FloatArray:
    """(M, K): the transpose of cross (K, M) times the inverse of the spread (K, K)."""
    return np.asarray(np.linalg.solve(spread, cross).T, dtype=np.float64)


def rauch(
    y: FloatArray,
    R: FloatArray,
    place: FloatArray,
    rate: FloatArray,
    steps: FloatArray,
    bumps: IntArray,
    used: BoolArray,
) -> tuple[FloatArray, FloatArray]:
    """(N, 5) and (N, 5, 5) from all frames, whose noises are known: forth with a Kalman filter, and back."""
    count: int = len(y)
    forgotten: set[int] = set(bumps.tolist())
    expected, spreads = np.empty((count, 2 * SIZE)), np.empty((count, 2 * SIZE, 2 * SIZE))
    states, covariances = np.empty_like(expected), np.empty_like(spreads)
    state: FloatArray = np.concatenate([y[0], np.zeros(SIZE)])
    covariance: FloatArray = np.zeros((2 * SIZE, 2 * SIZE))
    covariance[:SIZE, :SIZE], covariance[SIZE:, SIZE:] = ANYWHERE * R[0], R[0]
    trend: FloatArray = np.eye(2 * SIZE, dtype=np.float64)
    for k in range(count):
        trend[:SIZE, SIZE:] = np.eye(SIZE) * steps[k]
        state, covariance = _moved(trend, state, covariance)
        covariance[:SIZE, :SIZE] += steps[k] * place
        covariance[SIZE:, SIZE:] += steps[k] * rate
        if k in forgotten:
            covariance[:SIZE, :SIZE] += ANYWHERE * R[k]
        expected[k], spreads[k] = state, covariance
        if used[k]:
            gain = _divided(covariance[:SIZE], covariance[:SIZE, :SIZE] + R[k])
            state = state + gain @ (y[k] - state[:SIZE])
            covariance = covariance - gain @ covariance[:SIZE]
            covariance = (covariance + covariance.T) / 2
        states[k], covariances[k] = state, covariance
    for k in range(count - 2, -1, -1):
        trend[:SIZE, SIZE:] = np.eye(SIZE) * steps[k + 1]
        back = _divided(trend @ covariances[k], spreads[k + 1])
        states[k] += back @ (states[k + 1] - expected[k + 1])
        covariances[k] += back @ (covariances[k + 1] - spreads[k + 1]) @ back.T
    return states[:, :SIZE], covariances[:, :SIZE, :SIZE]
