"""How noise in the pictures becomes error in the pose. Section 4.1.2, Figs. 3 and 4, errors by eq. (29)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from retrue.experiments.peers import eight_point_poses, longuet_higgins_poses
from retrue.experiments.study import Cell as Number
from retrue.experiments.study import Line, Panel, Study, Table
from retrue.experiments.trials import Progress, run_trials
from retrue.geometry.arrays import FloatArray
from retrue.geometry.homography import fit_homography, fit_homography_linear
from retrue.geometry.paper_solver import paper_pose_candidates
from retrue.geometry.planar_pose import planar_pose_candidates
from retrue.geometry.transform import rotation_from_vector

FOCAL_PX = 1000.0
POINTS_A_SCENE = 50
NOISE_LEVELS_PX = tuple(round(0.1 * k, 1) for k in range(11))
SOLVERS = ("paper", "Longuet-Higgins", "retrue")
FITS = ("plain (14)", "maximum likelihood")
EIGHT_POINT = ("eight-point, on the plane", "eight-point, off any plane")
PAPER_METHODS = (*(f"{solver}, H {fit}" for fit in FITS for solver in SOLVERS), *EIGHT_POINT)

Pose = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, slots=True)
class Cell:
    """Noise per axis in both pictures."""

    noise_px: float


def noise(
    trials: int = 500,
    seed: int = 0,
    *,
    levels: Sequence[float] = NOISE_LEVELS_PX,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Study:
    """Mean and standard deviation of the errors of eq. (29), in percent, for noise of 0 to 1 px.

    R turns by pi/8, pi/5, pi/4 about x, y, z; t is along (8, 4, 1); 50 points lie on Z = X + 2 Y + 10 over +-1.5 in X
    and Y, anew in each trial. The focal length is 1000 px in both devices: print has lost the paper's.
    """
    cells = [Cell(level) for level in levels]
    results = run_trials(_trial, cells, trials, seed, workers=workers, progress=progress)
    rows: list[tuple[Number, ...]] = []
    for cell, errors in zip(cells, results, strict=True):
        for k, method in enumerate(PAPER_METHODS):
            mean, deviation = 100 * errors[:, k].mean(axis=0), 100 * errors[:, k].std(axis=0)
            rows.append((cell.noise_px, method, mean[0], deviation[0], mean[1], deviation[1]))
    columns = ("noise_px", "method", "rotation_mean", "rotation_sd", "translation_mean", "translation_sd")
    table = Table("noise", columns, rows)
    same = max(float(np.abs(_solver_spread(errors)).max()) for errors in results)
    panels = tuple(
        Panel(f"{name}, mean over {trials} trials", "noise, px", "error of eq. (29), %", _lines(table, name))
        for name in ("rotation", "translation")
    )
    remark = f"the three solvers differ by at most {same:.1e} on the same homography, in any trial"
    return Study("noise", table, panels, (remark,))


def _lines(table: Table, name: str) -> list[Line]:
    lines: list[Line] = []
    for method in PAPER_METHODS:
        part = table.where(method=method)
        if method != EIGHT_POINT[0]:  # off the chart
            x, y = ([float(value) for value in part.column(key)] for key in ("noise_px", f"{name}_mean"))
            lines.append(Line(method, x, y))
    return lines


def _solver_spread(errors: FloatArray) -> FloatArray:
    """How far the three solvers are apart in either error, for each kind of homography."""
    grouped = errors[:, : len(FITS) * len(SOLVERS)].reshape(len(errors), len(FITS), len(SOLVERS), 2)
    return np.ptp(grouped, axis=2)


def _trial(cell: Cell, rng: np.random.Generator) -> FloatArray:
    """(methods, 2): rotation and translation error of each method."""
    R = (
        rotation_from_vector([0, 0, np.pi / 4])
        @ rotation_from_vector([0, np.pi / 5, 0])
        @ rotation_from_vector([np.pi / 8, 0, 0])
    )
    t = np.array([8.0, 4.0, 1.0]) / 9
    xy = rng.uniform(-1.5, 1.5, (POINTS_A_SCENE, 2))
    on_plane = np.column_stack([xy, xy @ [1.0, 2.0] + 10])
    off_plane = np.column_stack([xy, rng.uniform(6, 14, POINTS_A_SCENE)])
    sigma = cell.noise_px / FOCAL_PX
    x, y = _seen(on_plane, R, t, sigma, rng)
    general = _seen(off_plane, R, t, sigma, rng)
    errors: list[tuple[float, float]] = []
    for H in (fit_homography_linear(x, y, normalised=False), fit_homography(x, y)):
        paper = [(pose.R, pose.translation_over_distance) for pose in paper_pose_candidates(H)]
        ours = [(pose.R, pose.translation_over_distance) for pose in planar_pose_candidates(H, [*x.mean(axis=0), 1.0])]
        errors += [_error(poses, R, t) for poses in (paper, longuet_higgins_poses(H), ours)]
    errors += [_error(eight_point_poses(*points), R, t) for points in ((x, y), general)]
    return np.array(errors)


def _seen(X: FloatArray, R: FloatArray, t: FloatArray, sigma: float, rng: np.random.Generator) -> Pose:
    Y = X @ R.T + t
    x, y = X[:, :2] / X[:, 2:], Y[:, :2] / Y[:, 2:]
    return x + rng.normal(0, sigma, x.shape), y + rng.normal(0, sigma, y.shape)


def _error(poses: Sequence[Pose], R: FloatArray, t: FloatArray) -> tuple[float, float]:
    """Eq. (29): least |R_i - R| / |R| and |t_i - t| / |t| over the solutions, t of either sign and length 1."""
    unit = t / np.linalg.norm(t)
    rotation = min(float(np.linalg.norm(found - R) / np.linalg.norm(R)) for found, _ in poses)
    directions = [found / np.linalg.norm(found) for _, found in poses]
    translation = min(float(np.linalg.norm(sign * found - unit)) for found in directions for sign in (1, -1))
    return rotation, translation
