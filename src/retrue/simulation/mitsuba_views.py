"""Both devices for a renderer that knows only pinholes with square pixels.

What a device with a lens, a shift and a skew sees is rendered through a pinhole that covers it, and read where the
device's own rays pierce that picture; what a projector throws is drawn into such a picture beforehand.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np

from retrue.errors import InputError
from retrue.geometry.arrays import FloatArray
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.simulation.camera_model import gaussian_blur
from retrue.simulation.mitsuba_scene import Properties, bitmap, to_world

MARGIN_PX = 2  # pixels of the covering picture beyond the device's own
FINEST = 2  # texels of the projected picture in a pixel of the projector, per axis
WIDEST = 20.0  # half the picture over the focal length: beyond, a lens model has folded


def covering_pinhole(device: Camera, scale: int) -> Camera:
    """A pinhole that sees all that the device sees, `scale` pixels for one of it.

    Of a device that is such a pinhole itself, its pixels are the device's, each cut into `scale` squared.
    """
    focal = float(max(device.K[0, 0], device.K[1, 1]))
    middle = (scale - 1) / 2
    bounds = focal * _border_rays(device) + device.K[:2, 2]
    first = np.floor(scale * bounds.min(axis=0) + middle) - MARGIN_PX
    last = np.ceil(scale * bounds.max(axis=0) + middle) + MARGIN_PX
    width, height = (last - first + 1).astype(int).tolist()
    x, y = scale * device.K[:2, 2] + middle - first
    return Camera((width, height), np.array([[scale * focal, 0, x], [0, scale * focal, y], [0, 0, 1]]))


def sensor(
    mitsuba: Any, pinhole: Camera, camera_from_device: RigidTransform, reach: float, samples: int, jitter: bool = True
) -> Properties:
    """Mitsuba's camera for a pinhole; `reach` is a typical distance, `samples` a square number for each pixel."""
    width, height = pinhole.size
    return {
        "type": "perspective",
        "fov": float(np.degrees(2 * np.arctan(width / 2 / pinhole.K[0, 0]))),
        "fov_axis": "x",
        "principal_point_offset_x": float(0.5 - (pinhole.K[0, 2] + 0.5) / width),
        "principal_point_offset_y": float(0.5 - (pinhole.K[1, 2] + 0.5) / height),
        "near_clip": 1e-3 * reach,
        "far_clip": 1e3 * reach,
        "to_world": to_world(mitsuba, camera_from_device, (-1.0, -1.0, 1.0)),  # its x is to the left, its y up
        "film": {
            "type": "hdrfilm",
            "width": width,
            "height": height,
            "rfilter": {"type": "box"},
            "component_format": "float32",
        },
        "sampler": {"type": "stratified", "sample_count": samples, "jitter": jitter},
    }


def emitter(
    mitsuba: Any, projector: Camera, camera_from_projector: RigidTransform, shown: FloatArray, bright_at: float
) -> Properties:
    """Mitsuba's projector that shows a picture (h, w, 3); white has brightness 1 on a white wall at `bright_at`."""
    texture, half_width = _drawn_beforehand(projector, shown)
    return {
        "type": "projector",
        "irradiance": bitmap(mitsuba, texture),
        "scale": bright_at**2,
        "fov": float(np.degrees(2 * np.arctan(half_width))),
        "fov_axis": "x",
        "to_world": to_world(mitsuba, camera_from_projector, (-1.0, -1.0, 1.0)),
    }


def through_lens(rendered: FloatArray, pinhole: Camera, device: Camera, scale: int) -> FloatArray:
    """The device's picture (h, w, channels) of a pinhole's: each pixel the mean of `scale` squared places in it."""
    width, height = device.size
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(np.float64)
    at = pinhole.pixels_from_rays(device.unproject(pixels))
    right, down = np.gradient(at, axis=1), np.gradient(at, axis=0)
    steps = (np.arange(scale) + 0.5) / scale - 0.5
    seen = np.zeros((height, width, rendered.shape[2]))
    for dy in steps:
        for dx in steps:
            seen += _bilinear(rendered, at + dx * right + dy * down)
    return seen / scale**2


def blurred_raster(projected: FloatArray, blur_px: float) -> FloatArray:
    """A picture (h, w, 3) as the projector's lens throws it: square pixels, then the blur; `FINEST` times as fine."""
    fine = projected.repeat(FINEST, axis=0).repeat(FINEST, axis=1)
    return gaussian_blur(fine, FINEST * blur_px)


def _drawn_beforehand(projector: Camera, shown: FloatArray) -> tuple[FloatArray, float]:
    """`shown`, a raster `FINEST` times as fine as the projector's, as a pinhole about the axis must show it.

    Returns the texture and half of its width over the focal length.
    """
    focal = FINEST * float(max(projector.K[0, 0], projector.K[1, 1]))
    columns, rows = (int(np.ceil(side)) + MARGIN_PX for side in focal * np.abs(_border_rays(projector)).max(axis=0))
    x, y = np.arange(-columns, columns) + 0.5, np.arange(-rows, rows) + 0.5
    pixels = projector.pixels_from_rays(np.stack(np.meshgrid(x, y), axis=-1) / focal)
    inside = projector.contains(pixels)
    texture = np.zeros((2 * rows, 2 * columns, 3))
    texture[inside] = _bilinear(shown, FINEST * pixels[inside] + (FINEST - 1) / 2)
    return texture, columns / focal


def _bilinear(picture: FloatArray, at: FloatArray) -> FloatArray:
    """`picture` (h, w, channels) at places (..., 2), (x, y); beyond its border as on it."""
    from scipy import ndimage

    read = cast("Callable[..., FloatArray]", ndimage.map_coordinates)
    place = np.moveaxis(at[..., ::-1], -1, 0)
    channels = [read(picture[..., k], place, order=1, mode="nearest") for k in range(picture.shape[-1])]
    return np.stack(channels, axis=-1)


def _border_rays(device: Camera) -> FloatArray:
    """Rays (N, 2) through the edge of the device's picture."""
    width, height = device.size
    x, y = np.linspace(-0.5, width - 0.5, 64), np.linspace(-0.5, height - 0.5, 64)
    border = np.concatenate(
        [np.stack(np.broadcast_arrays(x, end), axis=-1) for end in (y[0], y[-1])]
        + [np.stack(np.broadcast_arrays(end, y), axis=-1) for end in (x[0], x[-1])]
    )
    rays = device.unproject(border)
    if not np.abs(rays).max() <= WIDEST:
        raise InputError(
            "simulate: expected a lens model that is one-to-one over the whole picture, found one that folds"
        )
    return rays
