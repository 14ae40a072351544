"""What a simulated rig, and the recording of shown pictures, can be told."""

from __future__ import annotations

from dataclasses import dataclass

from retrue.errors import InputError
from retrue.ranges import check_ranges, ranged


@dataclass(frozen=True, slots=True)
class RecordOptions:
    """When a frame of the camera is taken for the one that shows a picture.

    Attributes
    ----------
    hold_frames
        Frames of the camera that each picture stays for; 0: the fewest, from 2 on, in which two in a row agree.
    max_lag_frames
        Frames after which a picture must have arrived.
    min_contrast
        Grey levels of 255 by which the projector's white must stand out from its black.
    agree_levels
        Grey levels by which two frames of one picture may differ in the mean over some rows, beyond their noise.
    attempts
        How often a picture that nothing shows is shown again.
    """

    hold_frames: int = ranged(0, 0, 100)
    max_lag_frames: int = ranged(30, 1, 1000)
    min_contrast: float = ranged(8.0, 0, 255)
    agree_levels: float = ranged(0.25, 0, 255)
    attempts: int = ranged(8, 1, 1000)

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, slots=True)
class SimulatedOptions:
    """A camera and a projector that never were.

    Attributes
    ----------
    scene
        wall, corner, step, sphere, clutter, texture, glossy; or board, one to calibrate with.
    width, height
        Of the camera's pictures, in pixels.
    projector_width, projector_height
        In pixels.
    fps
        Frames a second of the camera.
    refresh_hz
        Pictures a second of the projector; 0: each is on at once.
    exposure_ms
        Of each row. More than the time of a frame is cut to it.
    bright_ms
        Exposure in which a white wall in the projector's white comes to 0.7 of the largest picture value.
    readout
        Share of the time of a frame that lies between its first row and its last; 0: all rows at once.
    lag_frames
        Frames between the end of an exposure and the arrival of its frame, 0 to 5 in a camera of this world.
    lag_jitter_frames
        By which the lag changes from frame to frame, at most; they keep their order.
    drop
        Share of the frames that never arrive.
    gamma
        Picture = light ^ (1 / gamma).
    electrons
        Of a full pixel; its shot noise is their square root.
    read_noise
        In electrons.
    ambient
        The room's light, as a share of the projector's white.
    seed
        Of all that is random.
    real_time
        Whether time passes by itself, as for people. Otherwise each frame takes as long as it takes to make.
    """

    scene: str = "clutter"
    width: int = ranged(640, 16, 8192)
    height: int = ranged(480, 16, 8192)
    projector_width: int = ranged(1024, 16, 8192)
    projector_height: int = ranged(768, 16, 8192)
    fps: float = ranged(30.0, 0.01, 10_000)
    refresh_hz: float = ranged(60.0, 0, 10_000)
    exposure_ms: float = ranged(8.0, 1e-6, 1e6)
    bright_ms: float = ranged(8.0, 1e-6, 1e6)
    readout: float = ranged(0.3, 0, 1)
    lag_frames: int = ranged(2, 0, 100)
    lag_jitter_frames: int = ranged(0, 0, 100)
    drop: float = ranged(0.0, 0, 0.9)
    gamma: float = ranged(1.0, 0.1, 10)
    electrons: float = ranged(20_000.0, 1)
    read_noise: float = ranged(5.0, 0, 1e9)
    ambient: float = ranged(0.03, 0, 100)
    seed: int = ranged(0, 0, 2**32 - 1)
    real_time: bool = False

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.scene not in SIMULATED_SCENES:
            raise InputError(f"scene: expected {', '.join(SIMULATED_SCENES)}; found {self.scene!r}")


SIMULATED_SCENES = ("wall", "corner", "step", "sphere", "clutter", "texture", "glossy", "board")
