"""Poses, homographies and triangulation, from points."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from importlib import import_module

import cv2
import numpy as np
from speed_rows import Job, Row, compare, has, peer

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
H = POSE.R + np.outer(POSE.t, NORMAL)
FITTED = 400
WRONG = 0.2  # share of the points of a robust fit
NOISE_PX = 0.3
MANY = 20  # short turns, so that most are over before the machine does something else
ESSENTIAL = {
    "OpenCV essential": ("OpenCV", "findEssentialMat, recoverPose"),
    "PoseLib relative pose": ("PoseLib", "estimate_relative_pose"),
    "pycolmap essential": ("pycolmap", "estimate_essential_matrix"),
}
# Of OpenCV's time, before kernels were compiled at installation.
BEFORE = {"pose": 1 / 5.3, "poses": 1 / 67, "rays": 1 / 4.0, "pixels": 1 / 6.9, "triangulation": 1 / 12.7}


@dataclass(frozen=True)
class Sizes:
    """How many points of a wall, each beside the goals for its peers; how many homographies and points at once."""

    walls: dict[int, dict[str, float]]
    batch: int
    triangulated: int


FULL = Sizes({2000: {"OpenCV": 2.0, "PoseLib": 1 / 3}, 20_000: {"OpenCV": 0.5}}, 100_000, 1_000_000)
QUICK = Sizes({200: {}}, 100, 1000)


def point_rows(rounds: int, sizes: Sizes) -> Iterator[Row]:
    rng = np.random.default_rng(0)
    for count, goals in sizes.walls.items():
        yield from whole_jobs(count, goals, rng, min(rounds, 7))
    yield from robust_fits(rng, 2 * rounds)
    yield from fits(rng, MANY * rounds)
    yield from poses(sizes.batch, rng, rounds)
    yield from triangulations(sizes.triangulated, rng, rounds)


def whole_jobs(count: int, goals: dict[str, float], rng: np.random.Generator, rounds: int) -> list[Row]:
    scene = Setup("typical", (3, -12, 1), (0.22, -0.03, 0.04), (0.25, 0.1, 1.0), 0.9).scene(count, rng)
    points = scene.observed(NOISE_PX, 0.1, rng)
    installed = methods(NOISE_PX)
    named = {peer(*job): (job[0], installed[name]) for name, job in ESSENTIAL.items() if name in installed}
    return compare(
        f"pose from {count} points of a wall, 10 % wrong: `recalibrate`",
        lambda: recalibrate(scene.rig, [points]),
        {title: partial(method, scene.rig, points) for title, (_, method) in named.items()},
        rounds,
        goals={title: goals[library] for title, (library, _) in named.items() if library in goals},
    )


def robust_fits(rng: np.random.Generator, rounds: int) -> Iterator[Row]:
    """Homographies alone, of undistorted pixels; each with its own threshold or none."""
    source = rng.uniform([0, 0], [1280, 960], (FITTED, 2))
    in_pixels = np.diag([1400, 1400, 1]) @ H @ np.diag([1 / 1600, 1 / 1600, 1])
    target = apply_homography(in_pixels, source) + rng.normal(0, NOISE_PX, (FITTED, 2))
    wrong = rng.permutation(FITTED)[: round(WRONG * FITTED)]
    target[wrong] = rng.uniform([0, 0], [1024, 768], (len(wrong), 2))
    threshold = 4 * NOISE_PX
    flags = {
        "MAGSAC": cv2.USAC_MAGSAC,
        "RANSAC": cv2.RANSAC,
        "LMEDS": cv2.LMEDS,
        "RHO": cv2.RHO,
        "USAC": cv2.USAC_DEFAULT,
    }
    peers: dict[str, Job] = {
        peer("OpenCV", f"findHomography, {name}"): partial(cv2.findHomography, source, target, flag, threshold)
        for name, flag in flags.items()
    }
    magsac = next(iter(peers))
    if has("PoseLib"):
        robust = import_module("poselib").estimate_homography
        peers[peer("PoseLib", "estimate_homography")] = lambda: robust(
            source, target, {"max_reproj_error": threshold}, {}
        )
    if has("pycolmap"):
        pycolmap = import_module("pycolmap")
        options = pycolmap.RANSACOptions()
        options.max_error = threshold
        peers[peer("pycolmap", "estimate_homography_matrix")] = lambda: pycolmap.estimate_homography_matrix(
            source, target, options
        )
    title = f"homography of {FITTED} pixels, {WRONG:.0%} wrong: `fit_homography_robust`".replace("%", " %")
    yield from compare(title, lambda: fit_homography_robust(source, target), peers, rounds, goals={magsac: 3.0})
    yield from compare(
        f"{title}, told the noise",
        lambda: fit_homography_robust(source, target, noise=NOISE_PX),
        {magsac: peers[magsac]},
        rounds,
    )


def fits(rng: np.random.Generator, rounds: int) -> Iterator[Row]:
    x = rng.uniform(-0.3, 0.3, (FITTED, 2))
    y = apply_homography(H, x) + rng.normal(0, 2e-4, (FITTED, 2))
    name = peer("OpenCV", "findHomography")
    for unit, source, target in (("rays", x, y), ("pixels", x * 1600 + 640, y * 1400 + 500)):
        yield from compare(
            f"homography of {FITTED} {unit}, none wrong: `fit_homography`",
            partial(fit_homography, source, target),
            {name: partial(cv2.findHomography, source, target, 0)},
            rounds,
            repeats=5,
            before={name: BEFORE[unit]},
        )


def poses(count: int, rng: np.random.Generator, rounds: int) -> Iterator[Row]:
    K = np.eye(3)
    name = peer("OpenCV", "decomposeHomographyMat")
    single: dict[str, Job] = {name: lambda: cv2.decomposeHomographyMat(H, K)}
    if has("PoseLib"):
        motion = import_module("poselib").motion_from_homography
        single[peer("PoseLib", "motion_from_homography")] = lambda: motion(H)
    yield from compare(
        "two poses of a homography: `planar_pose_candidates`",
        lambda: planar_pose_candidates(H),
        single,
        MANY * rounds,
        repeats=100,
        before={name: BEFORE["pose"]},
    )
    stack = H + rng.normal(0, 0.05, (count, 3, 3))
    each = f"{name}, a call each"
    yield from compare(
        f"two poses of {count} homographies: `planar_pose_candidates_batch`, each",
        lambda: planar_pose_candidates_batch(stack),
        {each: lambda: [cv2.decomposeHomographyMat(one, K) for one in stack]},
        min(rounds, 5),
        parts=count,
        before={each: BEFORE["poses"]},
    )


def triangulations(count: int, rng: np.random.Generator, rounds: int) -> Iterator[Row]:
    X = np.column_stack([rng.uniform(-0.4, 0.4, (count, 2)), rng.uniform(1.2, 2.0, count)])
    Y = POSE.apply(X)
    x, y = X[:, :2] / X[:, 2:], Y[:, :2] / Y[:, 2:]
    first, second = np.eye(3, 4), np.column_stack([POSE.R, POSE.t])
    columns = np.ascontiguousarray(x.T), np.ascontiguousarray(y.T)
    name = peer("OpenCV", "triangulatePoints")
    peers: dict[str, Job] = {name: lambda: cv2.triangulatePoints(first, second, *columns)}
    title = f"{count} points: "
    yield from compare(
        f"{title}`triangulate`, optimal",
        lambda: triangulate(POSE, x, y),
        peers,
        rounds,
        before={name: BEFORE["triangulation"]},
    )
    yield from compare(f"{title}`triangulate_linear`", lambda: triangulate_linear(POSE, x, y), peers, rounds)
