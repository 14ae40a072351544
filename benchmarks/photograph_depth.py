"""Is the sigma of each pixel's depth true? Clouds of simulated photographs against the scene.

    python -m benchmarks.photograph_depth --scenes 20 --seed 0

Walls with boxes and balls before them, two cameras of different lenses, noise, blur; every other scene is dim, so that
noise is three times as large. `own`: with the true rig, what sigma says of each point by itself. `all`: from a rig that
was turned by a degree and recalibrated from the same photographs, with what all points have in common. Told is which
share of the errors along the ray lies within one, two and three sigma (68.3, 95.4, 99.7 % of normal ones), in each
tenth of sigma, and beside edges of depth, where a window holds two surfaces.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np

from retrue import Accepted, Camera, Rig, RigidTransform, recalibrate, reconstruct
from retrue.decoding.photographs.dense import WINDOW, match_densely
from retrue.decoding.photographs.match_photographs import match_photographs
from retrue.patterns.photographs import PHOTOGRAPHS
from retrue.simulation.camera_model import CameraModel
from retrue.simulation.photographs import Photographed, photograph, textured_scene

LEFT = Camera((640, 480), [[600, 0, 319.5], [0, 600, 239.5], [0, 0, 1]], [-0.1, 0.02, 0, 0, 0])
RIGHT = Camera((640, 480), [[620, 0, 315], [0, 620, 243], [0, 0, 1]], [-0.08, 0.02, 0, 0, 0])
EXACT = {"lens_covariance": (np.eye(8) * 1e-10).tolist()}  # lenses are, here
POSE = RigidTransform.from_rotation_vector([0.01, -0.05, 0.02], [-150.0, 3, 5])
RIG = Rig(LEFT, RIGHT, POSE, unit="mm", evidence=EXACT)
BRIGHT, DIM = CameraModel(exposure=0.9, blur_px=0.6, electrons=10_000), CameraModel(exposure=0.9, electrons=1_000)
JUMP = 0.02  # of the depth
LEVELS = (1, 2, 3)


def beside_edges(depth: np.ndarray) -> np.ndarray:
    """(h, w) within a window of a jump of depth."""
    filled = np.nan_to_num(depth, nan=1e9)
    reach = np.ones((2 * WINDOW + 1, 2 * WINDOW + 1), np.uint8)
    return cv2.dilate(filled, reach) > (1 + JUMP) * cv2.erode(filled, reach)


def relative_errors(rig: Rig, taken: Photographed, errors: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(N,) error along the ray over sigma; sigma relative to the distance; and whether beside an edge."""
    matches = match_photographs(PHOTOGRAPHS, taken.left, taken.right)
    cloud = reconstruct(rig, match_densely(rig, taken.left, taken.right, matches))
    column, row = np.rint(cloud.camera_px).astype(int).T
    ray = cloud.points / np.linalg.norm(cloud.points, axis=1, keepdims=True)
    off = np.linalg.norm(cloud.points, axis=1) - taken.depth[row, column] / ray[:, 2]
    sigma = cloud.sigma
    if errors == "all":
        sigma = np.sqrt(np.einsum("ni,nij,nj->n", ray, cloud.covariance("all"), ray))
    edge = beside_edges(taken.depth)[row, column]
    known = np.isfinite(off + sigma)
    return (off / sigma)[known], (sigma / np.linalg.norm(cloud.points, axis=1))[known], edge[known]


def told(name: str, relative: np.ndarray) -> None:
    """Shares within each level."""
    shares = ", ".join(f"{np.mean(np.abs(relative) < level):.1%}" for level in LEVELS)
    print(f"{name:<28} {len(relative):>8} points: {shares}; median {np.median(relative):+.2f}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    own: list[tuple[np.ndarray, ...]] = []
    everything: list[tuple[np.ndarray, ...]] = []
    for number in range(asked.scenes):
        random = np.random.default_rng([asked.seed, number])
        scene = textured_scene(RIG, 1500.0, seed=1000 * asked.seed + number)
        taken = photograph(RIG, scene, DIM if number % 2 else BRIGHT, seed=2 * number, supersample=2)
        own.append(relative_errors(RIG, taken, "own"))
        turn = RigidTransform.from_rotation_vector(np.radians(random.normal(0, 1, 3)), np.zeros(3))
        moved = replace(RIG, projector_from_camera=turn @ RIG.projector_from_camera)
        found = recalibrate(moved, [match_photographs(PHOTOGRAPHS, taken.left, taken.right)])
        if isinstance(found, Accepted):
            everything.append(relative_errors(found.rig, taken, "all"))
    for name, clouds in (("own, true rig", own), ("all, recalibrated", everything)):
        relative, sigma, edge = (np.concatenate(part) for part in zip(*clouds, strict=True))
        print(f"{name}: {len(clouds)} of {asked.scenes} scenes")
        told("all points", relative)
        told("beside edges", relative[edge])
        told("elsewhere", relative[~edge])
        parts = np.quantile(sigma[~edge], np.linspace(0, 1, 6))
        for low, high in pairwise(parts):
            mine = ~edge & (sigma >= low) & (sigma <= high)
            told(f"  sigma {low:.2%} to {high:.2%}", relative[mine])


if __name__ == "__main__":
    main()
