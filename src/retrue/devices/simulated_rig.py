"""A rig that never was: what its projector shows is what its camera sees, late, blurred and noisy as cameras are."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retrue.devices.options import SimulatedOptions
from retrue.devices.protocols import CameraFrame, Size
from retrue.devices.simulated_light import Exposed, Sensor, SimulatedLight, share_of_rows
from retrue.errors import DeviceError
from retrue.geometry.arrays import FloatArray
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.rig import Rig
from retrue.simulation.board_scene import HeldBoard

BUFFERED = 4  # frames that wait for whoever takes them, in real time; older ones are gone
REMEMBERED = 512  # of what was shown: more than any lag reaches back

SPOT, PROJECTOR_CENTRE = np.array([0.0, 0.0, 700.0]), np.array([210.0, -40.0, -30.0])
"""In the camera's frame, in mm."""


def default_rig(options: SimulatedOptions) -> Rig:
    """A projector to the right of a camera, both with the same spot in the middle of their pictures; in mm."""
    (width, height), (wide, high) = (options.width, options.height), (options.projector_width, options.projector_height)
    camera_K = np.array([[1.25 * width, 0, (width - 1) / 2 + 3], [0, 1.25 * width, (height - 1) / 2 - 2], [0, 0, 1]])
    projector_K = np.array([[1.3 * wide, 0, 0.5 * wide], [0, 1.3 * wide, 0.78 * high], [0, 0, 1]])
    camera = Camera((width, height), camera_K, np.array([-0.08, 0.03, 4e-4, -3e-4, 0]))
    projector = Camera((wide, high), projector_K)
    # The shortest turn that takes the way to the spot to the ray through the middle of the projector's picture.
    way, middle = SPOT - PROJECTOR_CENTRE, np.append(projector.unproject((np.array([wide, high]) - 1) / 2), 1.0)
    axis = np.cross(way, middle) / (np.linalg.norm(way) * np.linalg.norm(middle))
    turn = RigidTransform.from_rotation_vector(
        axis / np.linalg.norm(axis) * np.arcsin(np.linalg.norm(axis)), np.zeros(3)
    )
    return Rig(camera, projector, RigidTransform(turn.R, -turn.R @ PROJECTOR_CENTRE), "mm")


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedFrame(CameraFrame):
    """A frame that knows its own truth.

    Attributes
    ----------
    shown : the picture that it shows, or shows most of.
    foreign : largest share of a row's light that is that of another picture.
    parts : (picture, (rows,) its share of each row's light) of all that are in it.
    """

    shown: NDArray[np.uint8]
    foreign: float
    parts: Sequence[tuple[NDArray[np.uint8], FloatArray]] = ()

    def share_of(self, picture: NDArray[np.uint8]) -> FloatArray:
        """(rows,) how much of each row's light is that picture's."""
        return np.sum([share for other, share in self.parts if np.array_equal(other, picture)], axis=0)


class SimulatedRig:
    """Both devices, the room they stand in, and their time. May be used from several threads.

    Attributes
    ----------
    true_rig : where its devices are; a bump moves them. Their setup starts from `rig`, or from `default_rig`.
    """

    def __init__(self, options: SimulatedOptions | None = None, rig: Rig | None = None) -> None:
        self.options = options or SimulatedOptions()
        if rig is not None:
            (width, height), (wide, high) = rig.camera.size, rig.projector.size
            self.options = replace(
                self.options, width=width, height=height, projector_width=wide, projector_height=high
            )
        self.true_rig = rig or default_rig(self.options)
        self.camera = SimulatedCamera(self)
        self.projector = SimulatedProjector(self)
        self._random = np.random.default_rng(self.options.seed)
        self._lock = threading.RLock()
        self._now = self._began = time.monotonic() if self.options.real_time else 0.0
        self._world, self._sensor = SimulatedLight(self.true_rig, self.options), Sensor(self.options)
        black = np.zeros((self.options.projector_height, self.options.projector_width, 3), np.uint8)
        self._shown: deque[Exposed] = deque([Exposed(-np.inf, black, self._world)], REMEMBERED)
        self._number = 0
        self._last_arrival = 0.0

    def bump(self, turn_deg: Sequence[float], shift: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
        """Turn the projector about its own centre, and shift it, in the rig's unit, from now on."""
        bumped = RigidTransform.from_rotation_vector(np.radians(turn_deg), shift)
        self._change(replace(self.true_rig, projector_from_camera=bumped @ self.true_rig.projector_from_camera))

    def move_to(self, projector_from_camera: RigidTransform) -> None:
        """Put the projector there, from now on."""
        self._change(replace(self.true_rig, projector_from_camera=projector_from_camera))

    def set_scene(self, scene: str, board_pose: int = 0) -> None:
        """Another scene; the board may be held in many poses, each with its number."""
        self.options = replace(self.options, scene=scene)
        self._change(self.true_rig, board_pose)

    def hold(self, board: HeldBoard) -> None:
        """A board before the rig, from now on."""
        self.options = replace(self.options, scene="board")
        self._change(self.true_rig, board)

    def now(self) -> float:
        """Seconds, on the clock of both devices."""
        return time.monotonic() if self.options.real_time else self._now

    def show(self, picture: NDArray[np.uint8], at: float) -> float:
        """On the screen from its next refresh at or after that time."""
        expected = (self.options.projector_height, self.options.projector_width, 3)
        if picture.shape != expected or picture.dtype != np.uint8:
            raise DeviceError(
                "simulated projector", f"expected a picture of {expected[1]} x {expected[0]}, found {picture.shape}"
            )
        with self._lock:  # entered before it is on: a frame holds it though this thread sleeps too long
            on = max(self.now(), at)
            if self.options.refresh_hz > 0:
                on = float(np.ceil(on * self.options.refresh_hz - 1e-6) / self.options.refresh_hz)
            self._shown.append(Exposed(on, picture, self._world))
        self._wait_until(on)
        return on

    def frame(self) -> SimulatedFrame:
        """The next that arrives."""
        while True:
            with self._lock:
                period = 1 / self.options.fps
                number, self._number = self._number, self._number + 1
                start = self._began + number * period
                exposure = min(self.options.exposure_ms / 1000, period)
                end = start + self.options.readout * period + exposure
                late = self.options.lag_frames + int(self._random.integers(0, self.options.lag_jitter_frames + 1))
                arrival = self._last_arrival = max(self._last_arrival, end + late * period)
                lost = bool(self._random.random() < self.options.drop)
            overtaken = self.options.real_time and arrival + BUFFERED * period < self.now()
            if not lost and not overtaken:
                break
        self._wait_until(arrival)
        with self._lock:
            rows = start + np.linspace(0, self.options.readout * period, self.options.height)
            shares = share_of_rows([shown.since for shown in self._shown], rows, exposure)
            picture, shown, foreign = self._sensor.frame(
                list(self._shown), shares, exposure * 1000 / self.options.bright_ms
            )
            held = zip(self._shown, shares, strict=True)
            parts = [(exposed.picture, share) for exposed, share in held if share.max() > 0]
        return SimulatedFrame(picture, arrival, shown, foreign, parts)

    def _change(self, rig: Rig, board: HeldBoard | int | None = None) -> None:
        world = SimulatedLight(rig, self.options, self._world.board if board is None else board)
        with self._lock:
            self.true_rig, self._world = rig, world
            now, coming = self.now(), list[Exposed]()
            while self._shown[-1].since > now:
                coming.append(self._shown.pop())
            self._shown.append(Exposed(now, self._shown[-1].picture, world))
            self._shown.extend(Exposed(shown.since, shown.picture, world) for shown in reversed(coming))

    def _wait_until(self, moment: float) -> None:
        if self.options.real_time:
            time.sleep(max(0.0, moment - self.now()))
        self._now = max(self._now, moment)


@dataclass(slots=True)
class SimulatedCamera:
    """The camera of a simulated rig."""

    rig: SimulatedRig
    name: str = "simulated camera"
    triggered: bool = False

    @property
    def exposure_ms(self) -> float | None:
        return self.rig.options.exposure_ms

    def open(self) -> None:
        pass

    def frame(self) -> CameraFrame:
        return self.rig.frame()

    def set_exposure(self, exposure_ms: float) -> None:
        self.rig.options = replace(self.rig.options, exposure_ms=exposure_ms)

    def close(self) -> None:
        pass


@dataclass(slots=True)
class SimulatedProjector:
    """The projector of a simulated rig."""

    rig: SimulatedRig
    name: str = "simulated projector"
    settings: Mapping[str, Any] = field(default_factory=dict[str, Any])

    @property
    def size(self) -> Size:
        return self.rig.options.projector_width, self.rig.options.projector_height

    def open(self) -> None:
        pass

    def show(self, picture: NDArray[np.uint8], at: float = 0.0) -> float:
        return self.rig.show(picture, at)

    def close(self) -> None:
        pass
