"""Real captures of a calibrated rig: the pose from each by itself, against the static calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from retrue.correspondences import Correspondences
from retrue.errors import RetrueError
from retrue.experiments.peers import Method, Pose, methods, missing
from retrue.experiments.study import Cell as Number
from retrue.experiments.study import Line, Panel, Study, Table
from retrue.geometry.camera import Camera
from retrue.geometry.transform import direction_angle, rotation_angle
from retrue.recalibration.candidates import with_planes
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.rays import rays_of_captures
from retrue.recalibration.recalibrate import recalibrate
from retrue.recalibration.result import Refused
from retrue.rig import Rig

NOISE_PX = 0.25
MOST_COMPARED = 4000  # evenly at random, the same for everybody
OUR_JOB = "retrue recalibrate"


def real(rig: Rig, captures: Mapping[str, Correspondences], *, trials: int = 1, seed: int = 0) -> Study:
    """Errors against `rig`, in degrees: from the largest plane of each capture, all its points, and all captures.

    Every method gets the same undistorted pixels; of several poses the one nearest to the rig counts. Each of `trials`
    draws other points from the capture; the median error is given.
    """
    rng = np.random.default_rng(seed)
    pinhole = replace(rig, camera=_pinhole(rig.camera), projector=_pinhole(rig.projector))
    rows: list[tuple[Number, ...]] = []
    for name, capture in captures.items():
        everything = _undistorted(rig, capture)
        plane = _largest_plane(pinhole, everything, rng)
        for part, points in (("largest plane", plane), ("all points", everything)):
            poses = methods(NOISE_PX) if part == "largest plane" else _relative(methods(NOISE_PX))
            errors: dict[str, list[tuple[float, float]]] = {method: [] for method in (*poses, OUR_JOB)}
            for _ in range(trials):
                drawn = points.select(np.sort(rng.choice(len(points), min(MOST_COMPARED, len(points)), replace=False)))
                for method, solve in poses.items():
                    errors[method].append(_error(_attempt(solve, pinhole, drawn), pinhole))
                errors[OUR_JOB].append(_error(_ours(pinhole, [drawn]), pinhole))
            rows += [(name, part, len(points), method, *_median(found)) for method, found in errors.items()]
    if len(captures) > 1:
        together = [_undistorted(rig, capture) for capture in captures.values()]
        error = _error(_ours(pinhole, together), pinhole)
        rows.append(("all together", "all points", sum(map(len, together)), OUR_JOB, *error))
    rows += [("any", "not installed", 0, name, float("nan"), float("nan")) for name in missing()]
    table = Table("real", ("capture", "points_from", "N", "method", "rotation_deg", "translation_deg"), rows)
    return Study("real", table, _panels(table, list(captures)))


def _panels(table: Table, names: list[str]) -> tuple[Panel, ...]:
    panels: list[Panel] = []
    for part in ("largest plane", "all points"):
        rows = table.where(points_from=part)
        lines: list[Line] = []
        for method in dict.fromkeys(str(name) for name in rows.column("method")):
            found = [rows.where(capture=name, method=method).column("rotation_deg") for name in names]
            errors = [float(value) for values in found for value in values]
            lines.append(Line(method, list(range(len(errors))), errors))
        panels.append(Panel(f"from the {part}" if part != "all points" else "from all points", "capture",
                            "error in rotation, deg", lines, log_y=True))  # fmt: skip
    return tuple(panels)


def _pinhole(camera: Camera) -> Camera:
    return Camera(camera.size, camera.K)


def _undistorted(rig: Rig, points: Correspondences) -> Correspondences:
    camera, projector = rig.camera.unproject(points.camera_px), rig.projector.unproject(points.projector_px)
    good = np.isfinite(camera).all(axis=1) & np.isfinite(projector).all(axis=1)
    return Correspondences(
        _pinhole(rig.camera).pixels_from_rays(camera[good]), _pinhole(rig.projector).pixels_from_rays(projector[good])
    )


def _largest_plane(rig: Rig, points: Correspondences, rng: np.random.Generator) -> Correspondences:
    options = RecalibrateOptions()
    rays = rays_of_captures(rig, [points], options.max_points, rng)
    rays, _ = with_planes(rays, rig, options, rng)
    return points.select(rays.row[rays.points.plane_index == 0])


def _relative(found: Mapping[str, Method]) -> dict[str, Method]:
    """Those that do not take all points to lie on one plane."""
    return {name: method for name, method in found.items() if "homography" not in name}


def _attempt(solve: Method, rig: Rig, points: Correspondences) -> Sequence[Pose]:
    try:
        return solve(rig, points)
    except (RetrueError, RuntimeError, ValueError):
        return []


def _ours(rig: Rig, captures: Sequence[Correspondences]) -> list[Pose]:
    result = recalibrate(rig, captures)
    pose = result.evidence.pose  # not the rig's, which is kept where it holds: here it is the truth
    return [] if isinstance(result, Refused) or pose is None else [(pose.R, pose.t)]


def _error(poses: Sequence[Pose], rig: Rig) -> tuple[float, float]:
    """Rotation and direction of t, in degrees, of the nearest pose; NaN where there is none."""
    truth = rig.projector_from_camera
    errors = [
        (
            float(np.degrees(rotation_angle(R @ truth.R.T))),
            float(np.degrees(min(direction_angle(t, truth.t), direction_angle(-t, truth.t)))),
        )
        for R, t in poses
    ]
    return min(errors, key=lambda error: error[0] + error[1], default=(float("nan"), float("nan")))


def _median(errors: list[tuple[float, float]]) -> tuple[float, float]:
    rotation, translation = np.median(np.array(errors), axis=0)
    return float(rotation), float(translation)
