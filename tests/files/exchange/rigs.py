"""A rig with lenses, and a cloud of a tilted wall that both of its devices see."""

import numpy as np

from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.reconstruction.cloud import Cloud
from retrue.rig import Rig

CAMERA = Camera((64, 48), [[70, 0, 30.25], [0, 71, 24.5], [0, 0, 1]], [-0.1, 0.02, 0.003, -0.002, 0.001])
PROJECTOR = Camera((80, 60), [[110, 0, 40], [0, 111, 42], [0, 0, 1]], [-0.05, 0, 0, 0, 0])
RIG = Rig(CAMERA, PROJECTOR, RigidTransform.from_rotation_vector([0.02, 0.2, 0.05], [-300.0, 10.0, 20.0]), unit="mm")
NORMAL = np.array([0.1, -0.2, 1.0]) / 1200.0  # n . X = 1


def wall(step=4):
    """Points at camera pixels `step` apart, with cells, normals and colours that are all different."""
    v, u = np.mgrid[4:44:step, 6:58:step]
    pixels = np.stack([u, v], axis=-1).reshape(-1, 2).astype(float)
    rays = np.column_stack([CAMERA.unproject(pixels), np.ones(len(pixels))])
    points = rays / (rays @ NORMAL)[:, None]
    number = np.arange(len(points))
    colors = np.stack([number % 251, number % 241, number % 239], axis=1).astype(np.uint8)
    cells = np.stack([v // step, u // step], axis=-1).reshape(-1, 2)
    normals = np.tile(-NORMAL / np.linalg.norm(NORMAL), (len(points), 1))
    return Cloud(points, colors, pixels, "mm", cells, normals=normals)
