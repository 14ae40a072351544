"""The length of t: a single picture cannot give it, a known distance in the scene can."""

from __future__ import annotations

import numpy as np

from retrue.errors import InputError
from retrue.geometry.arrays import FloatArray
from retrue.geometry.camera import Camera
from retrue.geometry.two_view import TwoViewPoints, TwoViewPose
from retrue.recalibration.options import KnownDistance

NEIGHBOURS = 24


def translation_length(known: KnownDistance, camera: Camera, pose: TwoViewPose, points: TwoViewPoints) -> float:
    """|t| for which the scene points at two camera pixels lie `known.length` apart.

    Each pixel's ray is met with the surface through the nearest correspondences, a plane fitted to their depths.
    Raises InputError where a pixel has no correspondences around it.
    """
    first, second = (_scene_point(pixel, camera, pose, points) for pixel in (known.first_px, known.second_px))
    apart = float(np.linalg.norm(first - second))
    if not apart > 1e-9:
        raise InputError("known distance: expected two different pixels, found the same scene point twice")
    return known.length / apart


def inverse_depths(pose: TwoViewPose, points: TwoViewPoints) -> FloatArray:
    """(N,) 1 / Z in the camera frame with |t| = 1: least squares along the epipolar line, eqs (5), (6)."""
    x, y = points.camera_rays, points.projector_rays
    v = x @ pose.R[:, :2].T + pose.R[:, 2]
    t = pose.t
    # y ~ v + rho t: two equations that are linear in rho.
    a0, a1 = t[0] - y[:, 0] * t[2], t[1] - y[:, 1] * t[2]
    b0, b1 = y[:, 0] * v[:, 2] - v[:, 0], y[:, 1] * v[:, 2] - v[:, 1]
    return (a0 * b0 + a1 * b1) / np.maximum(a0 * a0 + a1 * a1, 1e-300)


def _scene_point(pixel: FloatArray, camera: Camera, pose: TwoViewPose, points: TwoViewPoints) -> FloatArray:
    ray = camera.unproject(pixel)
    squared = ((points.camera_rays - ray) ** 2).sum(axis=1)
    near = np.argsort(squared)[: min(NEIGHBOURS, len(squared))]
    offsets = points.camera_rays[near] - ray
    surrounded = all((offsets @ side > 0).any() for side in ((1, 0), (-1, 0), (0, 1), (0, -1)))
    if len(near) < 4 or not surrounded:
        raise InputError(
            f"known distance: expected correspondences all around pixel {pixel[0]:g},{pixel[1]:g}, found none;"
            " take a pixel on a lit surface"
        )
    # On a plane 1 / Z is linear in the ray; a reweighted fit keeps a depth edge from bending it.
    design = np.concatenate([offsets, np.ones((len(near), 1))], axis=1)
    rho = inverse_depths(pose, points)[near]
    weights = np.ones(len(near))
    solution = np.zeros(3)
    for _ in range(10):
        root = np.sqrt(weights)[:, None]
        solution = np.linalg.lstsq(design * root, rho * root[:, 0], rcond=None)[0]
        error = np.abs(rho - design @ solution)
        weights = 1 / np.maximum(error, max(float(np.median(error)), 1e-12))
    if not solution[2] > 0:
        raise InputError(
            f"known distance: the surface at pixel {pixel[0]:g},{pixel[1]:g} is not in front of the camera"
        )
    return np.array([*ray, 1.0]) / solution[2]
