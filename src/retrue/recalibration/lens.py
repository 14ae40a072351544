"""What a lens may have changed by: focal length, principal point, k1; and how well the rig knows its own."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from retrue.errors import InputError
from retrue.geometry.arrays import FloatArray, finite_array
from retrue.geometry.camera import DISTORTION_LENGTHS, Camera
from retrue.geometry.five_points import sampson_squares
from retrue.geometry.planar_pose import planar_pose_candidates_batch
from retrue.geometry.transform import skew
from retrue.geometry.two_view import TwoViewPoints, TwoViewPose, planes_of_pose
from retrue.rig import Rig

LENS_PARAMETERS = 4
"""Of a device: log of the relative focal length, principal point (x, y) in px, k1; the camera's four come first."""
LENS_NAMES = ("focal length", "principal point in x", "principal point in y", "k1")
FOCAL = [0, LENS_PARAMETERS]
WIDE_FOCAL, WIDE_PRINCIPAL_POINT, WIDE_K1 = 0.2, 0.03, 0.2
"""Of a lens that may have changed: relative, share of the picture's diagonal, absolute."""

LIKELY = 15.5  # of chi-square with eight degrees of freedom
MOST_COEFFICIENTS = max(DISTORTION_LENGTHS)
NET = 9  # values of each focal length to start from
SCORED_POINTS = 300


@dataclass(frozen=True, slots=True, eq=False)
class LensPrior:
    """Normal distribution of the eight changes, around zero.

    Attributes
    ----------
    covariance : (8, 8).
    precision : (8, 8) its inverse.
    """

    covariance: FloatArray
    precision: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "precision", np.linalg.inv(self.covariance))

    def likely(self, change: FloatArray) -> bool:
        """Whether lenses as calibrated may be off by so much: no further than nineteen of twenty are."""
        return float(change @ self.precision @ change) < LIKELY


def stated_prior(rig: Rig, focal: float, principal_point_px: float, k1: float) -> LensPrior:
    """As the calibration wrote it into the rig's evidence ("lens_covariance"); else with those standard deviations."""
    stated = rig.evidence.get("lens_covariance")
    if stated is None:
        return LensPrior(np.diag(np.square([focal, principal_point_px, principal_point_px, k1] * 2)))
    covariance = finite_array(stated, (2 * LENS_PARAMETERS, 2 * LENS_PARAMETERS), "rig evidence, lens_covariance")
    values = np.linalg.eigvalsh(covariance)
    if not values[0] > 0:
        raise InputError(
            "rig evidence, lens_covariance: expected a covariance, found eigenvalues that are not positive"
        )
    return LensPrior(covariance)


def wide_prior(rig: Rig, stated: LensPrior) -> LensPrior:
    """Of lenses that somebody may have touched; on top of what the calibration left uncertain."""
    sigmas: list[float] = []
    for device in (rig.camera, rig.projector):
        diagonal = float(np.hypot(*device.size))
        sigmas += [WIDE_FOCAL, WIDE_PRINCIPAL_POINT * diagonal, WIDE_PRINCIPAL_POINT * diagonal, WIDE_K1]
    return LensPrior(stated.covariance + np.diag(np.square(sigmas)))


def changed_device(device: Camera, change: FloatArray) -> Camera:
    """The device with its four lens parameters (4,) changed by that much."""
    if not change.any():
        return device
    K, distortion = lens_numbers(device, change)
    return replace(device, K=K, distortion=distortion[: len(device.distortion)])


def lens_numbers(device: Camera, change: FloatArray) -> tuple[FloatArray, FloatArray]:
    """K (3, 3) and all twelve coefficients of distortion of the same."""
    K, distortion = device.K.copy(), np.zeros(MOST_COEFFICIENTS)
    K[:2, :2] *= np.exp(change[0])
    K[:2, 2] += change[1:3]
    distortion[: len(device.distortion)] = device.distortion
    distortion[0] += change[3]
    return K, distortion


def scaled_starts(
    points: TwoViewPoints, homographies: list[FloatArray], count: int
) -> list[tuple[FloatArray, TwoViewPose]]:
    """The best lens changes (8,) of a net over both focal lengths, each with a pose that a plane allows there.

    Scaled rays scale a homography, H' = D_p H D_c^-1, so that its two poses are at hand for each pair of focal
    lengths; they are scored by the Sampson residual that all points leave, which saturates.
    """
    ratios = np.linspace(-WIDE_FOCAL, WIDE_FOCAL, NET)
    pairs = np.stack(np.meshgrid(ratios, ratios), axis=-1).reshape(-1, 2)
    step = max(1, len(points) // SCORED_POINTS)
    few = points.select(slice(None, None, step))
    found: list[tuple[float, FloatArray, FloatArray, FloatArray]] = []
    variance = float(np.median(few.camera_sigma**2 + few.projector_sigma**2))
    rays = [(few.camera_rays * np.exp(-ratio), few.projector_rays * np.exp(-ratio)) for ratio in ratios]
    squares = np.zeros((2 * len(pairs), len(few)))
    for plane in range(min(len(homographies), 2)):
        scaled = [_scaled(homographies[plane], *pair) for pair in pairs]
        mine = points.camera_rays[points.plane_index == plane]
        poses = planar_pose_candidates_batch(np.array(scaled), [*mine.mean(axis=0), 1.0])
        R, t = poses.R.reshape(-1, 3, 3), poses.translation_over_distance.reshape(-1, 3)  # of each pair, both in turn
        lengths = np.linalg.norm(t, axis=1)
        determined = np.flatnonzero(lengths > 0)
        t = t / np.where(lengths > 0, lengths, 1.0)[:, None]
        for row in determined:
            of_projector, of_camera = divmod(row // 2, NET)
            sampson_squares(skew(t[row]) @ R[row], rays[of_camera][0], rays[of_projector][1], squares[row])
        costs = np.log1p(squares / (100 * variance)).sum(axis=1)
        found += [(float(costs[row]), pairs[row // 2], R[row], t[row]) for row in determined]
    found.sort(key=lambda one: one[0])
    return [_start(pair, R, t, homographies) for _, pair, R, t in found[:count]]


def _start(
    pair: FloatArray, R: FloatArray, t: FloatArray, homographies: list[FloatArray]
) -> tuple[FloatArray, TwoViewPose]:
    change = np.zeros(2 * LENS_PARAMETERS)
    change[FOCAL] = pair
    return change, TwoViewPose(R, t, planes_of_pose(R, t, [_scaled(H, *pair) for H in homographies]))


def _scaled(H: FloatArray, camera: float, projector: float) -> FloatArray:
    return np.exp([-projector, -projector, 0])[:, None] * H * np.exp([camera, camera, 0])
