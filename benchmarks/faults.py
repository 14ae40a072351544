"""Simulated captures with a fault each: is a wrong pose ever accepted, and is a harmless fault forgiven?

    python benchmarks/faults.py [--trials 1000] [--seed 0]

A pose is wrong when it is more than 5 of its own sigma and more than 0.2 deg off, in rotation or direction of t.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # a process for each core; threads below them would only wait
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

import retrue
from retrue.geometry.transform import direction_angle, rotation_angle, rotation_from_vector

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.recalibration.scenes import CAMERA, PROJECTOR, Scene, capture

Rig, Correspondences = retrue.Rig, retrue.Correspondences
Generator = np.random.Generator


def random_rig(rng: Generator) -> Rig:
    """A projector beside the camera, turned so that both see the middle of the scene."""
    direction = rng.normal(size=3) * [1, 1, 0.35]
    center = 0.35 * direction / np.linalg.norm(direction)
    axis = np.array([0, 0, 1.6]) - center
    axis /= np.linalg.norm(axis)
    toward = np.cross([0, 0, 1], axis)
    angle = np.arcsin(min(1.0, float(np.linalg.norm(toward))))
    R = rotation_from_vector(-toward / max(np.linalg.norm(toward), 1e-9) * angle)
    # The projector of these scenes has lens shift: its picture lies above its axis.
    R = rotation_from_vector([-0.22, 0, 0]) @ rotation_from_vector([0, 0, rng.uniform(-0.3, 0.3)]) @ R
    return Rig(CAMERA, PROJECTOR, retrue.RigidTransform(R, -R @ center), "m")


def random_plane(rng: Generator) -> tuple[np.ndarray, float]:
    normal = np.array([*rng.uniform(-0.7, 0.7, 2), 1.0])
    return normal, float(rng.uniform(1.3, 1.9))


def random_scene(rng: Generator) -> Scene:
    """A wall, and in two of three cases something before it."""
    spheres = [(np.array([*rng.uniform(-0.2, 0.2, 2), 1.1]), 0.12)] if rng.random() < 2 / 3 else []
    return Scene(planes=[random_plane(rng)], spheres=spheres)


def plain(rng: Generator, rig: Rig, share: float = 0.0) -> Correspondences:
    return capture(random_scene(rng), rig=rig, outliers=share, seed=int(rng.integers(1 << 30)))


def no_plane(rng: Generator, rig: Rig) -> Correspondences:
    points = np.c_[rng.uniform(-0.4, 0.4, (1500, 2)), rng.uniform(1.2, 2, 1500)]
    points[:, :2] *= points[:, 2:] / 1.6
    pixels = rig.camera.project(points) + rng.normal(0, 0.1, (1500, 2))
    projector = rig.projector.project(rig.projector_from_camera.apply(points))
    good = np.isfinite(pixels + projector).all(axis=1)
    return Correspondences(pixels[good], projector[good])


def identical_planes(rng: Generator, rig: Rig) -> list[Correspondences]:
    scene = Scene(planes=[random_plane(rng)])
    return [capture(scene, rig=rig, seed=int(rng.integers(1 << 30))) for _ in range(2)]


def bowed(rng: Generator, rig: Rig) -> Correspondences:
    """A sphere so large that the board is off its plane by up to 0.2 % of the distance."""
    normal, distance = random_plane(rng)
    normal = normal / np.linalg.norm(normal)
    radius = 0.3**2 / 2 / (0.002 * distance * rng.uniform(0.25, 1))
    center = normal * (distance + radius)
    return capture(Scene(planes=[], spheres=[(center, radius)]), rig=rig, seed=int(rng.integers(1 << 30)))


def refocused(rng: Generator, rig: Rig, share: float = 0.01) -> Correspondences:
    """Taken with a camera whose focal length is not that of the rig file any more."""
    K = rig.camera.K.copy()
    K[:2, :2] *= 1 + share * rng.uniform(0.5, 1) * rng.choice([-1, 1])
    return plain(rng, replace(rig, camera=replace(rig.camera, K=K)))


def another_pattern(rng: Generator, rig: Rig) -> Correspondences:
    points = plain(rng, rig)
    return replace(points, projector_px=rng.permutation(points.projector_px))


def swapped_devices(rng: Generator, rig: Rig) -> Correspondences:
    points = plain(rng, rig)
    return Correspondences(points.projector_px, points.camera_px)


def tiny_patch(rng: Generator, rig: Rig) -> Correspondences:
    x, y = rng.uniform(0.2, 0.7, 2)
    return capture(
        Scene(planes=[random_plane(rng)]),
        rig=rig,
        area=(x, x + 0.06, y, y + 0.06),
        grid=(10, 10),
        seed=int(rng.integers(1 << 30)),
    )


def along_the_normal(rng: Generator, rig: Rig) -> Correspondences:
    pose = rig.projector_from_camera
    direction = pose.R.T @ pose.t
    direction *= np.sign(direction[2])
    wall = direction / np.linalg.norm(direction) + rng.normal(0, 0.01, 3)
    return capture(Scene(planes=[(wall, 0.9)]), rig=rig, seed=int(rng.integers(1 << 30)))


def two_poses_mixed(rng: Generator, rig: Rig) -> Correspondences:
    """The rig moved between the pictures of a sequence: each half of the points from another pose."""
    scene = random_scene(rng)
    moved = bumped(rng, rig, 3)
    first, second = (capture(scene, rig=r, seed=int(rng.integers(1 << 30))) for r in (rig, moved))
    count = min(len(first), len(second))
    own = rng.random(count) < rng.uniform(0.3, 0.7)
    return Correspondences(
        np.where(own[:, None], first.camera_px[:count], second.camera_px[:count]),
        np.where(own[:, None], first.projector_px[:count], second.projector_px[:count]),
    )


def bumped(rng: Generator, rig: Rig, degrees: float) -> Rig:
    pose = rig.projector_from_camera
    turns = [rng.normal(size=3) for _ in range(2)]
    a, b = (np.radians(degrees) * rng.uniform() * turn / np.linalg.norm(turn) for turn in turns)
    return replace(
        rig,
        projector_from_camera=retrue.RigidTransform(
            rotation_from_vector(a) @ pose.R, rotation_from_vector(b) @ pose.t * rng.uniform(0.8, 1.25)
        ),
    )


FAULTS: dict[str, Callable[[Generator, Rig], Correspondences | list[Correspondences]]] = {
    "none": plain,
    "10 % wrong matches": partial(plain, share=0.1),
    "30 % wrong matches": partial(plain, share=0.3),
    "50 % wrong matches": partial(plain, share=0.5),
    "bowed plane": bowed,
    "two identical planes": identical_planes,
    "no plane": no_plane,
    "focal length 1 % off": refocused,
    "zoomed 20 %": partial(refocused, share=0.2),
    "another pattern": another_pattern,
    "devices swapped": swapped_devices,
    "tiny patch": tiny_patch,
    "t along the normal": along_the_normal,
    "two poses mixed": two_poses_mixed,
}


def trial(name: str, seed: np.random.SeedSequence) -> str:
    """What became of one capture: "accepted", "wrong" or the beginning of the refusal's reason."""
    rng = np.random.default_rng(seed)
    while True:
        rig = random_rig(rng)
        made = FAULTS[name](rng, rig)
        captures = made if isinstance(made, list) else [made]
        if all(len(points) > 60 for points in captures):
            break
    result = retrue.recalibrate(bumped(rng, rig, 10), captures)
    if isinstance(result, retrue.Refused):
        return "refused: " + result.reason[:40]
    found, truth, sigma = result.rig.projector_from_camera, rig.projector_from_camera, result.evidence.sigma
    assert sigma is not None
    off = np.degrees([rotation_angle(found.R @ truth.R.T), direction_angle(found.t, truth.t)])
    wrong = (off > 0.2) & (off > 5 * np.array([sigma.rotation_deg, sigma.translation_deg]))
    return "wrong" if wrong.any() else "accepted"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--reasons", action="store_true")
    arguments = parser.parse_args()
    print(f"{'fault':24} {'accepted':>9} {'refused':>9} {'wrong':>7}   of {arguments.trials}")
    with ProcessPoolExecutor() as pool:
        for name, sequence in zip(FAULTS, np.random.SeedSequence(arguments.seed).spawn(len(FAULTS)), strict=True):
            outcomes = list(pool.map(partial(trial, name), sequence.spawn(arguments.trials), chunksize=8))
            accepted, wrong = outcomes.count("accepted"), outcomes.count("wrong")
            print(f"{name:24} {accepted:9} {len(outcomes) - accepted - wrong:9} {wrong:7}", flush=True)
            if arguments.reasons:
                reasons = sorted({o for o in outcomes if o.startswith("refused")}, key=outcomes.count, reverse=True)
                for reason in reasons[:5]:
                    print(f"    {outcomes.count(reason):5} {reason}")


if __name__ == "__main__":
    main()
