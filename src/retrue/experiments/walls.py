"""Bare walls that a projector lights, and what stands between the light that a camera reads and the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.correspondences import Correspondences
from retrue.experiments.scenes import CAMERA, random_rig
from retrue.geometry.arrays import FloatArray
from retrue.geometry.planar_pose import PlanarPose, in_front, planar_pose_candidates
from retrue.geometry.transform import rotation_angle
from retrue.rig import Rig

GRID = (26, 20)  # points across and down the lit patch
NOISE_PX = 0.1
LIGHT_NOISE = 0.03
GLOSS_POWER = 20


@dataclass(frozen=True, slots=True)
class Wall:
    """A bare wall, and what stands between its light and the truth.

    Attributes
    ----------
    name : for the table.
    span : of the picture's width and height that is lit.
    print : log contrast of tiles printed on it, each as dark as chance has it.
    gradient : log contrast of paint that darkens slowly from one side to the other.
    gloss : share of the light that is mirrored.
    gamma : of the camera's curve; 1 is linear.
    lamp : by what share the projector is darker at one edge.
    """

    name: str
    span: float = 0.3
    print: float = 0.0
    gradient: float = 0.0
    gloss: float = 0.0
    gamma: float = 1.0
    lamp: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class WallScene:
    """What a rig sees of a wall; the pose that is true, and its twin, which fits all points as well."""

    rig: Rig
    points: Correspondences
    truth: PlanarPose
    twin: PlanarPose


def wall_scene(wall: Wall, rng: np.random.Generator) -> WallScene:
    """A random rig before such a wall, of which both twins lie in front of both devices: geometry leaves two poses."""
    while True:
        rig, n = random_rig(rng)
        truth = rig.projector_from_camera
        camera_px = _patch(wall.span, rng)
        x = rig.camera.unproject(camera_px)
        depth = 1 / (np.column_stack([x, np.ones(len(x))]) @ n)
        X = np.column_stack([x, np.ones(len(x))]) * depth[:, None]
        projector_px = rig.projector.project(truth.apply(X))
        if not ((depth > 0).all() and rig.projector.contains(np.nan_to_num(projector_px, nan=-1e9)).all()):
            continue
        candidates = planar_pose_candidates(truth.R + np.outer(truth.t, n), [*x.mean(axis=0), 1.0])
        first, second = sorted(candidates, key=lambda pose: rotation_angle(pose.R @ truth.R.T))
        if in_front(second, x).all():
            break
    noise = rng.normal(0, NOISE_PX, (2, len(x), 2))
    light = _light(wall, rig, X, n, projector_px, rng)
    return WallScene(rig, Correspondences(camera_px + noise[0], projector_px + noise[1], light=light), first, second)


def _patch(span: float, rng: np.random.Generator) -> FloatArray:
    """Pixels of a grid over a part of the picture, anywhere."""
    size = span * np.array(CAMERA.size)
    corner = rng.uniform(0, 1, 2) * (np.array(CAMERA.size) - 1 - size)
    across, down = np.meshgrid(*(np.linspace(0, 1, count) for count in GRID))
    return corner + np.column_stack([across.ravel(), down.ravel()]) * size


def _light(
    wall: Wall, rig: Rig, X: FloatArray, n: FloatArray, projector_px: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """(N,) what the camera reads: a projector's pixel lights cos(theta) / (d^2 cos^3 alpha), the wall does the rest."""
    truth = rig.projector_from_camera
    beam = X - truth.inverse().t
    distance = np.linalg.norm(beam, axis=1)
    facing = np.abs(beam @ n) / distance / np.linalg.norm(n)
    alpha = np.arccos(np.clip((truth.apply(X) / distance[:, None])[:, 2], -1, 1))
    irradiance = facing / distance**2 / np.cos(alpha) ** 3
    raster = 2 * (projector_px + 0.5) / np.array(rig.projector.size) - 1
    place = (X - X.mean(axis=0)) @ np.linalg.svd(X - X.mean(axis=0), full_matrices=False)[2][:2].T
    place /= np.abs(place).max()
    tiles = rng.uniform(-1, 0, (12, 12))[tuple(np.clip((6 * (place + 1)).astype(int), 0, 11).T)]
    paint = np.exp(wall.print * tiles + wall.gradient * (place @ _direction(rng)) / 2)
    lamp = 1 - wall.lamp * (1 + raster @ _direction(rng)) / 2
    normal = n / np.linalg.norm(n)
    mirrored = beam / distance[:, None] - 2 * (beam @ normal / distance)[:, None] * normal
    lobe = np.maximum(-(mirrored * X).sum(axis=1) / np.linalg.norm(X, axis=1), 0) ** GLOSS_POWER
    shade = (1 - wall.gloss) * paint + wall.gloss * lobe
    fall_off = (X[:, 2] / np.linalg.norm(X, axis=1)) ** 4
    read = np.maximum(irradiance * lamp * shade * fall_off, 1e-6) ** wall.gamma
    return read / read.max() * (1 + rng.normal(0, LIGHT_NOISE, len(X)))


def _direction(rng: np.random.Generator) -> FloatArray:
    angle = rng.uniform(0, 2 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])
