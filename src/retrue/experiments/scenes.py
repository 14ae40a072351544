"""Rigs and planes with known truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.correspondences import Correspondences
from retrue.geometry.arrays import FloatArray
from retrue.geometry.camera import Camera
from retrue.geometry.homography import apply_homography
from retrue.geometry.planar_pose import PlanarPose, in_front
from retrue.geometry.transform import RigidTransform, direction_angle, rotation_from_vector
from retrue.geometry.two_view import TwoViewPoints, TwoViewPose, cramer_rao_bound
from retrue.rig import Rig

CAMERA = Camera((1280, 960), np.array([[1600, 0, 639.5], [0, 1600, 479.5], [0, 0, 1]]))
PROJECTOR = Camera((1024, 768), np.array([[1400, 0, 511.5], [0, 1400, 700], [0, 0, 1]]))
SMALLEST_FOLD = np.radians(1.0)
LARGEST_MOVE = np.radians(60.0)


def random_rotation(rng: np.random.Generator) -> FloatArray:
    """Evenly over all rotations: a unit quaternion of four normal numbers."""
    w, x, y, z = (q := rng.normal(size=4)) / np.linalg.norm(q)
    angle = 2 * float(np.arctan2(np.linalg.norm([x, y, z]), w))
    axis = np.array([x, y, z])
    return rotation_from_vector(axis / np.linalg.norm(axis) * angle)


def random_planar_pose(rng: np.random.Generator, count: int, spread: float) -> tuple[PlanarPose, FloatArray]:
    """A pose and `count` camera rays (count, 2) within +-spread, all on a plane that both devices have in front.

    Any rotation, t / d normal per axis, any plane; t at least a degree off the plane's normal.
    """
    while True:
        R, t, normal = random_rotation(rng), rng.normal(size=3), rng.normal(size=3)
        normal *= np.sign(normal[2]) / np.linalg.norm(normal)
        pose = PlanarPose(R, t, normal)
        camera = rng.uniform(-spread, spread, (count, 2))
        fold = min(direction_angle(t, R @ normal), direction_angle(-t, R @ normal))
        if fold > SMALLEST_FOLD and in_front(pose, camera).all():
            return pose, camera


def random_rig(rng: np.random.Generator) -> tuple[Rig, FloatArray]:
    """A projector beside the camera, turned so that both look at a plane at distance 1 along the axis."""
    normal = np.array([*rng.normal(0, 0.35, 2), 1.0])
    t = np.array([rng.choice([-1, 1]) * rng.uniform(0.1, 0.5), rng.normal(0, 0.1), rng.normal(0, 0.1)])
    aim = rotation_from_vector([0.0, np.arctan2(t[0], 1.0), 0.0])
    R = rotation_from_vector(rng.normal(0, 0.05, 3)) @ aim.T
    return Rig(CAMERA, PROJECTOR, RigidTransform(R, t)), normal


def random_old_pose(truth: RigidTransform, rng: np.random.Generator) -> RigidTransform:
    """That pose before a move of up to 60 degrees in any direction, in rotation and in the direction of t."""
    axes = rng.normal(size=(2, 3))
    turns: FloatArray = axes / np.linalg.norm(axes, axis=1, keepdims=True) * rng.uniform(0, LARGEST_MOVE, (2, 1))
    return RigidTransform(rotation_from_vector(turns[0]) @ truth.R, rotation_from_vector(turns[1]) @ truth.t)


@dataclass(frozen=True, slots=True, eq=False)
class PlaneScene:
    """A rig that looks at one plane.

    Attributes
    ----------
    pose : the truth; n of the plane in units of |t|.
    camera_px : (N, 2) where the points are seen without noise.
    projector_px : (N, 2) likewise.
    """

    rig: Rig
    pose: TwoViewPose
    camera_px: FloatArray
    projector_px: FloatArray

    def bound(self, noise_px: float) -> FloatArray:
        """(5, 5) Cramer-Rao bound for that noise per axis in both pictures."""
        points = TwoViewPoints(
            self.rig.camera.unproject(self.camera_px),
            self.rig.projector.unproject(self.projector_px),
            np.full(len(self.camera_px), noise_px / self.rig.camera.K[0, 0]),
            np.full(len(self.camera_px), noise_px / self.rig.projector.K[0, 0]),
            np.zeros(len(self.camera_px), dtype=np.int64),
        )
        return cramer_rao_bound(self.pose, points)

    def observed(self, noise_px: float, outliers: float, rng: np.random.Generator) -> Correspondences:
        """The points with normal noise in both pictures, a share of them matched at random."""
        camera = self.camera_px + rng.normal(0, noise_px, self.camera_px.shape)
        projector = self.projector_px + rng.normal(0, noise_px, self.projector_px.shape)
        wrong = rng.permutation(len(camera))[: round(outliers * len(camera))]
        projector[wrong] = rng.uniform([0, 0], self.rig.projector.size, (len(wrong), 2))
        return Correspondences(camera, projector)


@dataclass(frozen=True, slots=True)
class Setup:
    """How a rig sees a plane.

    Attributes
    ----------
    name : for tables.
    rotation_deg : rotation vector of projector from camera.
    t : translation, in distances along the optical axis.
    normal : of the plane, in the camera frame, at distance 1 along the optical axis.
    share : of the camera picture's width that the points span.
    camera, projector : intrinsics.
    """

    name: str
    rotation_deg: tuple[float, float, float]
    t: tuple[float, float, float]
    normal: tuple[float, float, float]
    share: float
    camera: Camera = CAMERA
    projector: Camera = PROJECTOR

    def scene(self, count: int, rng: np.random.Generator) -> PlaneScene:
        """With `count` points spread at random over that share of the picture, seen by both devices."""
        transform = RigidTransform.from_rotation_vector(np.radians(self.rotation_deg), self.t)
        rig = Rig(self.camera, self.projector, transform)
        n = np.array(self.normal) / self.normal[2]
        H = transform.R + np.outer(transform.t, n)
        middle = np.array(self.camera.size) / 2 - 0.5
        camera_px = np.empty((0, 2))
        projector_px = np.empty((0, 2))
        while len(camera_px) < count:
            drawn = middle + self.share * np.array(self.camera.size) * rng.uniform(-0.5, 0.5, (4 * count, 2))
            mapped = self.projector.pixels_from_rays(apply_homography(H, self.camera.unproject(drawn)))
            seen = self.projector.contains(mapped)
            camera_px = np.concatenate([camera_px, drawn[seen]])[:count]
            projector_px = np.concatenate([projector_px, mapped[seen]])[:count]
        length = float(np.linalg.norm(transform.t))
        pose = TwoViewPose(transform.R, transform.t / length, n[None] * length)
        return PlaneScene(rig, pose, camera_px, projector_px)
