"""Static calibration next to OpenCV's: real captures, left-out poses, simulated truth, two cameras, time.

    python benchmarks/calibration.py [--data FOLDER] [--trials N]

Every row gives OpenCV's figure and ours, from the same corners.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from retrue.calibration.board import Board, parse_board
from retrue.calibration.bundle import adjust
from retrue.calibration.calibrate import calibrate, calibrate_views
from retrue.calibration.detection import BoardCorners
from retrue.calibration.observations import View, corner_group
from retrue.calibration.options import CalibrationOptions
from retrue.calibration.result import Calibrated
from retrue.calibration.setup import INTRINSICS, Columns
from retrue.calibration.views import BoardCapture, StereoCapture, projected_view, see_views
from retrue.correspondences import Correspondences
from retrue.geometry.camera import Camera
from retrue.geometry.transform import (
    RigidTransform,
    rotation_angle,
    rotation_from_vector,
    skew,
    vector_from_rotation,
)
from retrue.geometry.two_view import tangent_basis
from retrue.rig import Rig

LENSES = {
    "none": ((), cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST),
    "k1 k2": (("k1", "k2"), cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST),
    "k1 k2 p1 p2 k3": (INTRINSICS[4:], 0),
}
Sizes = tuple[tuple[int, int], tuple[int, int]]


# OpenCV, as everybody calls it


def opencv_calibrate(views: list[View], sizes: Sizes, flags: int) -> tuple[float, Rig]:
    """calibrateCamera twice, stereoCalibrate once, intrinsics free."""
    board_points, pixels = [], ([], [])
    for view in views:
        seen = np.isfinite(np.hstack(view.pixels)).all(axis=1)
        board_points.append(np.pad(view.board_xy[seen], ((0, 0), (0, 1))).astype(np.float32))
        for device in (0, 1):
            pixels[device].append(view.pixels[device][seen].astype(np.float32))
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-12)
    intrinsics: list[Any] = []
    for device in (0, 1):
        _, K, distortion, _, _ = cv2.calibrateCamera(
            board_points, pixels[device], sizes[device], None, None, flags=flags, criteria=criteria
        )
        intrinsics += [K, distortion]
    flags |= cv2.CALIB_USE_INTRINSIC_GUESS
    rms, K1, d1, K2, d2, R, T, *_ = cv2.stereoCalibrate(
        board_points, *pixels, *intrinsics, sizes[0], flags=flags, criteria=criteria
    )
    cameras = [Camera(size, K, d.ravel()[:5]) for size, K, d in zip(sizes, (K1, K2), (d1, d2), strict=True)]
    return rms, Rig(*cameras, RigidTransform(R, T.ravel()))


def plain_joint_rms(views: list[View], sizes: Sizes, terms: Iterable[str]) -> float:
    """Ours on what OpenCV minimises: corners only, every pixel alike, no robust loss."""
    from retrue.calibration.calibrate import start

    groups = corner_group(views, 0), corner_group(views, 1)
    columns = Columns(2)
    active = np.zeros(columns.shared, dtype=bool)
    active[columns.pose] = True
    for device in (0, 1):
        active[columns.pinhole(device)] = True
        active[[columns.intrinsic(device, term) for term in terms]] = True
    fit = adjust(start(views, sizes, (None, None)), groups, active, robust=False)
    return float(np.sqrt(np.mean(np.sum(np.concatenate(fit.errors) ** 2, axis=1))))


def epipolar_rms(rig: Rig, view: View) -> float:
    """Sampson distance in pixels of the view's dense points on the board."""
    points = [
        np.column_stack([camera.unproject(pixels), np.ones(len(pixels))]) @ camera.K.T
        for camera, pixels in (
            (rig.camera, view.dense_camera_px),
            (rig.projector, view.dense_projector_px),
        )
    ]
    pose = rig.projector_from_camera
    F = np.linalg.inv(rig.projector.K).T @ skew(pose.t) @ pose.R @ np.linalg.inv(rig.camera.K)
    lines, back = points[0] @ F.T, points[1] @ F
    distance = np.sum(points[1] * lines, axis=1) / np.sqrt(np.sum(lines[:, :2] ** 2 + back[:, :2] ** 2, axis=1))
    return float(np.sqrt(np.nanmean(distance**2)))


# Real captures


def procam_captures(folder: Path, poses: int | None = None) -> list[BoardCapture]:
    """The board before walls, decoded; where more poses are asked for than there are, some of them again."""
    from retrue.files.board_captures import read_board_captures
    from retrue.files.patterns import read_pattern

    paths = sorted(folder.glob("capture_*"))
    paths = [paths[index % len(paths)] for index in range(poses or len(paths))]
    return read_board_captures(paths, read_pattern(folder / "pattern.json"), parse_board("chessboard:7x9:75mm"))


def real_projector(folder: Path) -> dict[str, Any]:
    """Joint RMS on the same corners, and epipolar RMS of poses that were left out."""
    board, sizes = parse_board("chessboard:7x9:75mm"), ((1280, 1024), (1024, 768))
    views, _ = see_views(procam_captures(folder), board, lambda message: None)
    print(f"\n{len(views)} real poses of {folder.name}: joint RMS of all corners, px   OpenCV      ours")
    rms: dict[str, tuple[float, float]] = {}
    for name, (terms, flags) in LENSES.items():
        rms[name] = opencv_calibrate(views, sizes, flags)[0], plain_joint_rms(views, sizes, terms)
        print(f"  lens {name:20s} plain least squares                  {rms[name][0]:10.6f} {rms[name][1]:10.6f}")
    print("left-out pose: epipolar RMS of its dense board points, px   ours      OpenCV with " + ", ".join(LENSES))
    epipolar: dict[str, tuple[float, dict[str, float]]] = {}
    for index, view in enumerate(views):
        rest = views[:index] + views[index + 1 :]
        ours = calibrate_views(rest, board, sizes, CalibrationOptions(largest_error=1))
        assert isinstance(ours, Calibrated), ours.reason
        theirs = {
            name: epipolar_rms(opencv_calibrate(rest, sizes, flags)[1], view) for name, (_, flags) in LENSES.items()
        }
        epipolar[view.name] = epipolar_rms(ours.rig, view), theirs
        print(f"  {view.name:50s} {epipolar[view.name][0]:10.3f}   " + "".join(f"{v:10.3f}" for v in theirs.values()))
    return {"rms": rms, "epipolar": epipolar}


def stereo_captures(folder: Path) -> list[StereoCapture]:
    """The pairs of the two cameras."""
    return [
        StereoCapture(left.stem, *(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in (left, right)))
        for left in sorted(folder.glob("left*.jpg"))
        if (right := left.with_name(left.name.replace("left", "right"))).exists()
    ]


def two_cameras(folder: Path) -> dict[str, tuple[float, float]]:
    """The same code on two cameras."""
    captures, sizes = stereo_captures(folder), ((640, 480), (640, 480))
    views, _ = see_views(captures, parse_board("chessboard:9x6:25mm"), lambda message: None)
    print(f"\n{len(views)} real pairs of {folder.name}: joint RMS of all corners, px   OpenCV      ours")
    rms: dict[str, tuple[float, float]] = {}
    for name, (terms, flags) in LENSES.items():
        rms[name] = opencv_calibrate(views, sizes, flags)[0], plain_joint_rms(views, sizes, terms)
        print(f"  lens {name:20s} plain least squares                  {rms[name][0]:10.6f} {rms[name][1]:10.6f}")
    ours = calibrate(captures, parse_board("chessboard:9x6:25mm"))
    print(f"  robust, lens terms chosen: {ours.reason}")
    return rms


# Simulated captures


@dataclass(frozen=True)
class Noise:
    """Standard deviations: of a corner in the camera and of a dense point in the projector, in pixels; of the
    projector's picture between two captures, in pixels; of the board's sag, the same in all poses, in mm; of an error
    that neighbouring dense points share, in pixels; of where a corner is printed and, apart, its whole line, in mm."""

    corner: float = 0.1
    dense: float = 0.15
    drift: float = 0.0
    sag: float = 0.0
    shared: float = 0.0
    printed: float = 0.0


AS_IN_LIFE = Noise(drift=0.02, sag=0.5)
DECODER = Noise(drift=0.02, sag=0.5, shared=0.05)
PRINTED = Noise(drift=0.02, sag=0.5, printed=0.2)


def true_rig(rng: np.random.Generator) -> Rig:
    """A camera with a lens, and a projector whose axis leaves its panel."""
    f, g = rng.uniform(1200, 2500), rng.uniform(1200, 2200)
    c = rng.uniform(-30, 30, 4)
    camera = Camera(
        (1280, 1024),
        np.array([[f, 0, 640 + c[0]], [0, f * rng.uniform(0.995, 1.005), 512 + c[1]], [0, 0, 1]]),
        np.array([rng.uniform(-0.2, 0.1), rng.uniform(-0.1, 0.1), 0, 0, 0]),
    )
    projector = Camera(
        (1024, 768),
        np.array([[g, 0, 512 + c[2]], [0, g * rng.uniform(0.995, 1.005), 800 + c[3]], [0, 0, 1]]),
        np.array([rng.uniform(-0.1, 0.05), 0, 0, 0, 0]),
    )
    # The projector stands below and looks up: its shifted lens lights what the camera sees.
    tilt = np.array([np.arctan((800 - 384) / g) + rng.uniform(-0.05, 0.05), *rng.uniform(-0.15, 0.15, 2)])
    R = rotation_from_vector(-tilt)
    centre = np.array([rng.uniform(-200, 200), rng.uniform(200, 400), rng.uniform(-50, 50)])
    aim = np.array([0, 0, 1600.0])
    side = R @ (aim - centre)
    bearing = np.array([512.0, 384.0])  # lit from the middle of the panel
    ray = np.append(projector.unproject(bearing[None])[0], 1)
    turn = np.cross(side / np.linalg.norm(side), ray / np.linalg.norm(ray))
    R = rotation_from_vector(turn / np.linalg.norm(turn) * np.arcsin(np.linalg.norm(turn))) @ R
    return Rig(camera, projector, RigidTransform(R, -R @ centre))


def with_every_term(rig: Rig, rng: np.random.Generator) -> Rig:
    """The rig with lenses as they are made: each coefficient has some size, be it too small to be seen."""
    sizes = np.array([0, 0.1, 5e-4, 5e-4, 0.05])
    devices = [
        Camera(device.size, device.K, device.distortion[:5] + rng.normal(size=5) * sizes)
        for device in (rig.camera, rig.projector)
    ]
    return Rig(*devices, rig.projector_from_camera)


def with_square_pixels(rig: Rig) -> Rig:
    """The same, fy as fx."""
    camera, projector = (
        replace(device, K=np.array([device.K[0], [0, device.K[0, 0], device.K[1, 2]], device.K[2]]))
        for device in (rig.camera, rig.projector)
    )
    return replace(rig, camera=camera, projector=projector)


def bend_of(board: Board, noise: Noise, rng: np.random.Generator) -> np.ndarray:
    """A random bend of the board, whose sag over half its length has the wanted standard deviation."""
    return rng.normal(scale=noise.sag, size=3) / (board.points.max() / 2) ** 2


def prints(board: Board, noise: Noise, rng: np.random.Generator) -> np.ndarray:
    """(N, 2) how far corners lie off, the same in all poses."""
    off = rng.normal(scale=noise.printed, size=board.points.shape)
    for axis, own in enumerate(board.points.T):
        lines, line = np.unique(own, return_inverse=True)
        off[:, axis] += rng.normal(scale=noise.printed, size=len(lines))[line]
    return off


def shared_error(camera_px: np.ndarray, rng: np.random.Generator, length: float = 60.0) -> np.ndarray:
    """(N, 2) a random field of unit variance; points d pixels apart correlate by exp(-d^2 / (2 length^2))."""
    waves = rng.normal(scale=1 / length, size=(2, 2, 50))  # of each coordinate
    phases = rng.uniform(0, 2 * np.pi, (2, 50))
    fields = [np.cos(camera_px @ wave + phase).sum(axis=1) for wave, phase in zip(waves, phases, strict=True)]
    return np.stack(fields, axis=-1) / 5


def simulated_view(
    rig: Rig,
    board: Board,
    noise: Noise,
    rng: np.random.Generator,
    name: str,
    every: int = 1,
    bend: np.ndarray | None = None,
    printed: np.ndarray | float = 0.0,
    turned: float = np.pi,
) -> View:
    """One pose of the board: noisy corners, and a dense code on the white squares, or only every n-th point of it."""
    extent = board.points.max(axis=0)

    def height(xy: np.ndarray) -> np.ndarray:
        x, y = (xy - extent / 2).T
        return np.stack([x * x, x * y, y * y], axis=-1) @ (np.zeros(3) if bend is None else bend)

    for _ in range(1000):
        turn = rotation_from_vector([0, 0, rng.uniform(-turned, turned)])
        tilt = rng.uniform(np.radians(15), np.radians(45))
        way = rng.uniform(0, 2 * np.pi)
        R = rotation_from_vector([tilt * np.cos(way), tilt * np.sin(way), 0]) @ turn
        middle = np.array([rng.uniform(-150, 150), rng.uniform(-120, 120), rng.uniform(1300, 1900)])
        pose = RigidTransform(R, middle - R @ np.append(extent / 2, 0))
        points = pose.apply(np.column_stack([board.points, height(board.points)]))
        corners = rig.camera.project(
            points + np.pad(np.broadcast_to(printed, (len(points), 2)), ((0, 0), (0, 1))) @ R.T
        )
        lit = rig.projector.project(rig.projector_from_camera.apply(points))
        if rig.camera.contains(corners, -20).all() and rig.projector.contains(lit, -20).mean() > 0.9:
            break
    x, y = np.meshgrid(
        *(np.arange(low, high, 3.0) for low, high in zip(corners.min(0) - 60, corners.max(0) + 60, strict=True))
    )
    camera_px = np.round(np.stack([x.ravel(), y.ravel()], axis=-1))
    rays = np.column_stack([rig.camera.unproject(camera_px), np.ones(len(camera_px))])
    on_board = rays * ((R[:, 2] @ pose.t) / (rays @ R[:, 2]))[:, None]
    for _ in range(3):  # where the ray meets the board as it is bent
        above = height(pose.inverse().apply(on_board)[:, :2])
        on_board = rays * ((R[:, 2] @ pose.t + above) / (rays @ R[:, 2]))[:, None]
    square = pose.inverse().apply(on_board)[:, :2] / board.spacing
    white = (np.floor(square).sum(axis=1) % 2 == 0) & ((square > -1) & (square < extent / board.spacing + 1)).all(
        axis=1
    )
    projector_px = rig.projector.project(rig.projector_from_camera.apply(on_board))
    thin = rng.random(len(white)) * every < 1
    keep = white & thin & np.isfinite(projector_px).all(axis=1) & rig.projector.contains(projector_px)
    projector_px = projector_px[keep] + rng.normal(scale=noise.dense, size=(int(keep.sum()), 2))
    projector_px += rng.normal(scale=noise.drift, size=2)
    if noise.shared:
        projector_px += noise.shared * shared_error(camera_px[keep], rng)
    found = BoardCorners(board.points, corners + rng.normal(scale=noise.corner, size=corners.shape), True)
    return projected_view(name, found, Correspondences(camera_px[keep], projector_px), board)


def parameters(rig: Rig) -> dict[str, dict[str, float]]:
    """By the names that the evidence uses for its sigmas."""
    values: dict[str, dict[str, float]] = {}
    for name, camera in (("camera", rig.camera), ("projector", rig.projector)):
        K = camera.K
        numbers = (K[0, 0], K[1, 1], K[0, 2], K[1, 2], *camera.distortion[:5])
        values[name] = dict(zip(INTRINSICS, map(float, numbers), strict=True))
    return values


def simulated(
    trials: int, counts: tuple[int, ...] = (5, 10, 20), seed: int = 0, noise: Noise | None = None
) -> dict[str, Any]:
    """How often a parameter lies within three of its sigmas, and the errors next to OpenCV's."""
    board, sizes = parse_board("chessboard:7x9:40mm"), ((1280, 1024), (1024, 768))
    noise = noise or Noise()
    z: list[float] = []
    errors: dict[int, list[tuple[float, ...]]] = {count: [] for count in counts}
    for trial in range(trials):
        rng = np.random.default_rng([seed, trial])
        count = counts[trial % len(counts)]
        truth = true_rig(rng)
        bend = bend_of(board, noise, rng)
        views = [simulated_view(truth, board, noise, rng, f"pose {i}", bend=bend) for i in range(count)]
        ours = calibrate_views(views, board, sizes, CalibrationOptions(largest_error=1))
        assert isinstance(ours, Calibrated), ours.reason
        theirs = opencv_calibrate(views, sizes, LENSES["k1 k2"][1])[1]
        mine, true = parameters(ours.rig), parameters(truth)
        for device in mine:
            for name, sigma in ours.evidence["sigma"][device].items():
                z.append((mine[device][name] - true[device][name]) / sigma)
        z += pose_z(ours, truth)
        errors[count].append((*rig_errors(ours.rig, truth), *rig_errors(theirs, truth)))
    within, total = int(np.sum(np.abs(z) <= 3)), len(z)
    print(
        f"\n{trials} simulated rigs, {noise}: {100 * within / total:.2f} % of {total} parameters within 3 sigma "
        f"(RMS of error / sigma {np.sqrt(np.mean(np.square(z))):.2f})"
    )
    print("mean errors        focal, %            rotation, deg       |t|, mm             point, mm")
    print("poses              ours     OpenCV     ours     OpenCV     ours     OpenCV     ours     OpenCV")
    for count, rows in errors.items():
        if rows:
            mean = np.mean(rows, axis=0)
            print(f"{count:5d}        " + "".join(f"{mean[i]:11.4f}{mean[i + 4]:9.4f} " for i in range(4)))
    return {"within": within / total, "errors": errors}


def covariances(
    trials: int,
    counts: tuple[int, ...] = (5, 8),
    seed: int = 11,
    noise: Noise = AS_IN_LIFE,
    every_term: bool = True,
    upright: bool = False,
) -> tuple[float, float]:
    """Mean normalised error squared of the eight numbers of `lens_covariance` and the five of `covariance`."""
    board, sizes = parse_board("chessboard:7x9:40mm"), ((1280, 1024), (1024, 768))
    squares: list[tuple[float, float]] = []
    for trial in range(trials):
        rng = np.random.default_rng([seed, trial])
        truth = true_rig(rng)
        truth = with_every_term(truth, rng) if every_term else truth
        truth = with_square_pixels(truth) if upright else truth  # boards that all stand upright hardly tell
        bend = bend_of(board, noise, rng)
        printed = prints(board, noise, rng) if noise.printed else 0.0
        count = counts[trial % len(counts)]
        views = [
            simulated_view(
                truth, board, noise, rng, f"pose {i}", bend=bend, printed=printed, turned=0.3 if upright else np.pi
            )
            for i in range(count)
        ]
        ours = calibrate_views(views, board, sizes, CalibrationOptions(largest_error=1))
        assert isinstance(ours, Calibrated), ours.reason
        squares.append(
            tuple(
                float(error @ np.linalg.solve(np.array(ours.evidence[key]), error))
                for key, error in (
                    ("lens_covariance", lens_parameters(ours.rig) - lens_parameters(truth)),
                    ("covariance", pose_error(ours.rig.projector_from_camera, truth.projector_from_camera)),
                )
            )
        )
    lens, pose = np.mean(squares, axis=0)
    deviation = np.std(squares, axis=0) / np.sqrt(trials)
    print(
        f"{trials} rigs, {noise}, lenses with {'every term' if every_term else 'k1 k2 and k1 only'}: "
        f"normalised error squared of 8 lens parameters {lens:.2f} +- {deviation[0]:.2f}, "
        f"of 5 of the pose {pose:.2f} +- {deviation[1]:.2f}"
    )
    return float(lens), float(pose)


def lens_parameters(rig: Rig) -> np.ndarray:
    """(8,) log sqrt(fx fy), cx, cy, k1 of the camera and the projector."""
    return np.concatenate(
        [
            [0.5 * np.log(device.K[0, 0] * device.K[1, 1]), *device.K[:2, 2], device.distortion[0]]
            for device in (rig.camera, rig.projector)
        ]
    )


def pose_error(pose: RigidTransform, truth: RigidTransform) -> np.ndarray:
    """(5,) rotation vector and direction of t from the truth to `pose`."""
    direction, true = (t / np.linalg.norm(t) for t in (pose.t, truth.t))
    return np.concatenate([vector_from_rotation(pose.R @ truth.R.T), tangent_basis(direction).T @ -true])


def pose_z(ours: Calibrated, truth: Rig) -> list[float]:
    """The pose's six errors in sigmas."""
    mine, true = ours.rig.projector_from_camera, truth.projector_from_camera
    turn = np.degrees(vector_from_rotation(mine.R @ true.R.T))
    sigma = ours.evidence["sigma"]["projector_from_camera"]
    return [
        *(turn / [sigma[f"r{axis}_deg"] for axis in "xyz"]),
        *((mine.t - true.t) / [sigma[f"t{axis}"] for axis in "xyz"]),
    ]


def rig_errors(rig: Rig, truth: Rig) -> tuple[float, float, float, float]:
    """Focal lengths in per cent, rotation in degrees, translation, and RMS of points triangulated over the picture."""
    focal = [
        100 * abs(mine.K[axis, axis] / true.K[axis, axis] - 1)
        for mine, true in ((rig.camera, truth.camera), (rig.projector, truth.projector))
        for axis in (0, 1)
    ]
    turn = np.degrees(rotation_angle(rig.projector_from_camera.R @ truth.projector_from_camera.R.T))
    shift = np.linalg.norm(rig.projector_from_camera.t - truth.projector_from_camera.t)
    x, y = np.meshgrid(np.linspace(200, 1080, 7), np.linspace(160, 860, 7))
    camera_px = np.stack([x.ravel(), y.ravel()], axis=-1)
    points = np.column_stack([truth.camera.unproject(camera_px), np.ones(49)]) * 1600
    projector_px = truth.projector.project(truth.projector_from_camera.apply(points))
    rays = np.column_stack([rig.camera.unproject(camera_px), np.ones(49)])
    seen = rig.projector.unproject(projector_px)
    turned, t = rays @ rig.projector_from_camera.R.T, rig.projector_from_camera.t
    a, b = turned[:, :2] - seen * turned[:, 2:], seen * t[2] - t[:2]
    there = rays * (np.sum(a * b, axis=1) / np.sum(a * a, axis=1))[:, None]
    point = np.sqrt(np.nanmean(np.sum((there - points) ** 2, axis=1)))
    return float(np.mean(focal)), float(turn), float(shift), float(point)


# Time


def timing(folder: Path, poses: int = 5, rounds: int = 5) -> dict[str, float]:
    """From files to rig, next to reading the files and OpenCV's three calibrations (which decode and find nothing)."""
    board, sizes = parse_board("chessboard:7x9:75mm"), ((1280, 1024), (1024, 768))
    folders = sorted(folder.glob("capture_*"))
    paths = [path for index in range(poses) for path in sorted(folders[index % len(folders)].iterdir())]
    views, _ = see_views(procam_captures(folder, poses), board, lambda message: None)

    def ours() -> None:
        result = calibrate(procam_captures(folder, poses), board, sizes[1])
        assert isinstance(result, Calibrated), result.reason

    def theirs(flag: int) -> None:
        for path in paths:
            cv2.imread(str(path), flag)
        opencv_calibrate(views, sizes, 0)

    jobs: dict[str, Callable[[], None]] = {
        "ours": ours,
        "reading": lambda: procam_captures(folder, poses) and None,
        "OpenCV": lambda: theirs(cv2.IMREAD_COLOR),
        "OpenCV, grey": lambda: theirs(cv2.IMREAD_GRAYSCALE),
    }
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(rounds):  # in turn, so that whatever else the machine does hits all alike
        for name, job in jobs.items():
            started = time.perf_counter()
            job()
            times[name].append(time.perf_counter() - started)
    seconds = {name: statistics.median(values) for name, values in times.items()}
    print(
        f"\ntime for {poses} poses ({len(folders)} different ones), median of {rounds}, s: ours {seconds['ours']:.2f} "
        f"(of which read, find and decode {seconds['reading']:.2f})"
    )
    for name in ("OpenCV", "OpenCV, grey"):
        print(f"  {name:14s} {seconds[name]:.2f}: ours takes {seconds['ours'] / seconds[name]:.2f} of it")
    return seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=Path(__file__).parents[2] / "shared" / "data")
    parser.add_argument("--trials", type=int, default=60)
    arguments = parser.parse_args()
    if arguments.data.exists():
        real_projector(arguments.data / "procam-board")
        two_cameras(arguments.data / "stereo-board")
        timing(arguments.data / "procam-board")
    else:
        print(f"no real captures at {arguments.data}")
    for noise in (Noise(), AS_IN_LIFE):
        simulated(arguments.trials, noise=noise)
    for noise in (AS_IN_LIFE, DECODER, PRINTED):
        covariances(arguments.trials, noise=noise)
    covariances(arguments.trials, (3, 10), noise=PRINTED, every_term=False, upright=True)
    covariances(arguments.trials, every_term=False)


if __name__ == "__main__":
    main()
