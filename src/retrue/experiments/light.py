"""The projector's own light tells the twin poses of a bare wall apart: how often, how surely, and what defeats it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import cast

import numpy as np

from retrue.correspondences import Correspondences
from retrue.experiments.scenes import random_old_pose
from retrue.experiments.study import Cell as Number
from retrue.experiments.study import Line, Panel, Study, Table
from retrue.experiments.trials import Progress, run_trials
from retrue.experiments.walls import Wall, wall_scene
from retrue.geometry.arrays import FloatArray
from retrue.geometry.transform import RigidTransform, direction_angle, rotation_angle
from retrue.recalibration.candidates import with_planes
from retrue.recalibration.light import log_irradiance
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.predicted_light import in_the_cameras_curve, measured_light, predicted_light
from retrue.recalibration.rays import rays_of_captures
from retrue.recalibration.reasons import RivalUnbeaten
from retrue.recalibration.recalibrate import recalibrate
from retrue.recalibration.result import Accepted, PoseCandidate, Refused
from retrue.rig import Rig

BINS = 24
PLACE = "place across the lit patch, px"
MOST_PANELS = 6

HOSTILE = Wall("all of these", print=1.2, gloss=0.5, gamma=0.45, lamp=0.4)


def all_walls() -> list[Wall]:
    """Each enemy by itself, all together over three spans, and what no light can be told from."""
    return [
        *(Wall("plain paint", span) for span in (0.6, 0.3, 0.15)),
        Wall("bold print", print=1.2),
        Wall("gloss", gloss=0.5),
        Wall("a camera's curve", gamma=0.45),
        Wall("a projector darker at one edge", lamp=0.4),
        *(replace(HOSTILE, span=span) for span in (0.6, 0.3, 0.15)),
        Wall("paint that darkens slowly", gradient=1.5),
    ]


def light(
    trials: int = 40,
    seed: int = 0,
    *,
    walls: Sequence[Wall] | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Study:
    """Random rigs, each before a wall of which both twins lie in front of both devices; the old pose up to 60 deg off.

    Table columns: of each kind of wall, answers that are right, wrong (nearer to the twin), `cannot tell` and refused
    for another reason, with the light and, in percent, right without it; the median log evidence (nats) that the light
    gives the truth over its twin.
    """
    walls = all_walls() if walls is None else list(walls)
    results = run_trials(_trial, walls, trials, seed, workers=workers, progress=progress)
    rows: list[tuple[Number, ...]] = []
    for wall, outcome in zip(walls, results, strict=True):
        right, _, cannot_tell, refused, without = (100 * outcome[:, :5].mean(axis=0)).tolist()
        margin = float(np.nanmedian(outcome[:, 5])) if np.isfinite(outcome[:, 5]).any() else float("nan")
        wrong = int(outcome[:, 1].sum())
        rows.append((wall.name, wall.span, len(outcome), right, wrong, cannot_tell, refused, without, margin))
    columns = ("wall", "span", "trials", "right_%", "wrong", "cannot_tell_%", "refused_%")
    table = Table("light", (*columns, "right_in_the_dark_%", "nats"), rows)
    rng = np.random.default_rng(seed)
    examples = [wall for wall in (Wall("plain paint"), HOSTILE) if any(wall.name == one.name for one in walls)]
    panels = tuple(_example(wall, rng) for wall in examples)
    wrong = sum(int(row[4]) for row in rows)
    return Study(
        "light",
        table,
        (*panels, _by_span(table)),
        (f"wrong and accepted: {wrong} of {trials * len(walls)} captures",),
    )


def light_of_captures(rig: Rig, captures: Mapping[str, Correspondences], *, seed: int = 0) -> Study:
    """Every plane of real captures by itself, the old pose off by up to 60 deg; `rig` is the static calibration.

    Table columns: `rotation_deg` and `translation_deg` of the answer from `rig`, its light's evidence (nats) over the
    strongest rival, and how far the measured log light lies from what the answer and that rival predict, in the median.
    """
    rng = np.random.default_rng(seed)
    rows: list[tuple[Number, ...]] = []
    panels: list[Panel] = []
    for name, points in captures.items():
        for index, plane in enumerate(_planes(rig, points, rng), start=1):
            old = replace(rig, projector_from_camera=random_old_pose(rig.projector_from_camera, rng))
            result = recalibrate(old, [plane])
            evidence, pose = result.evidence, result.evidence.pose
            title, off = f"{name}, plane {index}", (float("nan"), float("nan"))
            if pose is not None:
                off = _off_deg(pose, rig.projector_from_camera)
            nats, missed, other = float("nan"), float("nan"), float("nan")
            if evidence.rivals:
                strongest = min(range(len(evidence.rivals)), key=lambda one: evidence.rivals[one].margin)
                answer, *others = evidence.candidates
                drawn = _profile_of(title, rig, plane, answer, others[strongest])
                panels += [drawn] if drawn.lines else []
                missed, other = (_missed(drawn, line) for line in (1, 2))
                nats = evidence.rivals[strongest].light
            said = result.verdict if isinstance(result, Accepted) else result.cause.name
            rows.append((name, index, len(plane), said, *off, nats, missed, other))
    columns = ("capture", "plane", "points", "answer", "rotation_deg", "translation_deg", "nats")
    table = Table("light", (*columns, "answer_misses", "rival_misses"), rows)
    return Study("light", table, tuple(panels[:MOST_PANELS]))


def _profile_of(title: str, rig: Rig, points: Correspondences, answer: PoseCandidate, rival: PoseCandidate) -> Panel:
    """Measured brightness beside what both candidates predict, across the patch."""
    measured = measured_light(points)
    expected = [in_the_cameras_curve(measured, predicted_light(rig, one, points)) for one in (answer, rival)]
    return _profile(title, points, measured, {"the answer": expected[0], "its rival": expected[1]})


def _profile(title: str, points: Correspondences, measured: FloatArray, expected: Mapping[str, FloatArray]) -> Panel:
    """Medians over strips across the direction in which the last prediction changes most."""
    known = np.isfinite([measured, *expected.values()]).all(axis=0)
    if np.count_nonzero(known) < BINS:  # as of a rival that has the plane turned away from the projector
        return Panel(title, PLACE, "brightness", [])
    x = points.camera_px[known] - points.camera_px[known].mean(axis=0)
    steepest = list(expected.values())[-1][known]
    slope = cast(FloatArray, np.linalg.lstsq(x, steepest - steepest.mean(), rcond=None)[0])
    along: FloatArray = x @ (slope / max(float(np.linalg.norm(slope)), 1e-12))
    strips = np.array_split(np.argsort(along), BINS)
    place = [float(np.median(along[strip])) for strip in strips]
    lines = [
        Line(name, place, [float(np.exp(np.median(values[known][strip]))) for strip in strips])
        for name, values in {"measured": measured, **expected}.items()
    ]
    return Panel(title, PLACE, "brightness", lines)


def _missed(panel: Panel, line: int) -> float:
    """How far a prediction lies from what was measured, of log light, in the median."""
    if not panel.lines:
        return float("nan")
    measured, predicted = (np.log(panel.lines[index].y) for index in (0, line))
    return float(np.median(np.abs(measured - predicted)))


def _by_span(table: Table) -> Panel:
    lines: list[Line] = []
    for name in ("plain paint", HOSTILE.name):
        rows = table.where(wall=name)
        if not rows.rows:
            continue
        spans = [float(value) for value in rows.column("span")]
        lines.append(Line(f"{name}, with the light", spans, [float(v) for v in rows.column("right_%")]))
        lines.append(Line(f"{name}, without", spans, [float(v) for v in rows.column("right_in_the_dark_%")]))
    return Panel("a bare wall after any move", "share of the picture that is lit", "answered, and right, %", lines)


def _trial(wall: Wall, rng: np.random.Generator) -> FloatArray:
    """(6,): right, wrong, cannot tell, refused otherwise, right without the light, nats of the light for the truth."""
    scene = wall_scene(wall, rng)
    truth = scene.rig.projector_from_camera
    twin = RigidTransform(scene.twin.R, scene.twin.translation_over_distance)
    old = replace(scene.rig, projector_from_camera=random_old_pose(truth, rng))
    found, dark = (recalibrate(old, [points]) for points in (scene.points, replace(scene.points, light=None)))
    right, in_the_dark = (_is_right(result, twin, truth) for result in (found, dark))
    accepted = isinstance(found, Accepted)
    undecided = isinstance(found, Refused) and isinstance(found.cause, RivalUnbeaten)
    nats, pose = float("nan"), found.evidence.pose
    if pose is not None and found.evidence.rivals:
        strongest = min(found.evidence.rivals, key=lambda rival: rival.margin).light
        nats = -strongest if _nearer(pose, twin, truth) else strongest
    outcome = (right, accepted and not right, undecided, not (accepted or undecided), in_the_dark, nats)
    return np.array(outcome, dtype=np.float64)


def _is_right(result: Accepted | Refused, twin: RigidTransform, truth: RigidTransform) -> bool:
    pose = result.evidence.pose
    return isinstance(result, Accepted) and pose is not None and not _nearer(pose, twin, truth)


def _example(wall: Wall, rng: np.random.Generator) -> Panel:
    """The profile of one scene."""
    scene = wall_scene(wall, rng)
    y, measured = scene.rig.projector.unproject(scene.points.projector_px), measured_light(scene.points)
    expected: dict[str, FloatArray] = {}
    for name, pose in (("the true pose", scene.truth), ("its twin", scene.twin)):
        planes = np.tile(pose.normal, (len(y), 1))
        irradiance = log_irradiance(y, pose.R, pose.translation_over_distance, planes)
        expected[name] = in_the_cameras_curve(measured, irradiance)
    return _profile(f"one wall: {wall.name}", scene.points, measured, expected)


def _planes(rig: Rig, points: Correspondences, rng: np.random.Generator) -> list[Correspondences]:
    """The points of each plane of a capture, the largest first."""
    options = RecalibrateOptions()
    rays = rays_of_captures(rig, [points], options.max_points, rng)
    rays, homographies = with_planes(rays, rig, options, rng)
    return [points.select(rays.row[rays.points.plane_index == index]) for index in range(len(homographies))]


def _off_deg(pose: RigidTransform, truth: RigidTransform) -> tuple[float, float]:
    angles = rotation_angle(pose.R @ truth.R.T), direction_angle(pose.t, truth.t)
    return float(np.degrees(angles[0])), float(np.degrees(angles[1]))


def _nearer(pose: RigidTransform, twin: RigidTransform, truth: RigidTransform) -> bool:
    """Whether a pose is nearer to the twin than to the truth."""
    return sum(_off_deg(pose, twin)) < sum(_off_deg(pose, truth))
