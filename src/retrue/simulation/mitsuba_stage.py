"""A rig before a scene, lit by what its projector shows: light at the camera's pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.geometry.arrays import FloatArray
from retrue.geometry.transform import RigidTransform
from retrue.rig import Rig
from retrue.simulation.mitsuba_scene import Properties, load_mitsuba
from retrue.simulation.mitsuba_views import covering_pinhole, emitter, sensor, through_lens

SCALE = 2  # pixels of the rendered picture for one of the camera, per axis

HERE = RigidTransform.identity()


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """What is rendered, but for the light.

    Attributes
    ----------
    shapes : the scene, as `mitsuba_scene.shapes` makes it.
    distance : of the scene's middle from the camera; the projector's white has brightness 1 there.
    samples : light paths for a camera pixel; 4 times a square number.
    bounces : how often light is followed from surface to surface before it reaches the camera.
    """

    rig: Rig
    shapes: Properties
    distance: float
    samples: int = 16
    bounces: int = 2

    @property
    def camera_from_projector(self) -> RigidTransform:
        return self.rig.projector_from_camera.inverse()

    def projected(self, raster: FloatArray, seed: int) -> FloatArray:
        """Light (h, w, 3) of the projector alone while it shows a raster as of `blurred_raster`."""
        return self._light({"projector": self.projector(raster)}, seed)

    def room(self, brightness: float, seed: int) -> FloatArray:
        """Light (h, w, 3) of the room alone, from all around."""
        return self._light({"room": {"type": "constant", "radiance": {"type": "rgb", "value": brightness}}}, seed)

    def projector(self, raster: FloatArray) -> Properties:
        """Mitsuba's emitter that shows the raster."""
        pose = self.camera_from_projector
        bright_at = float(np.linalg.norm(pose.t - np.array([0.0, 0.0, self.distance])))
        return emitter(load_mitsuba(), self.rig.projector, pose, raster, bright_at)

    def _light(self, lamps: Properties, seed: int) -> FloatArray:
        pinhole = covering_pinhole(self.rig.camera, SCALE)
        view = sensor(load_mitsuba(), pinhole, HERE, self.distance, max(self.samples // SCALE**2, 1))
        integrator = {"type": "path", "max_depth": self.bounces + 1, "hide_emitters": True}
        rendered = self.render({"integrator": integrator, "sensor": view, **lamps}, seed)
        return through_lens(rendered[..., :3], pinhole, self.rig.camera, SCALE)

    def render(self, parts: Properties, seed: int) -> FloatArray:
        """Mitsuba's picture (h, w, channels) of the scene with an integrator, a sensor and lamps."""
        mitsuba = load_mitsuba()
        scene = mitsuba.load_dict({"type": "scene", **self.shapes, **parts})
        return np.array(mitsuba.render(scene, seed=seed))
