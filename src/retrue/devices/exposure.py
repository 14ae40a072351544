"""The exposure, set once: so long that the projector's white is bright, so short that it is nowhere clipped."""

from __future__ import annotations

import numpy as np

from retrue.devices.protocols import CameraDriver, ProjectorDriver
from retrue.devices.references import grey_levels
from retrue.errors import DeviceError

BRIGHT = 215.0  # grey levels of 255 that white shall come to
CLIPPED = 250
MOST_CLIPPED = 0.001  # of the pixels; a lamp in the picture may be
CLOSE = 0.9  # to `BRIGHT`, where it is good enough
STEPS = 12
LARGEST_STEP = 4.0
SETTLE_FRAMES = 12  # until a new exposure, and a new picture, have surely arrived


def find_exposure(camera: CameraDriver, projector: ProjectorDriver) -> float | None:
    """Set the exposure by what the camera sees of white; returns it, in ms, None where the camera does not tell.

    Raises
    ------
    DeviceError
        white is clipped, and the camera does not let its exposure be set.
    """
    width, height = projector.size
    projector.show(np.full((height, width, 3), 255, np.uint8))
    for _ in range(STEPS):
        level, clipped = _white(camera)
        exposure = camera.exposure_ms
        if clipped <= MOST_CLIPPED and (exposure is None or level >= CLOSE * BRIGHT):
            return exposure
        if exposure is None:
            raise DeviceError(
                camera.name,
                f"{100 * clipped:.0f} % of the picture is clipped under white, and its exposure cannot be set from "
                "here: set it on the camera, close the aperture, or dim the projector",
            )
        step = min(BRIGHT / max(level, 1.0), LARGEST_STEP) if clipped <= MOST_CLIPPED else 0.6
        camera.set_exposure(exposure * step)
        if camera.exposure_ms == exposure:  # at its end
            return exposure
    return camera.exposure_ms


def _white(camera: CameraDriver) -> tuple[float, float]:
    """Grey level that few pixels exceed, and the share of those that are clipped."""
    for _ in range(0 if camera.triggered else SETTLE_FRAMES):
        camera.frame()
    levels = grey_levels(camera.frame().picture)
    levels = levels if levels.ndim == 2 else levels.max(axis=2)
    return float(np.percentile(levels, 99.5)), float(np.mean(levels >= CLIPPED))
