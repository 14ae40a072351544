"""Boards left out: calibrate on the others, recalibrate on one after a bump of 3 degrees; simulated, so truth is known.

    python -m benchmarks.left_out_boards [TRIALS] [SEED]

Corners of the board are printed off their places, alike in all poses. Its points are sines', each with noise of its
own; a wall stands behind it. The pose that comes back is held against that of the rig before the bump, which is itself
off, and against the truth; errors squared over their covariance are 5 in the mean where that is honest.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.calibration import pose_error, true_rig
from retrue.calibration.board import Board, parse_board
from retrue.calibration.calibrate import calibrate_views
from retrue.calibration.detection import BoardCorners
from retrue.calibration.observations import View
from retrue.calibration.options import CalibrationOptions
from retrue.calibration.result import Calibrated
from retrue.calibration.views import projected_view
from retrue.correspondences import Correspondences
from retrue.geometry.arrays import FloatArray
from retrue.geometry.transform import RigidTransform, rotation_from_vector
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.recalibrate import recalibrate
from retrue.recalibration.verify import verify
from retrue.rig import Rig

BUMP_DEG = 3.0
GOAL_DEG = 0.08, 0.06
CORNER_PX, POINT_PX = 0.05, 0.4
WALL = 1.3
"""Times the board's distance."""
KINDS = ((3, 0.0), (3, 0.2), (9, 0.0), (9, 0.2))
"""Poses, and how far corners are printed off their places, mm; a pixel of the camera is about a millimetre."""


@dataclass(frozen=True)
class LeftOut:
    """What became of one; angles in degrees, of rotation and of direction of t; None where refused."""

    calibrated: bool
    verdict: str = ""
    from_rig: tuple[float, float] | None = None
    from_truth: tuple[float, float] | None = None
    squared: float = np.nan


def main(trials: int, seed: int) -> None:
    for poses, print_mm in KINDS:
        seen = [
            _left_out(np.random.default_rng([seed, poses, trial]), poses, print_mm, trial) for trial in range(trials)
        ]
        rigs = [own for own in seen if own.calibrated]
        answers = [own for own in rigs if own.from_rig is not None]
        squared = [own.squared for own in answers]
        near = sum(all(off <= goal for off, goal in zip(own.from_rig or (), GOAL_DEG, strict=True)) for own in answers)
        print(
            f"{poses - 1} boards, printed to {print_mm} mm: {len(rigs)} of {trials} calibrated, "
            f"{sum(own.verdict == 'good' for own in rigs)} verify good, {len(answers)} recalibrated, {near} within "
            f"{GOAL_DEG[0]} / {GOAL_DEG[1]} deg of the rig's own pose; median off it {_medians(answers, 'from_rig')}, "
            f"off the truth {_medians(answers, 'from_truth')}; squared error mean {np.mean(squared):.1f}, median "
            f"{np.median(squared):.1f}",
            flush=True,
        )


def _left_out(rng: np.random.Generator, poses: int, print_mm: float, seed: int) -> LeftOut:
    board, truth = parse_board("chessboard:9x13:30mm"), true_rig(rng)
    printed = rng.normal(scale=print_mm, size=board.points.shape)
    pairs = [_taken(truth, board, printed, rng, f"pose {k}") for k in range(poses)]
    sizes = truth.camera.size, truth.projector.size
    found = calibrate_views([view for view, _ in pairs[1:]], board, sizes, CalibrationOptions())
    if not isinstance(found, Calibrated):
        return LeftOut(False)
    rig, points = found.rig, pairs[0][1]
    turn = rotation_from_vector(np.radians(BUMP_DEG) * _unit(rng.normal(size=3)))
    old = rig.projector_from_camera
    bumped = replace(rig, projector_from_camera=RigidTransform(turn @ old.R, turn @ old.t))
    verdict = verify(rig, [points]).verdict
    answer = recalibrate(bumped, [points], RecalibrateOptions(seed=seed))
    if answer.verdict == "refused":
        return LeftOut(True, verdict)
    own = answer.rig.projector_from_camera
    error = pose_error(own, truth.projector_from_camera)
    squared = float(error @ np.linalg.solve(np.array(answer.rig.evidence["covariance"]), error))
    return LeftOut(True, verdict, _angles(pose_error(own, old)), _angles(error), squared)


def _taken(
    rig: Rig, board: Board, printed: FloatArray, rng: np.random.Generator, name: str
) -> tuple[View, Correspondences]:
    """One pose: the board as calibration sees it, and every third pixel's point of the board and the wall."""
    extent = board.points.max(axis=0)
    while True:
        turn = rotation_from_vector([0, 0, rng.uniform(-0.3, 0.3)])
        tilt, way = rng.uniform(np.radians(5), np.radians(40)), rng.uniform(0, 2 * np.pi)
        R = rotation_from_vector([tilt * np.cos(way), tilt * np.sin(way), 0]) @ turn
        middle = np.array([rng.uniform(-150, 150), rng.uniform(-120, 120), rng.uniform(1300, 1900)])
        pose = RigidTransform(R, middle - R @ np.append(extent / 2, 0))
        corners = rig.camera.project(pose.apply(np.column_stack([board.points + printed, np.zeros(len(printed))])))
        lit = rig.projector.project(rig.projector_from_camera.apply(pose.apply(np.pad(board.points, ((0, 0), (0, 1))))))
        if rig.camera.contains(corners, -20).all() and rig.projector.contains(lit, -20).mean() > 0.9:
            break
    x, y = np.meshgrid(*(np.arange(0.0, side, 3.0) for side in rig.camera.size))
    camera_px = np.stack([x.ravel(), y.ravel()], axis=-1)
    rays = np.column_stack([rig.camera.unproject(camera_px), np.ones(len(camera_px))])
    there = rays * ((R[:, 2] @ pose.t) / (rays @ R[:, 2]))[:, None]
    square = pose.inverse().apply(there)[:, :2] / board.spacing
    beyond = ~((square > -1) & (square < extent / board.spacing + 1)).all(axis=1)
    there[beyond] = rays[beyond] * WALL * pose.t[2]
    projector_px = rig.projector.project(rig.projector_from_camera.apply(there))
    projector_px += rng.normal(scale=POINT_PX, size=projector_px.shape)
    seen = np.isfinite(projector_px).all(axis=1) & rig.projector.contains(projector_px)
    sizes = {"camera_size": rig.camera.size, "projector_size": rig.projector.size}
    points = Correspondences(camera_px[seen], projector_px[seen], **sizes)
    found = BoardCorners(board.points, corners + rng.normal(scale=CORNER_PX, size=corners.shape), True)
    return projected_view(name, found, points, board), points


def _unit(vector: FloatArray) -> FloatArray:
    return vector / np.linalg.norm(vector)


def _angles(error: FloatArray) -> tuple[float, float]:
    return float(np.degrees(np.linalg.norm(error[:3]))), float(np.degrees(np.linalg.norm(error[3:])))


def _medians(answers: Sequence[LeftOut], name: str) -> str:
    return " / ".join(f"{off:.3f}" for off in np.median([getattr(own, name) for own in answers], axis=0))


if __name__ == "__main__":
    words = [int(word) for word in sys.argv[1:]]
    main(words[0] if words else 24, words[1] if len(words) > 1 else 17)
