"""Captures of analytic scenes: every projector grid point's ray is met with planes and spheres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from retrue.correspondences import Correspondences
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform, rotation_from_vector
from retrue.rig import Rig

CAMERA = Camera((1280, 960), [[1600, 0, 640], [0, 1602, 480], [0, 0, 1]], [-0.1, 0.05, 4e-4, -3e-4, 0])
PROJECTOR = Camera((1024, 768), [[1400, 0, 510], [0, 1398, 700], [0, 0, 1]])
POSE = RigidTransform.from_rotation_vector([0.05, -0.2, 0.02], [0.35, -0.04, 0.06])
RIG = Rig(CAMERA, PROJECTOR, POSE, "m")

WALL = (np.array([0.25, 0.1, 1.0]), 1.6)
SIDE_WALL = (np.array([-0.9, 0.0, 0.6]), 0.95)
SPHERE = (np.array([0.05, 0.05, 1.25]), 0.16)


@dataclass(frozen=True)
class Scene:
    """Planes (normal, distance along the unit normal) and spheres (centre, radius), in the camera frame."""

    planes: Sequence[tuple[np.ndarray, float]] = (WALL,)
    spheres: Sequence[tuple[np.ndarray, float]] = ()


CENTRES = ([-0.2, -0.1, 1.2], [0.1, 0.12, 1.3], [0.3, -0.15, 1.15], [-0.1, 0.2, 1.4])
BALL = Scene(planes=[], spheres=[(np.array([0.0, 0.0, 1.6]), 0.5)])
BALLS = Scene(planes=[], spheres=[(np.array(centre), 0.13) for centre in CENTRES])


def first_hits(scene: Scene, origin: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """(N, 3) nearest scene point along each ray from the origin; NaN where there is none."""
    nearest = np.full(len(rays), np.inf)
    for normal, distance in scene.planes:
        unit = normal / np.linalg.norm(normal)
        with np.errstate(divide="ignore"):
            s = (distance - unit @ origin) / (rays @ unit)
        nearest = np.where((s > 0) & (s < nearest), s, nearest)
    for center, radius in scene.spheres:
        offset = origin - center
        a, b, c = (rays**2).sum(1), rays @ offset, offset @ offset - radius**2
        root = b * b - a * c
        s = np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0))) / a, np.inf)
        nearest = np.where((s > 0) & (s < nearest), s, nearest)
    nearest[~np.isfinite(nearest)] = np.nan
    return origin + nearest[:, None] * rays


def capture(
    scene: Scene,
    *,
    rig: Rig = RIG,
    noise: float = 0.1,
    outliers: float = 0.0,
    grid: tuple[int, int] = (51, 40),
    area: tuple[float, float, float, float] = (0.02, 0.98, 0.02, 0.98),
    seed: int = 0,
) -> Correspondences:
    """What an ideal decoder would return: noise on the camera side, a share of matches at random."""
    rng = np.random.default_rng(seed)
    width, height = rig.projector.size
    u = np.linspace(area[0] * width, area[1] * width, grid[0])
    v = np.linspace(area[2] * height, area[3] * height, grid[1])
    projector_px = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    camera_from_projector = rig.projector_from_camera.inverse()
    rays = np.c_[rig.projector.unproject(projector_px), np.ones(len(projector_px))] @ camera_from_projector.R.T
    points = first_hits(scene, camera_from_projector.t, rays)
    camera_px = rig.camera.project(points)
    seen = np.isfinite(camera_px).all(axis=1)
    seen[seen] &= rig.camera.contains(camera_px[seen])
    # Hidden where something nearer to the camera lies on the same camera ray.
    again = first_hits(scene, np.zeros(3), points)
    with np.errstate(invalid="ignore"):
        seen &= np.linalg.norm(again - points, axis=1) < 1e-6
    camera_px = camera_px[seen] + rng.normal(0, noise, (int(seen.sum()), 2))
    projector_px = projector_px[seen]
    wrong = rng.random(len(camera_px)) < outliers
    projector_px[wrong] = rng.uniform([0, 0], [width - 1, height - 1], (int(wrong.sum()), 2))
    return Correspondences(camera_px, projector_px, camera_sigma_px=np.full(len(camera_px), 0.1))


def bumped(rig: Rig, rotation_deg: Sequence[float], t_rotation_deg: Sequence[float], stretch: float = 1.0) -> Rig:
    """The same devices with another pose between them."""
    pose = rig.projector_from_camera
    return Rig(
        rig.camera,
        rig.projector,
        RigidTransform(
            rotation_from_vector(np.radians(rotation_deg)) @ pose.R,
            stretch * rotation_from_vector(np.radians(t_rotation_deg)) @ pose.t,
        ),
        rig.unit,
    )
