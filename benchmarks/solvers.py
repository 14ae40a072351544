"""Poses, homographies, triangulation and the whole job from points, beside OpenCV, PoseLib and pycolmap.

python benchmarks/solvers.py [--rounds 15]
"""

from __future__ import annotations

import argparse
from importlib import import_module
from importlib.util import find_spec

import cv2
import numpy as np
from side_by_side import Job, compare, print_machine

from retrue import (
    RigidTransform,
    fit_homography,
    fit_homography_robust,
    planar_pose_candidates,
    planar_pose_candidates_batch,
    recalibrate,
    triangulate,
)
from retrue.experiments.peers import methods
from retrue.experiments.scenes import Setup
from retrue.geometry.homography import apply_homography
from retrue.geometry.triangulation import triangulate_linear

POSE = RigidTransform.from_rotation_vector([0.05, -0.2, 0.02], [0.35, -0.04, 0.06])
NORMAL = np.array([0.25, 0.1, 1.0])
BATCH, TRIANGULATED, FITTED = 100_000, 1_000_000, 400
WRONG = 0.2  # share of the points of a robust fit
NOISE_PX = 0.3
MANY = 20  # short turns, so that most are over before the machine does something else


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=15)
    rounds = parser.parse_args().rounds
    print_machine()
    rng = np.random.default_rng(0)
    poses(rng, rounds)
    fits(rng, rounds)
    robust_fits(rng, rounds)
    triangulations(rng, rounds)
    for count in (2000, 20_000):
        whole_jobs(count, rng, rounds)


def poses(rng: np.random.Generator, rounds: int) -> None:
    H = POSE.R + np.outer(POSE.t, NORMAL)
    K = np.eye(3)
    single: dict[str, Job] = {
        "retrue planar_pose_candidates": lambda: planar_pose_candidates(H),
        "OpenCV decomposeHomographyMat": lambda: cv2.decomposeHomographyMat(H, K),
    }
    if find_spec("poselib") is not None:
        poselib = import_module("poselib")
        single["PoseLib motion_from_homography"] = lambda: poselib.motion_from_homography(H)
    compare("two poses of one homography", single, MANY * rounds, repeats=100)
    stack = H + rng.normal(0, 0.05, (BATCH, 3, 3))
    batch: dict[str, Job] = {
        "retrue planar_pose_candidates_batch": lambda: planar_pose_candidates_batch(stack),
        "OpenCV, one call each": lambda: [cv2.decomposeHomographyMat(H, K) for H in stack],
        "limit: copy the answer": lambda: np.empty((BATCH, 10, 3)).fill(0),
    }
    compare(f"two poses of {BATCH} homographies, each", batch, min(rounds, 5), parts=BATCH)


def fits(rng: np.random.Generator, rounds: int) -> None:
    x = rng.uniform(-0.3, 0.3, (FITTED, 2))
    y = apply_homography(POSE.R + np.outer(POSE.t, NORMAL), x) + rng.normal(0, 2e-4, (FITTED, 2))
    x_px, y_px = x * 1600 + 640, y * 1400 + 500
    for name, source, target in (("rays", x, y), ("pixels", x_px, y_px)):
        jobs: dict[str, Job] = {
            "retrue fit_homography": lambda source=source, target=target: fit_homography(source, target),
            "OpenCV findHomography(0)": lambda source=source, target=target: cv2.findHomography(source, target, 0),
            "limit: copy the points": lambda source=source, target=target: (source.copy(), target.copy()),
        }
        compare(f"homography of {FITTED} {name}", jobs, MANY * rounds, repeats=5)


def robust_fits(rng: np.random.Generator, rounds: int) -> None:
    """Homographies alone, of undistorted pixels; each with its own threshold or none."""
    source = rng.uniform([0, 0], [1280, 960], (FITTED, 2))
    H = np.diag([1400, 1400, 1]) @ (POSE.R + np.outer(POSE.t, NORMAL)) @ np.diag([1 / 1600, 1 / 1600, 1])
    target = apply_homography(H, source) + rng.normal(0, NOISE_PX, (FITTED, 2))
    wrong = rng.permutation(FITTED)[: round(WRONG * FITTED)]
    target[wrong] = rng.uniform([0, 0], [1024, 768], (len(wrong), 2))
    threshold = 4 * NOISE_PX
    flags = {
        "RANSAC": cv2.RANSAC,
        "LMEDS": cv2.LMEDS,
        "RHO": cv2.RHO,
        "MAGSAC": cv2.USAC_MAGSAC,
        "USAC": cv2.USAC_DEFAULT,
    }
    jobs: dict[str, Job] = {
        "retrue, finding the noise": lambda: fit_homography_robust(source, target),
        "retrue, told the noise": lambda: fit_homography_robust(source, target, noise=NOISE_PX),
    }
    for name, flag in flags.items():
        jobs[f"OpenCV {name}"] = lambda flag=flag: cv2.findHomography(source, target, flag, threshold)
    if find_spec("poselib") is not None:
        poselib = import_module("poselib")
        jobs["PoseLib"] = lambda: poselib.estimate_homography(source, target, {"max_reproj_error": threshold}, {})
    if find_spec("pycolmap") is not None:
        pycolmap = import_module("pycolmap")
        options = pycolmap.RANSACOptions()
        options.max_error = threshold
        jobs["pycolmap"] = lambda: pycolmap.estimate_homography_matrix(source, target, options)
    compare(f"homography of {FITTED} pixels, {WRONG:.0%} wrong", jobs, 2 * rounds)


def triangulations(rng: np.random.Generator, rounds: int) -> None:
    X = np.column_stack([rng.uniform(-0.4, 0.4, (TRIANGULATED, 2)), rng.uniform(1.2, 2.0, TRIANGULATED)])
    Y = POSE.apply(X)
    x, y = X[:, :2] / X[:, 2:], Y[:, :2] / Y[:, 2:]
    first, second = np.eye(3, 4), np.column_stack([POSE.R, POSE.t])
    columns = np.ascontiguousarray(x.T), np.ascontiguousarray(y.T)
    jobs: dict[str, Job] = {
        "retrue triangulate, optimal": lambda: triangulate(POSE, x, y),
        "retrue, linear (5), (6)": lambda: triangulate_linear(POSE, x, y),
        "OpenCV triangulatePoints": lambda: cv2.triangulatePoints(first, second, *columns),
        "limit: copy rays and points": lambda: (x.copy(), y.copy(), X.copy()),
    }
    compare(f"triangulation of {TRIANGULATED} points", jobs, rounds)


def whole_jobs(count: int, rng: np.random.Generator, rounds: int) -> None:
    scene = Setup("typical", (3, -12, 1), (0.22, -0.03, 0.04), (0.25, 0.1, 1.0), 0.9).scene(count, rng)
    points = scene.observed(NOISE_PX, 0.1, rng)
    jobs: dict[str, Job] = {"retrue recalibrate": lambda: recalibrate(scene.rig, [points])}
    for name, method in methods(NOISE_PX).items():
        if name in ("OpenCV essential", "PoseLib relative pose", "pycolmap essential"):
            jobs[name] = lambda method=method: method(scene.rig, points)
    compare(f"pose from {count} points of a wall, 10 % wrong", jobs, min(rounds, 7))


if __name__ == "__main__":
    main()
