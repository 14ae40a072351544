"""Where the projector's light goes, found once for a pose of the rig: then a picture costs one sparse product."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import csr_matrix

from retrue.geometry.arrays import FloatArray
from retrue.rig import Rig
from retrue.simulation.scene import BAND, Scene, Seen, look, pixel_grid

Light = NDArray[np.float32]
"""(h, w, 3): 1 is a white wall in the projector's white."""
SHARE_OF_A_PIXEL = 0.4  # standard deviation of the light that a camera pixel gathers, in widths of that pixel
EDGE = 0.02  # difference of light between neighbours from which on a pixel is more than its middle
RAYS = (np.stack([np.arange(16), 7 * np.arange(16) % 16], axis=-1) + 0.5) / 16 - 0.5
"""Within such a pixel: no two in one row or column, so that edges along either still move by a sixteenth."""
PIXELS_AT_A_TIME = 4096
WIDEST_STEP = 0.5  # variance that three neighbours can blur by at a time; of more, the middle would be the least


@dataclass(frozen=True, slots=True, eq=False)
class LightTransport:
    """l = g * (W b(p)) + r: the light l at the camera's pixels under a projector that shows p.

    Attributes
    ----------
    size : (width, height) of the camera.
    weights : W, sparse, (camera pixels, projector pixels): between which projector pixels each camera pixel looks.
    gain : g, (camera pixels, 3) what the surface returns of it; shadows are dark.
    room : r, (camera pixels, 3).
    blur_px : of b, in projector pixels: the projector's lens, and the width of a camera pixel.
    """

    size: tuple[int, int]
    weights: Any
    gain: Light
    room: Light
    blur_px: float

    def light(self, shown: NDArray[np.uint8]) -> Light:
        """At each camera pixel, of a picture (h, w, 3) on the projector."""
        lamp = shown.astype(np.float32) / np.float32(255)
        if (lamp != lamp[:1, :1]).any():
            lamp = blurred(lamp, self.blur_px)
        width, height = self.size
        return (self.gain * (self.weights @ lamp.reshape(-1, 3)) + self.room).reshape(height, width, 3)


def blurred(light: Light, sigma: float) -> Light:
    """(h, w, 3) blurred by that standard deviation in pixels: each shares with its neighbours, again and again."""
    steps = int(np.ceil(sigma**2 / WIDEST_STEP))
    for axis in (0, 1) * steps:
        share = np.float32(0.5 * sigma**2 / steps)
        flow = np.diff(light, axis=axis) * share
        light = light.copy()
        first, last = (slice(None, -1), slice(1, None)) if axis == 0 else ((slice(None), slice(None, -1)), np.s_[:, 1:])
        light[first] += flow
        light[last] -= flow
    return light


def find_transport(rig: Rig, scene: Scene, projector_blur_px: float = 0.4) -> LightTransport:
    """Follow the ray of each camera pixel to the projector.

    Lambert shading, gloss and shadows as `render` has them; no light from surface to surface. What returns at edges,
    of print, of things and of shadows, is the mean over the pixel. It knows nothing of how pictures are decoded.
    """
    (width, height), (projector_width, projector_height) = rig.camera.size, rig.projector.size
    bands = [np.arange(top, min(top + BAND, height)) for top in range(0, height, BAND)]
    seen = [look(rig, scene, pixel_grid(rows, np.arange(width))) for rows in bands]
    gain, room, at = _gathered(rig, scene, seen)
    at = np.clip(at.reshape(-1, 2), 0, np.array([projector_width, projector_height]) - 1.0)
    corner = np.minimum(at.astype(np.int32), np.array([projector_width, projector_height], dtype=np.int32) - 2)
    (fx, fy), (x, y) = (at - corner).T, corner.T
    columns = np.stack(
        [y * projector_width + x + step for step in (0, 1, projector_width, projector_width + 1)], axis=1
    )
    values = np.stack([(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy], axis=1)
    count = width * height
    starts = np.arange(0, 4 * count + 1, 4, dtype=np.int32)
    shape = (count, projector_width * projector_height)
    return LightTransport(
        size=rig.camera.size,
        weights=csr_matrix((values.astype(np.float32).ravel(), columns.astype(np.int32).ravel(), starts), shape=shape),
        gain=gain.reshape(-1, 3).astype(np.float32),
        room=room.reshape(-1, 3).astype(np.float32),
        blur_px=float(np.hypot(projector_blur_px, SHARE_OF_A_PIXEL * _projector_pixels_per_camera_pixel(rig, at))),
    )


def _gathered(rig: Rig, scene: Scene, seen: list[Seen]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Gain and room (h, w, 3), and the projector pixel (h, w, 2), 0 in shadow: a pixel's middle, at edges its mean.

    An edge that jumps from pixel to pixel would put a board's corners beside themselves, alike in all noise.
    """
    gain, room = (np.concatenate([getattr(part, name) for part in seen]) for name in ("gain", "room"))
    at = np.concatenate([part.projector_px for part in seen])
    dark = ~np.concatenate([part.visible for part in seen])
    at[dark] = 0.0
    library: Any = ndimage
    most, least = (of(gain + room, (3, 3, 1)) for of in (library.maximum_filter, library.minimum_filter))
    y, x = np.nonzero((most - least).max(axis=-1) > EDGE)
    for some in np.array_split(np.arange(len(x)), len(x) // PIXELS_AT_A_TIME + 1):
        pixel = y[some], x[some]
        fine = look(rig, scene, np.stack(pixel[::-1], axis=-1)[:, None] + RAYS)
        gain[pixel], room[pixel] = fine.gain.mean(axis=1), fine.room.mean(axis=1)
        partly, ray = np.nonzero(fine.visible & dark[pixel][:, None])  # light from where any of its rays is lit
        at[y[some[partly]], x[some[partly]]] = fine.projector_px[partly, ray]
    return gain, room, at


def _projector_pixels_per_camera_pixel(rig: Rig, at: FloatArray) -> float:
    """The usual step in the projector from one camera pixel to the next."""
    width, height = rig.camera.size
    across = np.linalg.norm(np.diff(at.reshape(height, width, 2), axis=1), axis=-1)
    return float(np.median(across[across > 0])) if (across > 0).any() else 0.0
