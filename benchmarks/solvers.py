"""Poses, homographies, triangulation and the whole job, beside OpenCV, PoseLib and pycolmap.

python benchmarks/solvers.py [--rounds 15]

All run in turn in one process, so that whatever else the machine does hits all alike; medians, and how many times
as long as `retrue` each takes.
"""

from __future__ import annotations

import argparse
import platform
import statistics
import time
from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np

from retrue import (
    RigidTransform,
    fit_homography,
    load_kernels,
    planar_pose_candidates,
    planar_pose_candidates_batch,
    recalibrate,
    triangulate,
)
from retrue.experiments.peers import methods
from retrue.experiments.scenes import Setup
from retrue.geometry.homography import apply_homography
from retrue.geometry.triangulation import triangulate_linear

Job = Callable[[], object]
POSE = RigidTransform.from_rotation_vector([0.05, -0.2, 0.02], [0.35, -0.04, 0.06])
NORMAL = np.array([0.25, 0.1, 1.0])
BATCH, TRIANGULATED, FITTED = 100_000, 1_000_000, 400


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=15)
    rounds = parser.parse_args().rounds
    print(f"compiled kernels: {load_kernels()}")
    print(f"{machine()}, Python {platform.python_version()}")
    print(", ".join(f"{name} {version(name)}" for name in packages()))
    rng = np.random.default_rng(0)
    for title, repeats, jobs in (*poses(rng), *fits(rng), *triangulations(rng), *whole_jobs(rng)):
        compare(title, repeats, jobs, rounds)


def machine() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def packages() -> list[str]:
    optional = [name for name in ("numba", "poselib", "pycolmap") if find_spec(name) is not None]
    return ["numpy", "scipy", "opencv-python-headless", *optional]


def poses(rng: np.random.Generator) -> list[tuple[str, int, dict[str, Job]]]:
    H = POSE.R + np.outer(POSE.t, NORMAL)
    K = np.eye(3)
    single: dict[str, Job] = {
        "retrue planar_pose_candidates": lambda: planar_pose_candidates(H),
        "OpenCV decomposeHomographyMat": lambda: cv2.decomposeHomographyMat(H, K),
    }
    if find_spec("poselib") is not None:
        poselib = import_module("poselib")
        single["PoseLib motion_from_homography"] = lambda: poselib.motion_from_homography(H)
    stack = H + rng.normal(0, 0.05, (BATCH, 3, 3))
    few = stack[:1000]
    share = BATCH // len(few)
    batch: dict[str, Job] = {
        "retrue planar_pose_candidates_batch": lambda: planar_pose_candidates_batch(stack),
        f"OpenCV, 1000 calls (x {share})": lambda: [cv2.decomposeHomographyMat(H, K) for H in few],
        "limit: copy the answer": lambda: np.empty((BATCH, 10, 3)).fill(0),
    }
    return [("two poses of one homography", 2000, single), (f"two poses of each of {BATCH} homographies", 1, batch)]


def fits(rng: np.random.Generator) -> list[tuple[str, int, dict[str, Job]]]:
    x = rng.uniform(-0.3, 0.3, (FITTED, 2))
    y = apply_homography(POSE.R + np.outer(POSE.t, NORMAL), x) + rng.normal(0, 2e-4, (FITTED, 2))
    x_px, y_px = x * 1600 + 640, y * 1400 + 500
    rays: dict[str, Job] = {
        "retrue fit_homography": lambda: fit_homography(x, y),
        "OpenCV findHomography(0)": lambda: cv2.findHomography(x, y, 0),
    }
    pixels: dict[str, Job] = {
        "retrue fit_homography": lambda: fit_homography(x_px, y_px),
        "OpenCV findHomography(0)": lambda: cv2.findHomography(x_px, y_px, 0),
        "OpenCV findHomography(RANSAC)": lambda: cv2.findHomography(x_px, y_px, cv2.RANSAC, 1.0),
        "OpenCV findHomography(MAGSAC)": lambda: cv2.findHomography(x_px, y_px, cv2.USAC_MAGSAC, 1.0),
    }
    return [(f"homography of {FITTED} rays", 50, rays), (f"homography of {FITTED} pixels", 50, pixels)]


def triangulations(rng: np.random.Generator) -> list[tuple[str, int, dict[str, Job]]]:
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
    return [(f"triangulation of {TRIANGULATED} points", 1, jobs)]


def whole_jobs(rng: np.random.Generator) -> list[tuple[str, int, dict[str, Job]]]:
    setup = Setup("typical", (3, -12, 1), (0.22, -0.03, 0.04), (0.25, 0.1, 1.0), 0.9)
    scene = setup.scene(2000, rng)
    points = scene.observed(0.3, 0.1, rng)
    jobs: dict[str, Job] = {"retrue recalibrate": lambda: recalibrate(scene.rig, [points])}
    for name, method in methods(0.3).items():
        if name in ("OpenCV essential", "PoseLib relative pose", "pycolmap essential"):
            jobs[name] = lambda method=method: method(scene.rig, points)
    return [("pose from 2000 points of a wall, 10 % wrong", 1, jobs)]


def compare(title: str, repeats: int, jobs: Mapping[str, Job], rounds: int) -> None:
    for job in jobs.values():
        job()
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(rounds):
        for name, job in jobs.items():
            start = time.perf_counter()
            for _ in range(repeats):
                job()
            times[name].append(1e6 * (time.perf_counter() - start) / repeats)
    ours = statistics.median(next(iter(times.values())))
    print(f"\n{title}, median of {rounds}")
    for name, values in times.items():
        median = statistics.median(values)
        share = BATCH / 1000 if "(x " in name else 1
        print(f"  {name:38s} {median * share:12.2f} us   {median * share / ours:7.2f}")


if __name__ == "__main__":
    main()
