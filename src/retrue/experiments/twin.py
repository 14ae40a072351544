"""How the twin poses of a plane are told apart, and how often that goes wrong."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from retrue.correspondences import Correspondences
from retrue.experiments.scenes import random_rig
from retrue.experiments.study import Cell as Number
from retrue.experiments.study import Line, Panel, Study, Table
from retrue.experiments.trials import Progress, run_trials
from retrue.geometry.arrays import FloatArray
from retrue.geometry.planar_pose import PlanarPose, in_front, planar_pose_candidates
from retrue.geometry.transform import RigidTransform, direction_angle, rotation_angle, rotation_from_vector
from retrue.recalibration.reasons import RivalUnbeaten
from retrue.recalibration.recalibrate import recalibrate
from retrue.recalibration.result import Accepted, Refused
from retrue.rig import Rig

POINTS_ON_WALL = 300
NOISE_PX = 0.3
UNKNOWN_DRIFT = 180.0


@dataclass(frozen=True, slots=True)
class Cell:
    """What the picture and the old rig offer to tell the twins apart.

    Attributes
    ----------
    cue : which of the fields below is varied.
    span : of the camera picture that the points fill.
    off_points, offset : so many points lie off the plane, by this share of its distance.
    second_plane_deg : a second plane takes half of the points, at this angle to the first; 0 for none.
    drift_deg : the old direction of t is turned by this; 180 for a direction at random.
    """

    cue: str
    span: float = 0.9
    off_points: int = 0
    offset: float = 0.0
    second_plane_deg: float = 0.0
    drift_deg: float = UNKNOWN_DRIFT


def all_cells() -> list[Cell]:
    """Every cue by itself, the old rig telling nothing, and the old rig by itself."""
    return [
        *(Cell("cheirality", span=span) for span in (1.0, 0.6, 0.3, 0.1)),
        *(
            Cell("points off the plane", off_points=n, offset=d)
            for n, d in product((5, 20, 60), (0.002, 0.005, 0.02, 0.1))
        ),
        *(Cell("second plane", second_plane_deg=angle) for angle in (2.0, 5.0, 15.0, 45.0)),
        *(Cell("old direction of t", drift_deg=angle) for angle in (0.0, 10.0, 20.0, 30.0, 45.0)),
    ]


def twin(
    trials: int = 400,
    seed: int = 0,
    *,
    cells: list[Cell] | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Study:
    """Random rigs and planes; `recalibrate` on what they show.

    Table columns, in percent of the trials: `accepted`; of these `wrong`, nearer to the twin than to the truth;
    `cannot tell`, refused as a rival is unbeaten; `refused`, for another reason. `both in front`: cheirality cannot
    choose. `prior_wrong`: the old direction of t is nearer to that of the twin.
    """
    cells = all_cells() if cells is None else cells
    results = run_trials(_trial, cells, trials, seed, workers=workers, progress=progress)
    rows: list[tuple[Number, ...]] = []
    for cell, outcome in zip(cells, results, strict=True):
        shares = [100 * float(share) for share in outcome.mean(axis=0)]
        wrong = int(outcome[:, 1].sum())
        setting = (cell.cue, cell.span, cell.off_points, 100 * cell.offset, cell.second_plane_deg, cell.drift_deg)
        rows.append((*setting, len(outcome), shares[0], wrong, *shares[2:]))
    columns = ("cue", "span", "off_points", "offset_%", "angle_deg", "drift_deg", "trials")
    outcomes = ("accepted_%", "wrong", "cannot_tell_%", "refused_%", "both_in_front_%", "prior_wrong_%")
    table = Table("twin", columns + outcomes, rows)
    total = len(cells) * trials
    wrong = sum(int(row[8]) for row in rows)
    panels = (
        _panel(table, "cheirality", "span", "share of the picture filled", "both_in_front_%"),
        _panel(table, "points off the plane", "offset_%", "offset, % of the distance", "cannot_tell_%", "off_points"),
        _panel(table, "second plane", "angle_deg", "angle between the planes, deg", "cannot_tell_%"),
        _panel(table, "old direction of t", "drift_deg", "drift, deg", "cannot_tell_%"),
    )
    return Study("twin", table, panels, (f"wrong and accepted: {wrong} of {total} captures",))


def _panel(table: Table, cue: str, x: str, label: str, y: str, split: str | None = None) -> Panel:
    part = table.where(cue=cue)
    parts = (
        {y: part}
        if split is None
        else {f"{value} points": part.where(**{split: value}) for value in part.column(split)}
    )
    lines = [Line(name, _numbers(rows, x), _numbers(rows, y)) for name, rows in parts.items()]
    shown = {"both_in_front_%": "both poses in front, %", "cannot_tell_%": "answer is 'cannot tell', %"}[y]
    return Panel(cue, label, shown, lines, log_x=split is not None)


def _numbers(table: Table, column: str) -> list[float]:
    return [float(value) for value in table.column(column)]


def _trial(cell: Cell, rng: np.random.Generator) -> FloatArray:
    """(6,): accepted, wrong, cannot tell, refused otherwise, both in front, prior wrong."""
    while True:
        rig, normal = random_rig(rng)
        capture = _capture(cell, rig, normal, rng)
        if capture is not None:
            break
    truth = rig.projector_from_camera
    candidates = _candidates(truth, normal)
    other = max(candidates, key=lambda pose: rotation_angle(pose.R @ truth.R.T))
    rays = rig.camera.unproject(capture.camera_px)
    both = bool(in_front(other, rays).all())
    old_t = _drifted(truth.t, cell.drift_deg, rng)
    prior_wrong = direction_angle(old_t, other.translation_over_distance) < direction_angle(old_t, truth.t)
    old = Rig(rig.camera, rig.projector, RigidTransform(truth.R, old_t))
    result = recalibrate(old, [capture])
    accepted = isinstance(result, Accepted)
    pose = result.evidence.pose
    wrong = accepted and pose is not None and _nearer_to(other, truth, pose)
    undecided = isinstance(result, Refused) and isinstance(result.cause, RivalUnbeaten)
    return np.array([accepted, wrong, undecided, not (accepted or undecided), both, prior_wrong], dtype=np.float64)


def _capture(cell: Cell, rig: Rig, normal: FloatArray, rng: np.random.Generator) -> Correspondences | None:
    """Points of the scene, seen with noise; None where the devices do not share enough of it."""
    middle = np.array(rig.camera.size) / 2 - 0.5
    camera_px = middle + cell.span * np.array(rig.camera.size) * rng.uniform(-0.5, 0.5, (POINTS_ON_WALL, 2))
    rays = np.column_stack([rig.camera.unproject(camera_px), np.ones(POINTS_ON_WALL)])
    with np.errstate(divide="ignore"):
        depth = 1 / (rays @ normal)
    if cell.second_plane_deg:
        axis = np.cross(normal, rng.normal(size=3))
        turn = rotation_from_vector(np.radians(cell.second_plane_deg) * axis / np.linalg.norm(axis))
        other = turn @ normal
        other /= other[2]  # both meet the optical axis at distance 1
        second = rays[:, :2] @ np.array([axis[1], -axis[0]]) > 0
        depth = np.where(second, 1 / (rays @ other), depth)
    depth[: cell.off_points] *= 1 + cell.offset * rng.choice([-1, 1], cell.off_points) * rng.uniform(
        0.5, 1.5, cell.off_points
    )
    points = rays * depth[:, None]
    projector_px = rig.projector.project(rig.projector_from_camera.apply(points))
    seen = (depth > 0) & rig.projector.contains(np.nan_to_num(projector_px, nan=-1e9))
    if np.count_nonzero(seen) < 0.5 * POINTS_ON_WALL:
        return None
    noise = rng.normal(0, NOISE_PX, (2, POINTS_ON_WALL, 2))
    return Correspondences((camera_px + noise[0])[seen], (projector_px + noise[1])[seen])


def _candidates(truth: RigidTransform, normal: FloatArray) -> tuple[PlanarPose, PlanarPose]:
    return planar_pose_candidates(truth.R + np.outer(truth.t, normal), np.array([0.0, 0.0, 1.0]))


def _drifted(t: FloatArray, drift_deg: float, rng: np.random.Generator) -> FloatArray:
    """t turned by that angle about a random axis; in any direction for the largest."""
    if drift_deg >= UNKNOWN_DRIFT:
        direction = rng.normal(size=3)
        return direction / np.linalg.norm(direction) * np.linalg.norm(t)
    axis = np.cross(t, rng.normal(size=3))
    return rotation_from_vector(np.radians(drift_deg) * axis / np.linalg.norm(axis)) @ t


def _nearer_to(other: PlanarPose, truth: RigidTransform, found: RigidTransform) -> bool:
    """Whether the pose found is the other candidate's rather than the truth."""
    to_other = rotation_angle(found.R @ other.R.T) + direction_angle(found.t, other.translation_over_distance)
    to_truth = rotation_angle(found.R @ truth.R.T) + direction_angle(found.t, truth.t)
    return to_other < to_truth
