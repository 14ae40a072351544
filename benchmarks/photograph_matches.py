"""Is a wrong pose ever accepted from matches of two photographs? Simulated pairs with what photographs bring.

    python -m benchmarks.photograph_matches --pairs 10000 --seed 0

Each pair is a scene of planes and curved things before two cameras side by side, matched as `match_photographs` does
(as many points, the same noise), the rig turned since it was calibrated; and one trouble: a print that repeats, so that
a share of the matches is one period off; a cluster of wrong matches that agree with each other; an object that moved
between the photographs; or near-duplicates, many matches of few places. A pose is wrong where it is accepted and off by
more than 5 of its own sigma and by more than half a degree.
"""

from __future__ import annotations

import argparse
import collections
import sys
import time
import traceback
from dataclasses import replace

import numpy as np

from retrue import Camera, Correspondences, Rig, RigidTransform, recalibrate
from retrue.correspondences import Card
from retrue.geometry.transform import direction_angle, rotation_angle

TROUBLES = ("nothing", "repeated print", "clustered wrong", "moved object", "near duplicates", "all of it")
WRONG_SIGMAS, WRONG_DEG = 5.0, 0.5


def scene_rig(random: np.random.Generator) -> Rig:
    """Two cameras side by side, of different lenses."""
    width, height = 640, 480
    f = random.uniform(400, 800, 2)
    left, right = (Camera((width, height), [[g, 0, 319.5], [0, g, 239.5], [0, 0, 1]], [-0.1, 0.02, 0, 0, 0]) for g in f)
    turn = random.normal(0, 0.05, 3)
    return Rig(left, right, RigidTransform.from_rotation_vector(turn, [-1.0, *random.normal(0, 0.05, 2)]))


def depths(rays: np.ndarray, random: np.random.Generator, distance: float) -> tuple[np.ndarray, np.ndarray]:
    """(N,) depth of rays (N, 2): a wall, a floor, boxes and balls; and (N,) which of them each ray meets."""
    homogeneous = np.column_stack([rays, np.ones(len(rays))])
    normal = np.array([*random.uniform(-0.4, 0.4, 2), 1.0])
    depth = distance / (homogeneous @ normal)
    which = np.zeros(len(rays), dtype=int)
    for number in range(1, random.integers(1, 6)):
        centre, size = random.uniform(-0.4, 0.4, 2), random.uniform(0.08, 0.25)
        inside = np.abs(rays - centre).max(axis=1) < size
        if random.random() < 0.5:  # a face of a box, turned
            face = np.array([*random.uniform(-0.6, 0.6, 2), 1.0])
            its = distance * random.uniform(0.5, 0.85) / (homogeneous @ face)
        else:
            swell = 1 - np.minimum(np.sum((rays - centre) ** 2, axis=1) / size**2, 1) * 0.15
            its = distance * random.uniform(0.5, 0.85) / swell
        nearer = inside & (its > 0) & (its < depth)
        depth, which = np.where(nearer, its, depth), np.where(nearer, number, which)
    return depth, which


def matches(rig: Rig, trouble: str, random: np.random.Generator) -> Correspondences:
    """What a matcher gives of one pair."""
    count = int(random.integers(150, 900))
    pixels = random.uniform([5, 5], [635, 475], (count, 2))
    rays = rig.camera.unproject(pixels)
    distance = random.uniform(4, 25)
    depth, which = depths(rays, random, distance)
    points = np.column_stack([rays, np.ones(count)]) * depth[:, None]
    everything = trouble == "all of it"
    if trouble == "moved object" or everything:
        moved = which == random.integers(0, which.max() + 1) if which.max() else np.abs(rays).max(axis=1) < 0.15
        if moved.mean() < 0.45:
            turn = RigidTransform.from_rotation_vector(random.normal(0, 0.03, 3), random.normal(0, 0.1, 3))
            points[moved] = turn.apply(points[moved])
    if trouble == "repeated print" or everything:
        along = random.normal(0, 1, 3) * [1, 1, 0]
        period = along / np.linalg.norm(along) * random.uniform(0.02, 0.1) * distance
        shifted = (which == 0) & (random.random(count) < random.uniform(0.05, 0.35))
        points[shifted] += period * random.choice([-1, 1], (count, 1))[shifted] if random.random() < 0.5 else period
    seen = rig.projector.project(rig.projector_from_camera.apply(points))
    if trouble == "clustered wrong" or everything:
        for _ in range(random.integers(1, 4)):
            near = np.linalg.norm(pixels - random.uniform([80, 80], [560, 400]), axis=1) < random.uniform(30, 110)
            warp = np.eye(2) + random.normal(0, 0.1, (2, 2))
            if near.mean() < 0.3:
                seen[near] = (pixels[near] - pixels[near].mean(0)) @ warp.T + random.uniform([80, 80], [560, 400])
    wrong = random.random(count) < random.uniform(0, 0.15)
    seen[wrong] = random.uniform([0, 0], [639, 479], (int(wrong.sum()), 2))
    sigma = np.exp(random.normal(np.log(0.1), 0.4, count))
    seen = seen + random.normal(0, 1, (count, 2)) * sigma[:, None]
    kept = np.isfinite(seen).all(axis=1) & rig.projector.contains(np.nan_to_num(seen, nan=-9.0))
    rows = np.flatnonzero(kept)
    if trouble == "near duplicates" or everything:
        few = rows[random.integers(0, len(rows), max(len(rows) // 8, 1))]
        rows = np.concatenate([rows, np.repeat(few, 6)])
        jitter = random.normal(0, 0.5, (len(rows), 2))
        jitter[: kept.sum()] = 0
    else:
        jitter = np.zeros((len(rows), 2))
    each = sigma[rows] / np.sqrt(2)
    card = Card("features", count, len(rows), {}, 1.0)
    return Correspondences(
        pixels[rows] + jitter, seen[rows] + jitter, each, each, card=card, camera_size=(640, 480),
        projector_size=(640, 480),
    )  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=600)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="go on from this pair")
    asked = parser.parse_args()
    told: dict[str, collections.Counter[str]] = {trouble: collections.Counter() for trouble in TROUBLES}
    began = time.perf_counter()
    for number in range(asked.first, asked.pairs):
        random = np.random.default_rng([asked.seed, number])
        trouble = TROUBLES[number % len(TROUBLES)]
        rig = scene_rig(random)
        points = matches(rig, trouble, random)
        moved = RigidTransform.from_rotation_vector(
            np.radians(random.normal(0, random.choice([0.1, 1, 4]), 3)), [0, 0, 0]
        )
        try:
            result = recalibrate(replace(rig, projector_from_camera=moved @ rig.projector_from_camera), [points])
        except Exception:
            told[trouble]["crashed"] += 1
            print(f"pair {number} ({trouble}) crashed:\n{traceback.format_exc()}", flush=True)
            continue
        verdict: str = result.verdict
        if result.verdict != "refused":
            true, sigma = rig.projector_from_camera, result.evidence.sigma
            found = result.rig.projector_from_camera
            errors = np.degrees([rotation_angle(found.R @ true.R.T), direction_angle(found.t, true.t)])
            allowed = np.maximum(WRONG_DEG, WRONG_SIGMAS * np.array([sigma.rotation_deg, sigma.translation_deg]))
            if (errors > allowed).any():
                verdict = "WRONG"
                print(
                    f"pair {number} ({trouble}) {result.verdict}: off by {errors.round(3).tolist()} deg, sigma "
                    f"{sigma.rotation_deg:.3f} {sigma.translation_deg:.3f}; {result.reason}", flush=True,
                )  # fmt: skip
        told[trouble][verdict] += 1
        if (number + 1) % 600 == 0:
            print(number + 1, {name: dict(count) for name, count in told.items()}, flush=True)
    for name, count in told.items():
        print(f"{name:<18}" + ", ".join(f"{verdict} {n}" for verdict, n in sorted(count.items())))
    wrong = sum(count["WRONG"] + count["crashed"] for count in told.values())
    print(f"{asked.pairs - asked.first} pairs, {wrong} wrong or crashed, {time.perf_counter() - began:.0f} s")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
