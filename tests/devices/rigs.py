"""Small simulated rigs, and whether what was recorded is what was shown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retrue.devices.options import SimulatedOptions
from retrue.devices.protocols import CameraFrame
from retrue.devices.simulated_rig import SimulatedFrame, SimulatedRig
from retrue.patterns.gray_code import GrayCode

SIZE = (128, 96)
GRAY = GrayCode(SIZE).render()


def small_rig(**options: Any) -> SimulatedRig:
    """160 x 120 pixels, and a projector of 128 x 96."""
    width, height = SIZE
    settings: dict[str, Any] = {"scene": "wall", "projector_width": width, "projector_height": height}
    return SimulatedRig(SimulatedOptions(width=160, height=120, **settings | options))


def rows_of(picture: NDArray[np.uint8]) -> NDArray[np.int64]:
    """A number for each row, the same where its bytes are: thousands of frames are compared."""
    return np.array([hash(row.tobytes()) for row in picture])


class Witness:
    """The camera of a simulated rig, which remembers the truth of every frame and counts them."""

    triggered = False
    name = "simulated camera"

    def __init__(self, rig: SimulatedRig) -> None:
        self.rig, self.frames = rig, 0
        self._seen: list[tuple[NDArray[np.int64], SimulatedFrame]] = []

    @property
    def exposure_ms(self) -> float | None:
        return self.rig.camera.exposure_ms

    def open(self) -> None: ...
    def close(self) -> None: ...

    def set_exposure(self, exposure_ms: float) -> None:
        self.rig.camera.set_exposure(exposure_ms)

    def frame(self) -> CameraFrame:
        frame = self.rig.frame()
        self.frames += 1
        self._seen.append((rows_of(frame.picture), frame))
        return frame

    def faults(self, shown: Sequence[Any], recorded: Sequence[CameraFrame]) -> list[str]:
        """What is wrong with each picture that is not right: rows that are of another one, mixed, or of no frame."""
        faults: list[str] = []
        for number, (picture, frame) in enumerate(zip(shown, recorded, strict=True)):
            wide = picture if picture.ndim == 3 else np.repeat(picture[..., None], 3, axis=2)
            pure = np.full(len(frame.picture), -1.0)
            recorded_rows = rows_of(frame.picture)
            for rows, true in self._seen:  # two dark rows may be alike though they are of two frames
                mine = rows == recorded_rows
                if mine.any():
                    pure = np.where(mine, np.maximum(pure, true.share_of(wide)), pure)
            if pure.min() < 0:
                faults.append(f"{number}: {(pure < 0).sum()} rows are of no frame")
            elif pure.min() < 1 - 1e-6:
                faults.append(f"{number}: {1 - pure.min():.4f} of a row is of another picture")
        return faults
