"""What a device looks at, from the renderer's own ray casts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.simulation.mitsuba_scene import load_mitsuba
from retrue.simulation.mitsuba_stage import HERE, Stage
from retrue.simulation.mitsuba_views import FINEST, covering_pinhole, sensor
from retrue.simulation.scene import NOTHING
from retrue.values import ByValue

SAME_POINT = 1e-3  # of the depth: two rays that end nearer than this to each other hit one point


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceMap:
    """The scene in front of one device, ray by ray.

    Attributes
    ----------
    device, camera_from_device : who looks.
    pinhole : whose pixels the rays go through, at their centres.
    points, normals : (h, w, 3) in the camera's frame.
    item : (h, w) index of the item hit, -1 for none.
    lit : (h, w) whether the projector's light gets there.
    """

    device: Camera
    camera_from_device: RigidTransform
    pinhole: Camera
    points: FloatArray
    normals: FloatArray
    item: IntArray
    lit: BoolArray

    @classmethod
    def of(cls, stage: Stage, device: Camera, camera_from_device: RigidTransform = HERE) -> SurfaceMap:
        """Cast a ray through every pixel of the pinhole that covers the device."""
        pinhole = covering_pinhole(device, 1)
        width, height = stage.rig.projector.size
        white = np.ones((FINEST * height, FINEST * width, 3))
        channels = "point:position,normal:geo_normal,shape:shape_index"
        integrator = {"type": "aov", "aovs": channels, "light": {"type": "path", "max_depth": 2, "hide_emitters": True}}
        view = sensor(load_mitsuba(), pinhole, camera_from_device, stage.distance, samples=1, jitter=False)
        cast_rays = stage.render({"integrator": integrator, "sensor": view, "lamp": stage.projector(white)}, seed=0)
        light, points, normals, shape = np.split(cast_rays, [3, 6, 9], axis=-1)
        item = np.round(shape[..., 0]).astype(np.int64) - 1
        return cls(device, camera_from_device, pinhole, points, normals, item, light.max(axis=-1) > 0)

    def at(self, pixels: FloatArray) -> tuple[FloatArray, IntArray, BoolArray]:
        """Points (..., 3) that the device's pixels (..., 2) look at, NaN where nothing is; the item; whether it is lit.

        Each ray is cut with the tangent plane at the nearest ray that was cast: the same ray for a device without a
        lens; for others, silhouettes and shadows are right to half a pixel.
        """
        rays = self.device.unproject(pixels)
        direction = np.concatenate([rays, np.ones((*rays.shape[:-1], 1))], axis=-1) @ self.camera_from_device.R.T
        nearest = np.round(self.pinhole.pixels_from_rays(rays)).astype(np.int64)
        near = nearest[..., 1], nearest[..., 0]
        origin, normal = self.camera_from_device.t, self.normals[near].astype(np.float64)
        item = self.item[near]
        with np.errstate(divide="ignore", invalid="ignore"):
            along = np.sum(normal * (self.points[near] - origin), axis=-1) / np.sum(normal * direction, axis=-1)
        along = np.where(item == NOTHING, np.nan, along)
        return origin + along[..., None] * direction, item, self.lit[near]


@dataclass(frozen=True, slots=True, eq=False)
class Truth(ByValue):
    """At the centres of the camera's pixels, and of what was asked for in the projector's picture.

    Attributes
    ----------
    depth : (h, w) Z in the camera's frame; NaN where nothing is.
    item : (h, w) index of the item seen, -1 for none.
    lit : (h, w) whether the projector's light gets there.
    camera_px, projector_px : (N, 2) points of the projector's picture that the camera sees.
    """

    depth: FloatArray
    item: IntArray
    lit: BoolArray
    camera_px: FloatArray
    projector_px: FloatArray


def find_truth(stage: Stage, projector_px: FloatArray) -> Truth:
    """The truth of a stage, and where the camera sees those points (N, 2) of the projector's picture."""
    camera = stage.rig.camera
    seen = SurfaceMap.of(stage, camera)
    width, height = camera.size
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(np.float64)
    points, item, lit = seen.at(pixels)

    thrown, _, _ = SurfaceMap.of(stage, stage.rig.projector, stage.camera_from_projector).at(projector_px)
    camera_px = camera.project(thrown)
    with np.errstate(invalid="ignore"):
        inside = camera.contains(camera_px)
    there, _, shone = seen.at(np.where(inside[:, None], camera_px, 0.0))
    with np.errstate(invalid="ignore"):
        both = inside & shone & (np.linalg.norm(there - thrown, axis=-1) < SAME_POINT * thrown[:, 2])
    return Truth(points[..., 2], item, lit, camera_px[both], projector_px[both])
