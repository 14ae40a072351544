"""A page of every kind, from analytic scenes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from retrue import Rig, RigidTransform
from retrue.calibration.board import parse_board
from retrue.calibration.calibrate import calibrate_views
from retrue.calibration.observations import View
from retrue.calibration.options import CalibrationOptions
from retrue.calibration.result import Calibrated, RefusedCalibration
from retrue.capture import Capture
from retrue.recalibration.recalibrate import recalibrate
from retrue.recalibration.verify import verify
from retrue.reconstruction.reconstruct import reconstruct
from retrue.report.calibration_page import calibration_page
from retrue.report.page import Page, Provenance, page_html
from retrue.report.recalibration_page import recalibration_page
from retrue.report.reconstruction_page import reconstruction_page
from retrue.report.verification_page import verification_page
from tests.recalibration.scenes import CAMERA, PROJECTOR, RIG, SPHERE, WALL, Scene, capture

PROVENANCE = Provenance("retrue verify rig.json", "2024-05-01 12:00:00+00:00", {"retrue": "0.1.0"})
GRID = (34, 27)  # points that are asked for: enough to see, quick to draw
SIZES = {"camera": CAMERA.size, "projector": PROJECTOR.size}


def photograph() -> np.ndarray:
    """Something to see: a gradient, 1280 x 960, grey."""
    return np.broadcast_to(np.linspace(30, 200, 1280).astype(np.uint8), (960, 1280)).copy()


def seen(scene: Scene | None = None, name: str = "scene.png", seed: int = 0) -> Capture:
    """A wall with a ball before it."""
    return Capture(name, capture(scene or Scene((WALL,), (SPHERE,)), grid=GRID, seed=seed), photograph())


def moved(rig: Rig, degrees: float) -> Rig:
    """The rig before its projector was turned about the camera."""
    turn = RigidTransform.from_rotation_vector(np.radians([0, degrees, degrees]), np.zeros(3))
    return replace(rig, projector_from_camera=turn @ rig.projector_from_camera)


def accepted(name: str = "scene.png", unit: str = "m", out: str = "new.json") -> Page:
    """The rig has turned by some degrees."""
    capture, before = seen(name=name), replace(moved(RIG, 2.0), unit=unit)
    return recalibration_page(before, [capture], recalibrate(before, [capture.points]), out=out)


def unchanged() -> Page:
    """The rig has not moved, and knows its pose better than the captures do."""
    rig = replace(RIG, evidence={"covariance": (1e-10 * np.eye(5)).tolist()})
    return recalibration_page(rig, [seen()], recalibrate(rig, [seen().points]))


def refused() -> Page:
    """A patch of a wall alone, and a rig file that could come from either of the two poses."""
    wall = Capture("patch.png", capture(Scene((WALL,)), area=(0.4, 0.6, 0.4, 0.6), grid=GRID), photograph())
    turned = RigidTransform.from_rotation_vector([0, 0, 0.7], np.zeros(3)).R @ RIG.projector_from_camera.t
    before = replace(RIG, projector_from_camera=RigidTransform(RIG.projector_from_camera.R, turned))
    return recalibration_page(before, [wall], recalibrate(before, [wall.points]))


def hardly_anything() -> Page:
    """Five points, and no photograph."""
    few = Capture("few.csv", capture(Scene()).select(np.arange(5)))
    return recalibration_page(RIG, [few], recalibrate(RIG, [few.points]))


def good() -> Page:
    """Two captures of a rig that holds."""
    captures = [seen(name="first.png"), seen(name="second.png", seed=1)]
    return verification_page(RIG, captures, verify(RIG, [capture.points for capture in captures]))


def drifted() -> Page:
    """A rig that does not."""
    return verification_page(moved(RIG, 2.0), [seen()], verify(moved(RIG, 2.0), [seen().points]))


def reconstructed() -> Page:
    """A cloud without colors of its own."""
    points = replace(seen().points, colors=None)
    capture = Capture("scene.csv", points)
    return reconstruction_page(RIG, capture, reconstruct(RIG, points), faces=7)


def calibration(views: int = 5, options: CalibrationOptions | None = None) -> Calibrated | RefusedCalibration:
    """Of a board held at some poses, each tilted another way; with one, it is refused."""
    board = parse_board("chessboard:7x9:20mm")
    rig = replace(RIG, projector_from_camera=replace(RIG.projector_from_camera, t=1000 * RIG.projector_from_camera.t))
    noise = np.random.default_rng(0)
    held: list[View] = []
    for k in range(views):
        tilt = np.array([0.5 * np.cos(2.4 * k), 0.5 * np.sin(2.4 * k), 0.3 * k])
        pose = RigidTransform.from_rotation_vector(tilt, [-60.0 + 20 * k, -90.0 + 10 * k, 700.0 + 60 * k])
        X = pose.apply(np.pad(board.points, ((0, 0), (0, 1))))
        pixels = rig.camera.project(X), rig.projector.project(rig.projector_from_camera.apply(X))
        pixels = tuple(each + noise.normal(scale=0.1, size=each.shape) for each in pixels)
        held.append(View(f"capture_{k}", board.points, pixels, (np.ones(len(X)), np.ones(len(X)))))
    return calibrate_views(held, board, (CAMERA.size, PROJECTOR.size), options)


def calibrated(views: int = 5, options: CalibrationOptions | None = None) -> Page:
    """The page of it."""
    return calibration_page(calibration(views, options), SIZES, "mm", out="rig.json")


PAGES: dict[str, Callable[[], Page]] = {
    "accepted": accepted,
    "refused": refused,
    "hardly_anything": hardly_anything,
    "good": good,
    "drifted": drifted,
    "reconstructed": reconstructed,
    "calibrated": calibrated,
    "calibration_refused": lambda: calibrated(1),
    "calibration_too_uncertain": lambda: calibrated(5, CalibrationOptions(largest_error=1e-6)),
}


def html(page: Page) -> str:
    """The file."""
    return page_html(page, PROVENANCE)
