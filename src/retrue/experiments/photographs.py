"""Pairs of photographs against the calibration of their cameras: ours beside what people would use instead.

All get the same matches, those of `match_photographs`, but for one: the recipe of "dynamic recalibration" that Luxonis
published for its cameras in 2022 (depthai, dynamic_recalibration.py) finds its own, with OpenCV's features at their
defaults, a ratio of 0.8, an essential matrix by MAGSAC and `recoverPose`; here with the pixels undistorted first.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib import import_module

import numpy as np

from retrue.correspondences import Correspondences
from retrue.errors import InputError, RetrueError
from retrue.experiments.peers import Pose, methods, missing
from retrue.experiments.study import Cell, Line, Panel, Study, Table
from retrue.files.photographs import PhotographPair
from retrue.geometry.arrays import FloatArray, Image
from retrue.geometry.camera import Camera
from retrue.geometry.transform import direction_angle, rotation_angle
from retrue.recalibration.recalibrate import recalibrate
from retrue.rig import Rig

OURS, RECIPE = "retrue", "OpenCV, recipe of 2022"
TOGETHER = 10
NOISE_PX = 0.25  # of what peers are told to take for an inlier
RATIO = 0.8
COLUMNS = (
    "pair",
    "method",
    "rotation_deg",
    "translation_deg",
    "sigma_rotation_deg",
    "sigma_translation_deg",
    "verdict",
    "seconds",
)


def photographs(rig: Rig, pairs: Sequence[PhotographPair]) -> Study:
    """Errors of each pair by itself against `rig`, in degrees, of every method; and of ours from ten pairs together.

    A pose that ours refuses counts as found here, so that nobody is compared on the easier pairs; the verdict says it.
    """
    if not pairs:
        raise InputError("experiment photographs: expected pairs of photographs, found none")
    rows: list[tuple[Cell, ...]] = []
    for pair in pairs:
        points, name = pair.capture.points, pair.capture.name
        rows.append((name, *_ours(rig, [points])))
        rows += [(name, *_peer(method, solve, rig, points)) for method, solve in _peers().items()]
        rows.append((name, *_timed(RECIPE, lambda pair=pair: recipe(rig, pair.left, pair.right), rig)))
    if len(pairs) > 1:
        first = pairs[:TOGETHER]
        rows.append((f"first {len(first)} together", *_ours(rig, [pair.capture.points for pair in first])))
    table = Table("photographs", COLUMNS, rows)
    return Study("photographs", table, _panels(table), remarks=_remarks(table))


def recipe(rig: Rig, left: Image, right: Image) -> list[Pose]:
    """Features, ratio test, essential matrix, `recoverPose`: no sigma, no refusal."""
    cv2 = import_module("cv2")
    finder = cv2.SIFT_create()
    levels = [image if image.dtype == np.uint8 else (image // 257).astype(np.uint8) for image in (left, right)]
    grey = [image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in levels]
    (first, a), (second, b) = (finder.detectAndCompute(image, None) for image in grey)
    if a is None or b is None or len(b) < 2:
        return []
    found = [
        (m.queryIdx, m.trainIdx) for m, n in cv2.BFMatcher().knnMatch(a, b, k=2) if m.distance < RATIO * n.distance
    ]
    if len(found) < 20:
        return []
    x = rig.camera.unproject(np.array([first[row].pt for row, _ in found]))
    y = rig.projector.unproject(np.array([second[row].pt for _, row in found]))
    known = np.isfinite(x + y).all(axis=1)
    x, y = x[known], y[known]
    f = float(np.mean([rig.camera.K[0, 0], rig.projector.K[0, 0]]))
    E, mask = cv2.findEssentialMat(x, y, np.eye(3), cv2.USAC_MAGSAC, 0.999, 1.0 / f)
    if E is None or E.shape != (3, 3):
        return []
    _, R, t, _ = cv2.recoverPose(E, x, y, np.eye(3), mask=mask)
    return [(R, t.ravel())]


def _ours(rig: Rig, captures: list[Correspondences]) -> tuple[Cell, ...]:
    start = time.perf_counter()
    result = recalibrate(rig, captures)
    seconds = time.perf_counter() - start
    pose, sigma = result.evidence.pose, result.evidence.sigma
    errors = (np.nan, np.nan) if pose is None else _errors(rig, (pose.R, pose.t))
    known = (np.nan, np.nan) if sigma is None else (sigma.rotation_deg, sigma.translation_deg)
    return (OURS, *errors, *known, result.verdict, seconds)


def _peers() -> dict[str, Callable[[Rig, Correspondences], list[Pose]]]:
    """Those that do not take all points to lie on one plane."""
    return {name: solve for name, solve in methods(NOISE_PX).items() if "homography" not in name}


def _peer(
    name: str, solve: Callable[[Rig, Correspondences], list[Pose]], rig: Rig, points: Correspondences
) -> tuple[Cell, ...]:
    rays = [rig.camera.unproject(points.camera_px), rig.projector.unproject(points.projector_px)]
    known = np.isfinite(rays[0] + rays[1]).all(axis=1)
    pinhole = replace(rig, camera=_pinhole(rig.camera), projector=_pinhole(rig.projector))
    cameras = (pinhole.camera, pinhole.projector)
    pixels = [camera.pixels_from_rays(side[known]) for camera, side in zip(cameras, rays, strict=True)]
    return _timed(name, lambda: solve(pinhole, Correspondences(pixels[0], pixels[1])), rig)


def _timed(name: str, solve: Callable[[], list[Pose]], rig: Rig) -> tuple[Cell, ...]:
    start = time.perf_counter()
    try:
        poses = solve()
    except (RetrueError, RuntimeError, ValueError):
        poses = []
    seconds = time.perf_counter() - start
    errors = min((_errors(rig, pose) for pose in poses), default=(np.nan, np.nan))
    return (name, *errors, np.nan, np.nan, "answered" if poses else "nothing", seconds)


def _errors(rig: Rig, pose: Pose) -> tuple[float, float]:
    """Of rotation and of the direction of t, either way round, in degrees."""
    true = rig.projector_from_camera
    turn, shift = pose
    directions = [direction_angle(sign * shift, true.t) for sign in (1.0, -1.0)]
    return float(np.degrees(rotation_angle(turn @ true.R.T))), float(np.degrees(min(directions)))


def _pinhole(camera: Camera) -> Camera:
    return Camera(camera.size, camera.K)


def _singly(table: Table, method: str, column: str) -> FloatArray:
    rows = table.where(method=method)
    alone = [not str(name).endswith(" together") for name in rows.column("pair")]
    return np.array(rows.column(column), dtype=np.float64)[alone]


def _methods(table: Table) -> list[str]:
    return list(dict.fromkeys(str(name) for name in table.column("method")))


def _panels(table: Table) -> tuple[Panel, ...]:
    panels: list[Panel] = []
    for column, label in (("rotation_deg", "rotation"), ("translation_deg", "direction of t")):
        lines: list[Line] = []
        for method in _methods(table):
            errors = np.sort(_singly(table, method, column))
            errors = errors[np.isfinite(errors)]
            lines.append(Line(method, list(range(1, 1 + len(errors))), errors.tolist()))
        panels.append(Panel(f"single pairs: {label}", "pairs with an error no larger", "deg", lines, log_y=True))
    return tuple(panels)


def _remarks(table: Table) -> tuple[str, ...]:
    """Each method in a line: median, 90 % and largest error of single pairs, and its time."""
    said: list[str] = []
    for method in _methods(table):
        parts: list[str] = []
        for column, label in (("rotation_deg", "rotation"), ("translation_deg", "direction of t")):
            errors = _singly(table, method, column)
            errors = errors[np.isfinite(errors)]
            if len(errors):
                middle, most = np.quantile(errors, [0.5, 0.9])
                parts.append(f"{label} {middle:.3f}, 90 % {most:.3f}, largest {errors.max():.3f} deg")
        answered = len([name for name in _singly(table, method, "rotation_deg") if np.isfinite(name)])
        seconds = float(np.median(_singly(table, method, "seconds")))
        said.append(f"{method}: {'; '.join(parts) or 'no pose'}; {answered} answered; {1e3 * seconds:.0f} ms")
    said += [f"not installed: {name}" for name in missing()]
    return tuple(said)
