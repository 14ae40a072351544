"""Balls, bars and plates before a rig; the truth is what the rig would say without noise."""

import numpy as np

from retrue.correspondences import Correspondences
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.geometry.triangulation import triangulate
from retrue.reconstruction.reconstruct import reconstruct
from retrue.rig import Rig
from retrue.simulation.scene import Scene, look, pixel_grid
from retrue.simulation.surfaces import Sphere, Wall

CAMERA = Camera((640, 480), [[900, 0, 320], [0, 900, 240], [0, 0, 1]], [-0.08, 0.02, 0, 0, 0])
PROJECTOR = Camera((800, 600), [[1200, 0, 400], [0, 1200, 300], [0, 0, 1]])
RIG = Rig(CAMERA, PROJECTOR, RigidTransform.from_rotation_vector([0.02, 0.3, 0.0], [-180.0, 10.0, 15.0]), "mm")
BACKGROUND = 900.0


def wrong_rig(random, degrees=0.05, mm=0.3, share=5e-4):
    """The rig with errors in pose, focal lengths and distortion."""
    pose = RIG.projector_from_camera
    turned = RigidTransform.from_rotation_vector(
        np.radians(degrees) * random.normal(size=3), mm * random.normal(size=3)
    )
    devices = []
    for device in (CAMERA, PROJECTOR):
        K = device.K.copy()
        K[[0, 1], [0, 1]] *= 1 + share * random.normal(size=2)
        devices.append(Camera(device.size, K, device.distortion + 2e-3 * random.normal(size=5) * [1, 1, 0.1, 0.1, 0]))
    return Rig(*devices, turned @ pose, "mm")


def seen(surfaces, step=4):
    """Correspondences without noise of what the true rig sees of surfaces before a wall."""
    scene = Scene([*surfaces, Wall.facing(BACKGROUND, (0.05, -0.1, 0.0))])
    u, v = np.arange(0, 640, step), np.arange(0, 480, step)
    found = look(RIG, scene, pixel_grid(v, u))
    lit = found.visible
    camera_px = pixel_grid(v, u)[lit]
    cells = np.argwhere(lit)
    return Correspondences(camera_px, found.projector_px[lit], cells=cells), found.surface[lit]


def noisy(points, random, sigma=0.1):
    camera_px = points.camera_px + sigma * random.normal(size=points.camera_px.shape)
    projector_px = points.projector_px + sigma * random.normal(size=points.projector_px.shape)
    return Correspondences(camera_px, projector_px, cells=points.cells)


def measured(rig, points):
    from retrue.reconstruction.options import ReconstructOptions

    return reconstruct(rig, points, ReconstructOptions(outlier_sigmas=50.0, keep_strays=True))


def placed(rig, points):
    """(N, 3) of them, as reconstruction has them, without how sure they are."""
    rays = rig.camera.unproject(points.camera_px), rig.projector.unproject(points.projector_px)
    sigmas = [1 / np.sqrt(device.K[0, 0] * device.K[1, 1]) for device in (rig.camera, rig.projector)]
    return triangulate(rig.projector_from_camera, *rays, camera_sigma=sigmas[0], projector_sigma=sigmas[1])


def ball(x, y, z, diameter):
    return Sphere(np.array([x, y, z], dtype=float), diameter / 2)
