"""Was a picture turned since the rig was calibrated, by half, or a square one by a quarter? Or mirrored?

A camera's driver, a viewer that obeys a file's orientation, a projector's setting for ceilings all do it, and points
then say that a device rolled over. Read as they were meant, they say that it hardly moved. And are x and y exchanged,
as in a table of rows and columns? Of one device, that is mirrored and turned by a quarter; of both, nothing runs the
other way round.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from retrue.correspondences import Correspondences
from retrue.geometry.arrays import FloatArray
from retrue.geometry.nearest import nearest_of_all
from retrue.rasters import MOST_OUTSIDE
from retrue.rig import Rig

ASKED_POINTS = 1000
Device = Literal["camera", "projector"]


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """Captures as they would be if one device's picture had not been turned, or the axes of both not exchanged.

    Attributes
    ----------
    device : whose picture is turned back; "both": x and y are exchanged back, in both.
    quarters : by how many quarters its pixels were turned, clockwise.
    mirrored : whether they were mirrored, left to right, after that.
    captures : with those pixels turned back.
    """

    device: Device | Literal["both"]
    quarters: int
    mirrored: bool
    captures: list[Correspondences]


def readings(rig: Rig, captures: Sequence[Correspondences], *, mirrored: bool = False) -> list[Reading]:
    """How captures could be meant that run another way round than they would through the rig: for either device.

    Turned by half, a picture keeps its size; by a quarter, only a square one does. Mirrored and turned by a quarter, x
    and y are exchanged, which a table can do with any picture.

    Parameters
    ----------
    mirrored : the points run the other way round, as one picture is mirrored.
    """
    R = rig.projector_from_camera.R
    meant = np.degrees(np.arctan2(R[1, 0] - R[0, 1], R[0, 0] + R[1, 1]))
    signs: Mapping[Device, int] = {"camera": -1, "projector": 1}
    found: list[Reading] = []
    for device, sign in signs.items():
        width, height = size = rig.camera.size if device == "camera" else rig.projector.size
        seen = [_flipped(capture, device, width) for capture in captures] if mirrored else list(captures)
        off = (_roll_deg(seen) - meant + 180) % 360 - 180
        quarters = sign * round(off / 90) % 4
        back = [_turned(capture, device, -quarters % 4, size) for capture in seen]
        exchanged = mirrored and quarters == 1 and _may_be_exchanged(rig, captures, back)
        if not (width == height or exchanged):
            quarters = 2 * round(off / 180) % 4
            back = [_turned(capture, device, quarters, size) for capture in seen]
        if quarters or mirrored:
            found.append(Reading(device, quarters, mirrored, back))
    return found


def axes_exchanged(rig: Rig, captures: Sequence[Correspondences]) -> list[Reading]:
    """With x and y of both devices exchanged back, where that is within their rasters."""
    back = [_transposed(capture) for capture in captures]
    return [Reading("both", 0, False, back)] if _may_be_exchanged(rig, captures, back) else []


def _may_be_exchanged(rig: Rig, captures: Sequence[Correspondences], back: Sequence[Correspondences]) -> bool:
    """They come from a table, as no decoder takes rows for columns, and lie in the rasters, exchanged back."""
    tables = all(capture.card is None for capture in captures)
    return tables and inside(rig, back) >= 1 - MOST_OUTSIDE


def inside(rig: Rig, captures: Sequence[Correspondences]) -> float:
    """Share of the points that lie in the rasters of both devices; 0 of none."""
    both = [rig.camera.contains(one.camera_px) & rig.projector.contains(one.projector_px) for one in captures]
    return float(np.count_nonzero(np.concatenate(both))) / max(sum(map(len, both)), 1)


def _transposed(capture: Correspondences) -> Correspondences:
    ratio = capture.projector_sigma_ratio
    return replace(
        capture,
        camera_px=capture.camera_px[:, ::-1],
        projector_px=capture.projector_px[:, ::-1],
        projector_sigma_ratio=None if ratio is None else 1 / ratio,
    )


def _flipped(capture: Correspondences, device: Device, width: int) -> Correspondences:
    """The same with one device's picture of that width mirrored, left to right."""
    pixels = (capture.camera_px if device == "camera" else capture.projector_px) * [-1, 1] + [width - 1, 0]
    return replace(capture, camera_px=pixels) if device == "camera" else replace(capture, projector_px=pixels)


def _roll_deg(captures: Sequence[Correspondences]) -> float:
    """By how much the way from a point to its neighbour turns, clockwise, from the camera to the projector."""
    turns: list[FloatArray] = []
    for capture in captures:
        few = np.linspace(0, len(capture) - 1, min(len(capture), ASKED_POINTS)).astype(np.int64)
        if len(few) > 1:
            camera_px, projector_px = capture.camera_px[few], capture.projector_px[few]
            neighbour = nearest_of_all(camera_px, camera_px, 2)[1][:, 1]
            ways = [(pixels[neighbour] - pixels) @ [1, 1j] for pixels in (camera_px, projector_px)]
            turns.append(np.angle(ways[1] * ways[0].conj()))
    turned = np.exp(1j * np.concatenate(turns)) if turns else np.ones(1)
    return float(np.degrees(np.angle(turned.mean())))


def _turned(capture: Correspondences, device: Device, quarters: int, size: tuple[int, int]) -> Correspondences:
    """The same with one device's picture of that size turned by so many quarters, clockwise."""
    pixels = capture.camera_px if device == "camera" else capture.projector_px
    width, height = size
    for _ in range(quarters):
        x, y = pixels.T
        pixels, width, height = np.stack([height - 1 - y, x], axis=-1), height, width
    if device == "camera":
        return replace(capture, camera_px=pixels)
    ratio = capture.projector_sigma_ratio
    return replace(
        capture,
        projector_px=pixels,
        projector_sigma_ratio=ratio if ratio is None or quarters % 2 == 0 else 1 / ratio,
    )
