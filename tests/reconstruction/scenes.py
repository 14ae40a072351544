"""A wall, a plate before it and a ball, seen through a known pinhole camera."""

import numpy as np

from retrue.correspondences import Correspondences
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.rig import Rig

CAMERA = Camera((320, 240), [[350, 0, 160], [0, 350, 120], [0, 0, 1]], [-0.05, 0.01, 0, 0, 0])
PROJECTOR = Camera((1024, 768), [[1400, 0, 512], [0, 1400, 700], [0, 0, 1]])
RIG = Rig(CAMERA, PROJECTOR, RigidTransform.from_rotation_vector([0.02, 0.2, 0.0], [-300.0, 10.0, 20.0]), unit="mm")
WALL, PLATE, BALL = range(3)


def scene(step, noise=0.0, seed=0):
    """Points (N, 3) in mm, camera pixels, cells, and which object; `noise` is sigma of inverse depth over depth."""
    v, u = np.mgrid[0:240:step, 0:320:step]
    camera_px = np.stack([u, v], axis=-1).reshape(-1, 2).astype(float)
    rays = np.column_stack([CAMERA.unproject(camera_px), np.ones(len(camera_px))])
    depth = 1 / (rays @ np.array([-0.15, -0.1, 0.5])) * 1000
    thing = np.full(len(depth), WALL)
    plate = (np.abs(camera_px - [60, 90]) < [35, 50]).all(axis=1)
    depth[plate], thing[plate] = depth[plate] * 0.96, PLATE
    centre, radius = np.array([250.0, 0.0, 1300.0]), 260.0
    a, b = (rays**2).sum(axis=1), rays @ centre
    discriminant = b * b - a * (centre @ centre - radius**2)
    ball = discriminant > 0
    depth[ball], thing[ball] = ((b - np.sqrt(np.abs(discriminant))) / a)[ball], BALL
    depth = depth / (1 + np.random.default_rng(seed).normal(scale=noise, size=len(depth)))
    cells = np.stack([v // step, u // step], axis=-1).reshape(-1, 2)
    return rays * depth[:, None], camera_px, cells, thing


def correspondences(points, **columns):
    """What a perfect decoder returns for points of the camera frame."""
    seen = RIG.projector_from_camera.apply(points)
    return Correspondences(CAMERA.project(points), PROJECTOR.project(seen), **columns)
