"""A simulated month of frames of a rig that creeps and is bumped: how near is the track to the best that there is?

    python -m benchmarks.creep_month --frames 43200 --seed 0

A frame a minute, each with a covariance of its own (0.03 deg an axis, five axes that hang together). The rig creeps at
0.01 to 1 deg an hour, as a random walk, at rates that change every few hours, or with the day; and is bumped three
times a week, by half a degree. The bound is the error of an observer of the whole record who knows how the walk was
drawn and when the bumps were (Rauch, Tung, Striebel); of the other two kinds nobody knows, and the error stands alone,
beside what the track says of itself. `live` is the filter's error at each frame, when the frame is its last.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

import numpy as np

from retrue.recalibration.creep import SIZE, after_offset
from retrue.recalibration.streak import CreepOptions
from retrue.recalibration.track import rauch, smoothed

FRAME_DEG, BUMP_DEG = 0.03, 0.5
WEEK = 7 * 24 * 60
RATES, KINDS = (0.01, 0.1, 1.0), ("walk", "spells", "day")


@dataclass(frozen=True)
class Record:
    """Offsets that were, (N, 5), those that frames have, and what each says of itself; and where the bumps were."""

    true: np.ndarray
    offsets: np.ndarray
    covariances: np.ndarray
    bumps: np.ndarray


def record(kind: str, rate_deg: float, frames: int, random: np.random.Generator) -> Record:
    """Of a month, or as many frames as asked for."""
    mixed = random.normal(0, 1, (SIZE, SIZE))
    usual = mixed @ mixed.T + 0.2 * np.eye(SIZE)
    usual *= np.radians(FRAME_DEG) ** 2 * SIZE / np.trace(usual)
    covariances = usual * np.exp(random.normal(0, 0.3, frames))[:, None, None]
    step = np.radians(rate_deg) / 60
    true = np.zeros((frames, SIZE))
    if kind == "walk":
        true = np.cumsum(random.normal(0, step, true.shape), axis=0)
    elif kind == "day":
        turns = 2 * np.pi * np.arange(frames) / 1440
        true = np.sin(turns)[:, None] * direction(random) * step * 1440 / (2 * np.pi)
    else:
        k = 0
        while k < frames:
            spell = int(random.integers(60, 600))
            true[k : k + spell] = direction(random) * step * random.random()
            k += spell
        true = np.cumsum(true, axis=0)
    bumps = np.sort(random.choice(np.arange(100, frames - 100), max(3 * frames // WEEK, 1), replace=False))
    for bump in bumps:
        true[bump:] += np.radians(BUMP_DEG) * direction(random)
    noise = (np.linalg.cholesky(covariances) @ random.normal(0, 1, (frames, SIZE, 1)))[..., 0]
    return Record(true, true + noise, covariances, bumps)


def direction(random: np.random.Generator) -> np.ndarray:
    """A unit vector of five axes."""
    drawn = random.normal(0, 1, SIZE)
    return drawn / np.linalg.norm(drawn)


def live(drawn: Record) -> tuple[float, np.ndarray]:
    """RMS of the filter at each frame, degrees an axis; and the frames at which it told a bump."""
    creep, options, told = None, CreepOptions(), []
    squares = 0.0
    for k, (offset, frame) in enumerate(zip(drawn.offsets, drawn.covariances, strict=True)):
        before, creep = creep, after_offset(creep, offset, frame, options)
        squares += float(((creep.offset - drawn.true[k]) ** 2).sum())
        if before is not None and creep.bumps > before.bumps:
            told.append(k)
    return float(np.degrees(np.sqrt(squares / drawn.true.size))), np.array(told, dtype=int)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=43_200)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    print("kind    deg/h  track rms  says     bound    ratio  live     bumps  in 3 frames  false  a week  s")
    for kind in KINDS:
        for rate in RATES:
            drawn = record(kind, rate, asked.frames, np.random.default_rng([asked.seed, round(rate * 100)]))
            began = time.process_time()
            found = smoothed(drawn.offsets, drawn.covariances)
            seconds = time.process_time() - began
            error = np.degrees(np.sqrt(np.mean((found.offset - drawn.true) ** 2)))
            says = np.degrees(np.sqrt(np.trace(found.covariance, axis1=1, axis2=2).mean() / SIZE))
            bound = np.nan
            if kind == "walk":
                steps, none = np.append(0.0, np.ones(asked.frames - 1)), np.zeros((SIZE, SIZE))
                place = np.eye(SIZE) * (np.radians(rate) / 60) ** 2
                everything = np.ones(asked.frames, dtype=bool)
                best, _ = rauch(drawn.offsets, drawn.covariances, place, none, steps, drawn.bumps, everything)
                bound = np.degrees(np.sqrt(np.mean((best - drawn.true) ** 2)))
            running, told = live(drawn)
            in_time = [bool(((told >= bump) & (told < bump + 3)).any()) for bump in drawn.bumps]
            false = [k for k in told if not ((drawn.bumps <= k) & (k < drawn.bumps + 10)).any()]
            print(
                f"{kind:<7} {rate:<5}  {error:.5f}    {says:.5f}  {bound:.5f}  {error / bound:.3f}  {running:.5f}  "
                f"{len(drawn.bumps):<5}  {sum(in_time):<11}  {len(false):<5}  "
                f"{len(false) * WEEK / asked.frames:<6.2f}  {seconds:.0f}",
                flush=True,
            )  # fmt: skip


if __name__ == "__main__":
    main()
