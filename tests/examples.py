"""One instance of everything public that is a value, as a user gets it."""

from __future__ import annotations

from dataclasses import is_dataclass, replace
from datetime import UTC, datetime
from functools import cache
from inspect import isabstract, isclass
from pathlib import Path

import numpy as np

import retrue
from retrue.calibration.detection import BoardCorners
from retrue.correspondences import Card
from retrue.simulation.mitsuba_truth import Truth
from tests.recalibration.scenes import RIG, SPHERE, WALL, Scene, bumped, capture
from tests.report.pages import calibration

COLUMNS, ROWS = 36, 28

SPACING = 0.96 * np.array([1024, 768]) / [COLUMNS - 1, ROWS - 1]


@cache
def examples() -> dict[str, object]:
    """By the name of the class; made anew in each process, as other processes would."""
    seen = capture(Scene([WALL], [SPHERE]), grid=(COLUMNS, ROWS))
    count = len(seen)
    points = replace(
        seen,
        projector_sigma_px=np.full(count, 0.2),
        confidence=np.linspace(0, 1, count),
        colors=np.full((count, 3), 90, np.uint8),
        cells=np.rint((seen.projector_px - seen.projector_px.min(axis=0)) / SPACING)[:, ::-1].astype(int),
        card=Card("blocks", count, count, {}, 0.5),
    )
    accepted = retrue.recalibrate(bumped(RIG, [0, 3, 0], [0, 1, 0]), [points])
    refused = retrue.recalibrate(bumped(RIG, [0, 30, 0], [0, 0, 60]), [capture(Scene(), area=(0.45, 0.65, 0.45, 0.65))])
    assert isinstance(accepted, retrue.Accepted), accepted
    assert isinstance(refused, retrue.Refused), refused
    cloud = retrue.with_normals(retrue.reconstruct(RIG, points, retrue.ReconstructOptions(keep_strays=True)))
    homography = np.array([[1.1, 0.1, 0.2], [0.0, 0.9, -0.1], [0.1, 0.0, 1.0]])
    grid = np.random.default_rng(0).uniform(-1, 1, (30, 2))
    lifted = np.column_stack([grid, np.ones(30)]) @ homography.T
    picture = np.full((48, 64, 3), 90, np.uint8)
    calibrated, uncertain = calibration(), calibration(5, retrue.CalibrationOptions(largest_error=1e-6))
    assert isinstance(calibrated, retrue.Calibrated), calibrated
    assert isinstance(uncertain, retrue.RefusedCalibration), uncertain
    simulated = retrue.Simulated(
        {"capture": picture.copy(), "white": picture.copy()},
        Truth(np.ones((48, 64)), np.zeros((48, 64), int), np.ones((48, 64), bool), grid.copy(), grid.copy()),
        {"camera": 0.01, "projector": 0.02},
    )
    entry = retrue.HistoryEntry(1, datetime(2026, 1, 2, tzinfo=UTC), "recalibrated", RIG, {"reason": "bumped"})
    line = retrue.DamagedLine(Path("rig.json.history.jsonl"), "line 2", "expected JSON, found other bytes")
    made = [
        RIG, RIG.camera, RIG.projector_from_camera, points, accepted, refused, cloud, simulated,
        calibrated, uncertain, calibrated.views[0],
        accepted.evidence, *accepted.evidence.candidates[:1], accepted.evidence.candidates[0].planes[0],
        accepted.evidence.change, accepted.evidence.sigma, refused.cause,
        retrue.verify(RIG, [points]), retrue.make_mesh(cloud), retrue.make_cad(cloud, retrue.CadOptions(0.05)),
        retrue.BoardCapture("pose 1", picture.copy(), points, BoardCorners(grid.copy(), grid.copy(), True)),
        retrue.StereoCapture("pose 1", picture.copy(), picture.copy()),
        retrue.fit_homography_robust(grid, lifted[:, :2] / lifted[:, 2:] + 1e-4 * np.sin(50 * grid[:, ::-1])),
        retrue.History((entry,), (line,)), entry, line,
        retrue.KnownDistance(np.array([100.0, 200.0]), np.array([300.5, 220.0]), 0.075),
        retrue.make_color_grid((640, 480), rows=12, columns=16), retrue.GrayCode((1024, 768)),
        retrue.make_line_grid(), retrue.Lines(((255, 0, 0), (0, 0, 255)), (0, 1, 1), 4, 8, 3),
        retrue.parse_board("chessboard:7x9:75mm"), *retrue.planar_pose_candidates(homography)[:1],
        retrue.planar_pose_candidates_batch(homography[None]),
        retrue.CadOptions(), retrue.CalibrationOptions(), retrue.RecalibrateOptions(), retrue.ReconstructOptions(),
        retrue.AcceptOptions(max_form=0.1), retrue.MergeOptions(), retrue.parse_artefact("spheres:25mm:150mm+-0.003mm"),
        retrue.SimulateOptions(), retrue.VerifyOptions(), retrue.RecordOptions(),
        retrue.Photographs(), retrue.Matches(grid.copy(), lifted[:, :2].copy(), np.ones(30)),
        retrue.Scale(1.01, 0.002, 0.99, 1.0, "two points"), *retrue.error_by_distance(RIG, [3.0]),
        retrue.Frame("phase", "column", period_px=64.0, shift=0.25),
        retrue.layout_sequence("slstudio-2x3", (1824, 1140)),
        retrue.parse_setup('[camera]\ndriver = "opencv"\n[projector]\ndriver = "window"\n', "setup.toml"),
    ]  # fmt: skip
    return {retrue_name(value): value for value in made}


def retrue_name(value: object) -> str:
    """The public class that a value is one of."""
    kinds = [kind.__name__ for kind in type(value).__mro__ if getattr(retrue, kind.__name__, None) is kind]
    return kinds[0] if kinds else type(value).__name__


def public_values() -> list[str]:
    """The public classes whose instances hold what was found, or what is asked for."""
    kinds = [getattr(retrue, name) for name in dir(retrue)]
    return [
        kind.__name__
        for kind in kinds
        if isclass(kind) and not isabstract(kind) and (is_dataclass(kind) or kind is retrue.PlanarPose)
        if kind not in (retrue.LiveRig, retrue.Recorder)  # devices, and what works them, are no values
    ]
