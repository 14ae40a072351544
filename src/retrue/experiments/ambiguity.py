"""How many poses explain a plane? Section 4.1.1, Table 1 and Fig. 2."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from retrue.experiments.scenes import random_planar_pose
from retrue.experiments.study import Line, Panel, Study, Table
from retrue.experiments.trials import Progress, run_trials
from retrue.geometry.arrays import FloatArray
from retrue.geometry.homography import apply_homography
from retrue.geometry.paper_solver import paper_pose_candidates
from retrue.geometry.planar_pose import PlanarPose, in_front, planar_pose_candidates
from retrue.geometry.transform import RigidTransform
from retrue.geometry.triangulation import triangulate_linear

METHODS = ("paper, as written", "paper, both signs of t", "retrue")
SPREADS = (0.1, 0.3, 0.5, 0.8)  # half width of the picture in units of the focal length
POINT_COUNTS = (4, 20, 100)
SAME = 1e-5
MOST_POSES = 4  # solutions that any of the methods can give


@dataclass(frozen=True, slots=True)
class Cell:
    """How many points, and over how much of the picture."""

    points: int
    spread: float


def ambiguity(
    trials: int = 5000, seed: int = 0, *, workers: int | None = None, progress: Progress | None = None
) -> Study:
    """Count the poses that have all points in front of both devices, for the paper's algorithm and for ours.

    `paper, as written` fixes t3 = 1 and takes R from two columns of C, eqs (25) to (27); `both signs of t` also tries
    -t with -n. Table columns: shares of configurations in percent, with so many solutions; `truth` is how often the
    true pose is among them, `false` how often one is that does not reproduce the homography.
    """
    cells = [Cell(points, spread) for points, spread in product(POINT_COUNTS, SPREADS)]
    results = run_trials(_trial, cells, trials, seed, workers=workers, progress=progress)
    rows: list[tuple[str | float | int, ...]] = []
    for cell, found in zip(cells, results, strict=True):
        for k, method in enumerate(METHODS):
            count, truth, false = found[:, k].T
            shares = [100 * np.count_nonzero(count == solutions) / len(count) for solutions in range(MOST_POSES + 1)]
            one_or_two = shares[1] + shares[2]
            rows.append(
                (
                    cell.points,
                    cell.spread,
                    method,
                    *shares,
                    one_or_two,
                    100 * float(truth.mean()),
                    100 * float(false.mean()),
                )
            )
    names = tuple(str(solutions) for solutions in range(MOST_POSES + 1))
    table = Table("ambiguity", ("points", "spread", "method", *names, "1 or 2", "truth", "false"), rows)
    panels = tuple(
        Panel(title, "half width of the points, in focal lengths", "share of configurations, %", _lines(table, column))
        for title, column in (
            ("one solution", "1"),
            ("two solutions", "2"),
            ("the truth is among them", "truth"),
            ("a pose that is none", "false"),
        )
    )
    return Study("ambiguity", table, panels)


def _lines(table: Table, column: str) -> list[Line]:
    lines: list[Line] = []
    for method in METHODS:
        part = table.where(points=20, method=method)
        lines.append(Line(method, _numbers(part, "spread"), _numbers(part, column)))
    return lines


def _numbers(table: Table, column: str) -> list[float]:
    return [float(value) for value in table.column(column)]


def _trial(cell: Cell, rng: np.random.Generator) -> FloatArray:
    """(3, 3): per method how many solutions, whether the truth is one, whether a pose is that is none."""
    truth, camera = random_planar_pose(rng, cell.points, cell.spread)
    projector = apply_homography(truth.homography, camera)
    H = truth.homography
    literal = paper_pose_candidates(H)
    mirrored = tuple(PlanarPose(pose.R, -pose.translation_over_distance, -pose.normal) for pose in literal)
    ours = planar_pose_candidates(H, [*camera.mean(axis=0), 1.0])
    as_written = [pose for pose in literal if _triangulates_in_front(pose, camera, projector)]
    other_sign = [pose for pose in mirrored if _triangulates_in_front(pose, camera, projector)]
    seen = as_written, as_written + other_sign, [pose for pose in ours if in_front(pose, camera).all()]
    return np.array([_count(poses, truth) for poses in seen], dtype=np.float64)


def _triangulates_in_front(pose: PlanarPose, camera: FloatArray, projector: FloatArray) -> bool:
    """Cheirality as the paper's: every point triangulated, eqs (5), (6), and its depth positive in both devices."""
    points = triangulate_linear(RigidTransform(pose.R, pose.translation_over_distance), camera, projector)
    return bool(np.isfinite(points).all())


def _count(seen: list[PlanarPose], truth: PlanarPose) -> tuple[int, bool, bool]:
    """How many, whether the truth is among them, and whether one does not reproduce the homography."""
    H = truth.homography / np.linalg.norm(truth.homography)
    misfits = [
        min(float(np.abs(pose.homography / np.linalg.norm(pose.homography) - sign * H).max()) for sign in (1, -1))
        for pose in seen
    ]
    right = any(float(np.abs(pose.R - truth.R).max()) < 100 * SAME for pose in seen)
    return len(seen), right, any(misfit > SAME for misfit in misfits)
