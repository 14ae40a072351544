"""What people would use instead, all with one face: correspondences in pixels to candidate poses.

Each gets undistorted pixels, thresholds in pixels, and its own recommended settings otherwise. The best of the poses
that it returns counts, so that nobody is blamed for the twin.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np

from retrue.correspondences import Correspondences
from retrue.geometry.arrays import FloatArray
from retrue.geometry.camera import Camera
from retrue.geometry.homography import fit_homography
from retrue.geometry.planar_pose import planar_pose_candidates
from retrue.geometry.robust_homography import fit_homography_robust
from retrue.geometry.transform import skew
from retrue.rig import Rig

Pose = tuple[FloatArray, FloatArray]
Method = Callable[[Rig, Correspondences], list[Pose]]
THRESHOLD_SIGMAS = 4.0


def methods(noise_px: float) -> dict[str, Method]:
    """Those that are installed, by name, with thresholds for that noise."""
    threshold = max(THRESHOLD_SIGMAS * noise_px, 0.5)
    found: dict[str, Method] = {"retrue fit_homography": _ours, "retrue fit_homography_robust": _ours_robust}
    if find_spec("cv2") is not None:
        cv2 = import_module("cv2")
        flags = {
            "least squares": 0,
            "RANSAC": cv2.RANSAC,
            "LMEDS": cv2.LMEDS,
            "RHO": cv2.RHO,
            "MAGSAC": cv2.USAC_MAGSAC,
            "USAC": cv2.USAC_DEFAULT,
        }
        for name, flag in flags.items():
            found[f"OpenCV homography {name}"] = _opencv_homography(flag, threshold)
        found["OpenCV essential"] = _opencv_essential(threshold)
    if find_spec("poselib") is not None:
        found["PoseLib homography"] = _poselib_homography(threshold)
        found["PoseLib relative pose"] = _poselib_relative(threshold)
    if find_spec("pycolmap") is not None:
        found["pycolmap homography"] = _pycolmap_homography(threshold)
        found["pycolmap essential"] = _pycolmap_essential(threshold)
    return found


def missing() -> list[str]:
    """Names of the peers that are not installed."""
    names = {"cv2": "OpenCV", "poselib": "PoseLib", "pycolmap": "pycolmap"}
    return [name for module, name in names.items() if find_spec(module) is None]


def single_threaded() -> None:
    """For worker processes: one thread each."""
    if find_spec("cv2") is not None:
        import_module("cv2").setNumThreads(1)


def robust(name: str) -> bool:
    """Whether a method claims to stand outliers."""
    return name not in ("retrue fit_homography", "OpenCV homography least squares")


def _ours(rig: Rig, points: Correspondences) -> list[Pose]:
    x, y = rig.camera.unproject(points.camera_px), rig.projector.unproject(points.projector_px)
    H = fit_homography(x, y, source_sigma=1 / rig.camera.K[0, 0], target_sigma=1 / rig.projector.K[0, 0])
    poses = planar_pose_candidates(H, np.array([*x.mean(axis=0), 1.0]))
    return [(pose.R, pose.translation_over_distance) for pose in poses]


def _ours_robust(rig: Rig, points: Correspondences) -> list[Pose]:
    """The largest plane, found without being told the noise, and the maximum-likelihood homography of its points."""
    x, y = rig.camera.unproject(points.camera_px), rig.projector.unproject(points.projector_px)
    return _ours(rig, points.select(fit_homography_robust(x, y).inliers))


def _normalised(rig: Rig, H: FloatArray) -> FloatArray:
    return np.linalg.inv(rig.projector.K) @ H @ rig.camera.K


def _opencv_homography(flag: int, threshold: float) -> Method:
    def solve(rig: Rig, points: Correspondences) -> list[Pose]:
        cv2 = import_module("cv2")
        H = cv2.findHomography(points.camera_px, points.projector_px, flag, threshold)[0]
        if H is None:
            return []
        _, rotations, translations, _ = cv2.decomposeHomographyMat(_normalised(rig, H), np.eye(3))
        return [(R, t.ravel()) for R, t in zip(rotations, translations, strict=True)]

    return solve


def _opencv_essential(threshold: float) -> Method:
    def solve(rig: Rig, points: Correspondences) -> list[Pose]:
        cv2 = import_module("cv2")
        none = np.zeros(5)
        E, mask = cv2.findEssentialMat(
            points.camera_px, points.projector_px, rig.camera.K, none, rig.projector.K, none,
            cv2.RANSAC, 0.999, threshold,
        )[:2]  # fmt: skip
        if E is None or E.shape[0] < 3:
            return []
        x, y = rig.camera.unproject(points.camera_px), rig.projector.unproject(points.projector_px)
        poses: list[Pose] = []
        for k in range(0, E.shape[0], 3):
            _, R, t, _ = cv2.recoverPose(E[k : k + 3], x, y, np.eye(3), mask=mask.copy())
            poses.append((R, t.ravel()))
        return poses

    return solve


def _poselib_options(threshold: float) -> dict[str, float]:
    return {"max_reproj_error": threshold, "max_epipolar_error": threshold}


def _poselib_homography(threshold: float) -> Method:
    def solve(rig: Rig, points: Correspondences) -> list[Pose]:
        poselib = import_module("poselib")
        H, _ = poselib.estimate_homography(points.camera_px, points.projector_px, _poselib_options(threshold), {})
        poses, _ = poselib.motion_from_homography(_normalised(rig, H))
        return [(np.asarray(pose.R), np.asarray(pose.t)) for pose in poses]

    return solve


def _poselib_relative(threshold: float) -> Method:
    def camera(device: Camera) -> dict[str, Any]:
        K = device.K
        parameters = [K[0, 0], K[1, 1], K[0, 2], K[1, 2]]
        return {"model": "PINHOLE", "width": device.size[0], "height": device.size[1], "params": parameters}

    def solve(rig: Rig, points: Correspondences) -> list[Pose]:
        pose, _ = import_module("poselib").estimate_relative_pose(
            points.camera_px,
            points.projector_px,
            camera(rig.camera),
            camera(rig.projector),
            _poselib_options(threshold),
            {},
        )
        return [(np.asarray(pose.R), np.asarray(pose.t))]

    return solve


def _pycolmap_options(threshold: float) -> Any:
    options = import_module("pycolmap").RANSACOptions()
    options.max_error = threshold
    return options


def _pycolmap_homography(threshold: float) -> Method:
    def solve(rig: Rig, points: Correspondences) -> list[Pose]:
        found = import_module("pycolmap").estimate_homography_matrix(
            points.camera_px, points.projector_px, _pycolmap_options(threshold)
        )
        if found is None:
            return []
        # Its own decomposition returns one pose only; ours, of its homography, returns both.
        poses = planar_pose_candidates(_normalised(rig, found["H"]))
        return [(pose.R, pose.translation_over_distance) for pose in poses]

    return solve


def _pycolmap_essential(threshold: float) -> Method:
    def solve(rig: Rig, points: Correspondences) -> list[Pose]:
        pycolmap = import_module("pycolmap")

        def camera(device: Camera) -> Any:
            K = device.K
            parameters = [K[0, 0], K[1, 1], K[0, 2], K[1, 2]]
            width, height = device.size
            return pycolmap.Camera(model="PINHOLE", width=width, height=height, params=parameters)

        found = pycolmap.estimate_essential_matrix(
            points.camera_px,
            points.projector_px,
            camera(rig.camera),
            camera(rig.projector),
            _pycolmap_options(threshold),
        )
        if found is None:
            return []
        pose = found["cam2_from_cam1"].matrix()
        return [(pose[:, :3], pose[:, 3])]

    return solve


def longuet_higgins_poses(H: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """(R, t / d) of a plane from the eigenvectors of H^T H.

    With H scaled to middle singular value 1, two directions in the plane keep their length:
    u = (sqrt(1 - s3^2) v1 +- sqrt(s1^2 - 1) v3) / sqrt(s1^2 - s3^2). R takes (v2, u, v2 x u) to their images.

    Source: H. C. Longuet-Higgins, "The reconstruction of a plane surface from two perspective projections", 1986.

    >>> H = np.eye(3) + np.outer([0.3, 0.1, 0.0], [0.0, 0.6, 0.8])
    >>> min(float(np.abs(R - np.eye(3)).max()) for R, _ in longuet_higgins_poses(-2 * H)) < 1e-14
    True
    """
    H = H if np.linalg.det(H) > 0 else -H
    values, V = np.linalg.eigh(H.T @ H)
    H, values = H / np.sqrt(values[1]), values / values[1]
    V = V * np.linalg.det(V)
    v3, v2, v1 = V.T
    span = values[2] - values[0]
    p, q = np.sqrt(max(1 - values[0], 0) / span), np.sqrt(max(values[2] - 1, 0) / span)
    poses: list[tuple[FloatArray, FloatArray]] = []
    for u in (p * v1 + q * v3, p * v1 - q * v3):
        before = np.stack([v2, u, np.cross(v2, u)], axis=1)
        after = np.stack([H @ v2, H @ u, np.cross(H @ v2, H @ u)], axis=1)
        R = after @ before.T
        poses.append((R, (H - R) @ np.cross(v2, u)))
    return poses


def eight_point_poses(x: FloatArray, y: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """(R, t) of points in general position, |t| = 1: Hartley's normalised eight-point algorithm, on rays (N, 2)."""
    frames: list[FloatArray] = []
    for points in (x, y):
        centre = points.mean(axis=0)
        scale = np.sqrt(2) / np.hypot(*(points - centre).T).mean()
        frames.append(np.array([[scale, 0, -scale * centre[0]], [0, scale, -scale * centre[1]], [0, 0, 1]]))
    a, b = (np.c_[points, np.ones(len(points))] @ frame.T for points, frame in zip((x, y), frames, strict=True))
    design = (b[:, :, None] * a[:, None, :]).reshape(len(x), 9)
    E = frames[1].T @ np.linalg.svd(design)[2][8].reshape(3, 3) @ frames[0]
    U, _, Vt = np.linalg.svd(E)
    U, Vt = U * np.linalg.det(U), Vt * np.linalg.det(Vt)
    W = -skew(np.array([0.0, 0.0, 1.0])) + np.diag([0.0, 0.0, 1.0])
    return [(U @ turn @ Vt, sign * U[:, 2]) for turn in (W, W.T) for sign in (1.0, -1.0)]
