"""Both photographs as two cameras would take them that look the same way, square to the line between them.

Then what both see lies on one row, and a point at depth Z is shifted along it by its disparity d = f b / Z.

Source: Fusiello, Trucco, Verri, "A compact algorithm for rectification of stereo pairs", 2000.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import cv2
import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.arrays import FloatArray, Image
from retrue.geometry.camera import Camera
from retrue.rig import Rig

LARGEST_SIDE = 4096  # px of a rectified picture
LEAST_SIGHT = 0.2  # cosine: cameras that look along the line between them share no rows


@dataclass(frozen=True, slots=True, eq=False)
class Rectification:
    """How a pair is rectified.

    Attributes
    ----------
    view : the camera without distortion that both become.
    first_turn, second_turn : (3, 3) rotation from the first and the second camera's frame to that of both.
    baseline : of the rig's unit, signed: positive where the second camera stands on the side of larger x.
    """

    view: Camera
    first_turn: FloatArray
    second_turn: FloatArray
    baseline: float

    def rectified_px(self, camera: Camera, turn: FloatArray, pixels: FloatArray) -> FloatArray:
        """(..., 2) pixels of the rectified picture where it shows those of the photograph; NaN where it cannot."""
        rays = camera.unproject(pixels)
        turned = np.concatenate([rays, np.ones((*rays.shape[:-1], 1))], axis=-1) @ turn.T
        return self.view.project(turned)

    def photograph_px(self, camera: Camera, turn: FloatArray, pixels: FloatArray) -> FloatArray:
        """The way back."""
        rays = self.view.unproject(pixels)
        turned = np.concatenate([rays, np.ones((*rays.shape[:-1], 1))], axis=-1) @ turn
        return camera.project(turned)

    def picture(self, photograph: Image, camera: Camera, turn: FloatArray) -> Image:
        """(h, w) or (h, w, 3) rectified; black beyond the photograph."""
        width, height = self.view.size
        grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(np.float64)
        there = np.nan_to_num(self.photograph_px(camera, turn, grid), nan=-9.0).astype(np.float32)
        return cv2.remap(photograph, there, cast(Any, None), cv2.INTER_CUBIC)


def rectify(rig: Rig) -> Rectification:
    """How photographs of this rig are rectified, with the pose that it has.

    Raises
    ------
    DegenerateError : the cameras coincide, or one looks along the line between them.
    """
    pose = rig.projector_from_camera
    centre = pose.inverse().t
    length = float(np.linalg.norm(centre))
    if not length > 0:
        raise DegenerateError("rig: expected two cameras apart, found t = 0: no depth")
    row = centre / length
    middle = pose.R.T[:, 2] + [0.0, 0.0, 1.0]  # halfway between both lines of sight
    sight = middle - (middle @ row) * row
    if not np.linalg.norm(sight) > LEAST_SIGHT * np.linalg.norm(middle):
        raise DegenerateError("rig: a camera looks along the line to the other one: no rows that both share")
    sight /= np.linalg.norm(sight)
    sign = 1.0 if row[0] > -abs(row[1]) else -1.0  # upright, rather than on its head
    row = sign * row
    turn = np.stack([row, np.cross(sight, row), sight])
    return Rectification(_view(rig, turn), turn, turn @ pose.R.T, sign * length)


def _view(rig: Rig, turn: FloatArray) -> Camera:
    """A camera of the finer of both focal lengths that holds what the first camera sees, within bounds."""
    f = max(float(np.sqrt(camera.K[0, 0] * camera.K[1, 1])) for camera in (rig.camera, rig.projector))
    width, height = rig.camera.size
    edge = np.linspace(0, 1, 21)
    border = np.concatenate(
        [np.stack([edge * (width - 1), np.full(21, y)], axis=-1) for y in (0, height - 1)]
        + [np.stack([np.full(21, x), edge * (height - 1)], axis=-1) for x in (0, width - 1)]
    )
    rays = rig.camera.unproject(border)
    rays = rays[np.isfinite(rays).all(axis=1)]
    turned = np.column_stack([rays, np.ones(len(rays))]) @ turn.T
    seen = np.clip(turned[:, :2] / np.maximum(turned[:, 2:], 0.2), -2.5, 2.5)
    low, high = seen.min(axis=0), seen.max(axis=0)
    f = min(f, (LARGEST_SIDE - 1) / float((high - low).max()))
    size = np.ceil((high - low) * f).astype(int) + 1
    K = np.array([[f, 0, -low[0] * f], [0, f, -low[1] * f], [0, 0, 1]])
    return Camera((int(size[0]), int(size[1])), K)
