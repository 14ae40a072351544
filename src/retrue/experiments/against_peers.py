"""RMSE over the Cramer-Rao bound, for us and for what people would use instead."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from retrue.correspondences import Correspondences
from retrue.errors import RetrueError
from retrue.experiments.peers import Pose, methods, missing, robust
from retrue.experiments.scenes import Setup
from retrue.experiments.study import Cell as Number
from retrue.experiments.study import Line, Panel, Study, Table
from retrue.experiments.trials import Progress, run_trials
from retrue.geometry.arrays import FloatArray
from retrue.geometry.transform import direction_angle, vector_from_rotation
from retrue.geometry.two_view import tangent_basis
from retrue.recalibration.recalibrate import recalibrate
from retrue.recalibration.result import Refused
from retrue.rig import Rig

SETUPS = (
    Setup("typical", (3, -12, 1), (0.22, -0.03, 0.04), (0.25, 0.1, 1.0), 0.9),
    Setup("narrow patch", (3, -12, 1), (0.22, -0.03, 0.04), (0.4, 0.2, 1.0), 0.2),
    Setup("wide, steep", (2, -25, 3), (0.5, 0.1, 0.15), (-0.9, 0.5, 1.0), 1.0),
)
WHOLE_JOB = "retrue recalibrate"
FAILED = 10.0  # of the bound, in rotation or in the direction of t


@dataclass(frozen=True, slots=True)
class Cell:
    """One setup with so many points, noise and outliers."""

    setup: Setup
    points: int
    noise_px: float
    outliers: float
    ours_only: bool = False


def all_cells() -> list[Cell]:
    """Without outliers: every setup, N and noise. With: 0.3 px on 50 to 2000 points."""
    clean = [Cell(s, n, px, 0.0) for s, n, px in product(SETUPS, (8, 50, 400, 2000), (0.1, 0.3, 1.0))]
    return clean + [Cell(s, n, 0.3, share) for s, n, share in product(SETUPS, (50, 400, 2000), (0.05, 0.2))]


def peers(
    trials: int = 200,
    seed: int = 0,
    *,
    cells: list[Cell] | None = None,
    ours_only: bool = False,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Study:
    """Us, OpenCV, PoseLib and pycolmap on the same points of one plane.

    Table columns: RMSE over the bound in rotation and in the direction of t, of the trials that did not fail; `failed`,
    in percent: no pose, or more than ten times the bound; half the length of the RMSE ratio's 95 % interval; `nees`,
    the mean normalised error squared (5 if the reported sigma is honest); median microseconds a call. `bound` says
    whether the bound is small enough for linear theory to hold.
    """
    cells = [replace(cell, ours_only=ours_only) for cell in (all_cells() if cells is None else cells)]
    results = run_trials(_trial, cells, trials, seed, workers=workers, progress=progress)
    rows: list[tuple[Number, ...]] = []
    for cell, outcome in zip(cells, results, strict=True):
        names = _names(cell)
        known = bool((outcome[:, 0, 4] > 0.5).all())
        for k, name in enumerate(names):
            setting = (cell.setup.name, cell.points, cell.noise_px, 100 * cell.outliers, name)
            rows.append((*setting, "holds" if known else "beyond", *_summary(outcome[:, k])))
    rows += [("any", 0, 0.0, 0.0, name, "not installed", *([float("nan")] * 6)) for name in missing()]
    columns = ("setup", "N", "noise_px", "outliers_%", "method", "bound")
    table = Table("peers", (*columns, "rotation", "translation", "interval", "failed_%", "nees", "us"), rows)
    return Study("peers", table, _panels(table))


def _panels(table: Table) -> tuple[Panel, ...]:
    return tuple(
        Panel(
            f"{setup.name}, 0.3 px, {whole}",
            "points",
            "RMSE of rotation over the bound",
            _lines(table, setup.name, "rotation", outliers),
            log_x=True,
            log_y=True,
        )
        for outliers, whole in ((0.0, "no outliers"), (20.0, "20 % outliers"))
        for setup in SETUPS
    )


def _names(cell: Cell) -> list[str]:
    names = [name for name in methods(cell.noise_px) if cell.outliers == 0 or robust(name)]
    if cell.ours_only:
        names = [name for name in names if name.startswith("retrue")]
    return [*names, WHOLE_JOB] if cell.points >= 12 else names


def _summary(outcome: FloatArray) -> tuple[float, ...]:
    """From (trials, 6) rows: rotation and translation over bound, failed, nees, ..., microseconds."""
    failed = outcome[:, 2] > 0.5
    good = outcome[~failed]
    if len(good) == 0:
        return (float("nan"), float("nan"), float("nan"), 100.0, float("nan"), float(np.median(outcome[:, 5])))
    squares = good[:, 0] ** 2
    rotation, translation = float(np.sqrt(squares.mean())), float(np.sqrt((good[:, 1] ** 2).mean()))
    interval = 0.98 * float(squares.std()) / np.sqrt(len(good)) / max(rotation, 1e-12)
    nees = float(good[:, 3].mean())
    return rotation, translation, float(interval), 100 * float(failed.mean()), nees, float(np.median(outcome[:, 5]))


def _lines(table: Table, setup: str, column: str, outliers: float) -> list[Line]:
    part = table.where(setup=setup, noise_px=0.3, **{"outliers_%": outliers})
    lines: list[Line] = []
    for name in dict.fromkeys(str(cell) for cell in part.column("method")):
        mine = part.where(method=name)
        x, y = ([float(value) for value in mine.column(key)] for key in ("N", column))
        lines.append(Line(name, x, y))
    return lines


def _trial(cell: Cell, rng: np.random.Generator) -> FloatArray:
    """(methods, 6): errors over the bound, failed, normalised error squared, whether the bound holds, microseconds."""
    scene = cell.setup.scene(cell.points, rng)
    points = scene.observed(cell.noise_px, cell.outliers, rng)
    bound = scene.bound(cell.noise_px) / max(1 - cell.outliers, 0.1)
    sigmas = np.sqrt([np.trace(bound[:3, :3]), np.trace(bound[3:, 3:])])
    holds = _linear(bound)
    rows: list[tuple[float, ...]] = []
    for name in _names(cell):
        nees = float("nan")
        start = time.perf_counter()
        if name == WHOLE_JOB:
            poses, covariance = _whole_job(scene.rig, points)
        else:
            covariance = None
            try:
                poses = methods(cell.noise_px)[name](scene.rig, points)
            except (RetrueError, RuntimeError, ValueError):
                poses = []
        elapsed = 1e6 * (time.perf_counter() - start)
        errors = np.array([_error(pose, scene.pose.R, scene.pose.t) for pose in poses]).reshape(-1, 5)
        if len(errors) and np.isfinite(errors).all():
            rotation: FloatArray = np.linalg.norm(errors[:, :3], axis=1) / sigmas[0]
            translation: FloatArray = np.linalg.norm(errors[:, 3:], axis=1) / sigmas[1]
            nearest = int(np.argmin(rotation**2 + translation**2))
            best: FloatArray = errors[nearest]
            relative = float(rotation[nearest]), float(translation[nearest])
            if covariance is not None:
                nees = float(best @ np.linalg.solve(covariance, best))
            rows.append((*relative, float(max(relative) > FAILED), nees, holds, elapsed))
        else:
            rows.append((np.nan, np.nan, 1.0, nees, holds, elapsed))
    return np.array(rows)


def _linear(bound: FloatArray) -> bool:
    """Whether first order is enough: what the widest error does to second order stays within the thinnest."""
    variances = np.linalg.eigvalsh(bound)
    return bool(variances[-1] <= np.sqrt(max(variances[0], 0.0)))


def _whole_job(rig: Rig, points: Correspondences) -> tuple[list[Pose], FloatArray | None]:
    """The pose that the points support: not the rig's, which is kept where it holds, for here it and its lenses are
    the truth."""
    result = recalibrate(rig, [points])
    pose = result.evidence.pose
    if isinstance(result, Refused) or pose is None:
        return [], None
    return [(pose.R, pose.t)], np.array(result.evidence.details["covariance_statistical"])


def _error(pose: Pose, R: FloatArray, t: FloatArray) -> FloatArray:
    """(5,) rotation vector and direction of t, in the frame of the pose's own covariance; t of either sign."""
    found, direction = pose[0], pose[1] / np.linalg.norm(pose[1])
    if direction @ t < 0:
        t = -t
    across = tangent_basis(direction).T @ -t
    sine = float(np.linalg.norm(across))
    if sine > 0:
        across = across * (direction_angle(t, direction) / sine)
    return np.concatenate([vector_from_rotation(found @ R.T), across])
