"""What a camera and a projector can do, whoever made them. Times are seconds of one clock, which both share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from retrue.geometry.arrays import Image

Size = tuple[int, int]
"""(width, height)."""


@dataclass(frozen=True, slots=True, eq=False)
class CameraFrame:
    """One picture of a camera.

    Attributes
    ----------
    picture : (h, w) or (h, w, 3), red green blue, uint8 or uint16.
    at : when it was taken, or where the camera does not say, when it came.
    """

    picture: Image
    at: float


class CameraDriver(Protocol):
    """A camera. Raises `DeviceError` where it does not do what was asked; then `close` and `open` may help."""

    @property
    def name(self) -> str:
        """For people: "camera 0"."""
        ...

    @property
    def triggered(self) -> bool:
        """Whether a frame is exposed after it is asked for, rather than when it is its turn."""
        ...

    @property
    def exposure_ms(self) -> float | None:
        """As it is set; None where the camera does not tell."""
        ...

    def open(self) -> None:
        """Begin, with exposure, gain and white balance as the setup says: fixed, none of them automatic."""
        ...

    def frame(self) -> CameraFrame:
        """The next one; waits for it."""
        ...

    def set_exposure(self, exposure_ms: float) -> None:
        """From one of the next frames on."""
        ...

    def close(self) -> None:
        """Let go of it; more than once does no harm."""
        ...


class ProjectorDriver(Protocol):
    """A projector. Raises `DeviceError` as a camera does."""

    @property
    def name(self) -> str:
        """For people: "screen 1"."""
        ...

    @property
    def size(self) -> Size:
        """(width, height) of the pictures that it takes; known when it is open."""
        ...

    def open(self) -> None:
        """Black, from now on."""
        ...

    def show(self, picture: NDArray[np.uint8], at: float = 0.0) -> float:
        """Show (h, w, 3) not before time `at`; returns when it was handed to the screen."""
        ...

    def close(self) -> None:
        """Let go of it; more than once does no harm."""
        ...
