"""A known object, seen from all sides by a camera and a projector, with noise along the rays."""

import numpy as np
import trimesh

from retrue.geometry.transform import RigidTransform
from retrue.reconstruction.cloud import Cloud

RADIUS, DISTANCE = 50.0, 400.0
BUMPS = np.random.default_rng(7)
CENTRES = BUMPS.normal(size=(40, 3))
CENTRES /= np.linalg.norm(CENTRES, axis=1, keepdims=True)
HEIGHTS = BUMPS.uniform(-0.15, 0.25, 40)
WIDTHS = BUMPS.uniform(0.15, 0.4, 40)
AXIS = np.array([0.05, 0.99, 0.1]) / np.linalg.norm([0.05, 0.99, 0.1])


def radius(directions, heights=HEIGHTS):
    """Of the object in unit directions (N, 3): a ball with bumps and dents."""
    cosine = directions @ CENTRES.T
    return RADIUS * (1 + (heights * np.exp((cosine - 1) / WIDTHS**2)).sum(axis=1))


def off_surface(points, heights=HEIGHTS):
    """Distance of points of the object's frame from its surface, to first order."""
    length = np.linalg.norm(points, axis=1)
    outward = points / length[:, None]
    step = 1e-4
    gradient = np.stack(
        [(level(points + step * e, heights) - level(points - step * e, heights)) / (2 * step) for e in np.eye(3)],
        axis=1,
    )
    del outward, length
    return level(points, heights) / np.linalg.norm(gradient, axis=1)


def level(points, heights):
    length = np.linalg.norm(points, axis=1)
    return length - radius(points / length[:, None], heights)


def shape(heights=HEIGHTS, subdivisions=6):
    ball = trimesh.creation.icosphere(subdivisions=subdivisions)
    return trimesh.Trimesh(ball.vertices * radius(ball.vertices, heights)[:, None], ball.faces, process=False)


def view_pose(angle, wobble=None):
    """camera_from_object: the object on a turntable before the camera, y down."""
    turn = RigidTransform.from_rotation_vector(angle * AXIS, [0.0, 0.0, 0.0])
    tilt = RigidTransform.from_rotation_vector([0.35, 0.0, 0.0], [3.0, -5.0, DISTANCE])
    extra = (
        RigidTransform.identity() if wobble is None else RigidTransform.from_rotation_vector(wobble, [0.0, 0.0, 0.0])
    )
    return tilt @ extra @ turn


def seen(pose, random, sigma=0.05, count=6000, heights=HEIGHTS):
    """A cloud of what camera and projector both see of the object, in the camera's frame."""
    mesh = shape(heights)
    points, face = trimesh.sample.sample_surface(mesh, 3 * count, seed=int(random.integers(2**31)))
    points = points / np.linalg.norm(points, axis=1)[:, None]
    points = points * radius(points, heights)[:, None]
    normals = mesh.face_normals[face] @ pose.R.T
    points = pose.apply(points)
    away = points - [-150.0, 0.0, 0.0]  # the projector
    lit = (normals * away).sum(axis=1) < -0.25 * np.linalg.norm(away, axis=1)
    facing = (normals * points).sum(axis=1) < -0.25 * np.linalg.norm(points, axis=1)
    points = points[lit & facing]
    rays = points / np.linalg.norm(points, axis=1)[:, None]
    points = points + sigma * random.normal(size=len(points))[:, None] * rays
    grey = np.full((len(points), 3), 128, np.uint8)
    return Cloud(points, grey, np.full((len(points), 2), np.nan), "mm")


def turntable(count=12, seed=0, sigma=0.05, jitter=0.0):
    """Clouds of a full turn, and the true camera_from_object of each."""
    random = np.random.default_rng(seed)
    poses = [view_pose(2 * np.pi * k / count, jitter * random.normal(size=3)) for k in range(count)]
    return [seen(pose, random, sigma) for pose in poses], poses
