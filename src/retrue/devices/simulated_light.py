"""From what a simulated projector showed, and when, to the numbers of one frame of the simulated camera."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from retrue.devices.options import SimulatedOptions
from retrue.geometry.arrays import FloatArray
from retrue.rig import Rig
from retrue.simulation.board_scene import HeldBoard, board_scene, held_board
from retrue.simulation.built_in_scenes import built_in_scene, meeting_distance
from retrue.simulation.light_transport import Light, blurred, find_transport
from retrue.simulation.scene import Scene

CAMERA_BLUR_PX = 0.6
WHITE_VALUE = 0.7  # of 1, at full exposure
KEPT = 64  # pictures whose light is remembered
STEPS = 4096  # of the table from light to picture values
NOISE_START = 65_536  # different places in the field of noise where that of a frame may begin


class SimulatedLight:
    """The light of one pose of the rig in one scene; remembers that of the pictures it was asked for last.

    Attributes
    ----------
    board : in the scene "board", what is held there, or the number of one of many.
    """

    def __init__(self, rig: Rig, options: SimulatedOptions, board: HeldBoard | int = 0) -> None:
        distance, ambient = meeting_distance(rig), options.ambient
        if options.scene == "board":
            held = held_board(rig, distance, board) if isinstance(board, int) else board
            scene = board_scene(held, distance, ambient)
        else:
            scene = Scene(built_in_scene(options.scene, rig, distance), (ambient, ambient, ambient))
        self.board = board
        self._transport = find_transport(rig, scene)
        self._lights: OrderedDict[int, Light] = OrderedDict()

    def of(self, picture: NDArray[np.uint8]) -> Light:
        """At the camera's sensor, while the projector shows that picture."""
        key = hash(picture.tobytes())
        if key not in self._lights:
            self._lights[key] = blurred(self._transport.light(picture), CAMERA_BLUR_PX)
            if len(self._lights) > KEPT:
                self._lights.popitem(last=False)
        self._lights.move_to_end(key)
        return self._lights[key]


class Exposed:
    """A picture on the screen since some time, in some world."""

    def __init__(self, since: float, picture: NDArray[np.uint8], world: SimulatedLight) -> None:
        self.since, self.picture, self._world = since, picture, world
        self._light: Light | None = None

    @property
    def light(self) -> Light:
        """Found when a frame first holds it."""
        if self._light is None:
            self._light = self._world.of(self.picture)
        return self._light

    def forget(self) -> None:
        """No later frame holds it."""
        self._light = None


def share_of_rows(since: Sequence[float], rows: FloatArray, exposure: float) -> FloatArray:
    """(shown, rows) share of each row's exposure, which starts at `rows`, in which each picture was on the screen."""
    start = np.array(since)[:, None]
    end = np.append(start[1:], [[np.inf]], axis=0)
    return np.clip(np.minimum(end, rows + exposure) - np.maximum(start, rows), 0.0, None) / exposure


class Sensor:
    """Turns light into numbers; its noise is drawn once, and begins elsewhere in each frame."""

    def __init__(self, options: SimulatedOptions) -> None:
        self._options = options
        self._random = np.random.default_rng(options.seed)
        count = options.width * options.height * 3 + NOISE_START
        self._noise = self._random.standard_normal(count, dtype=np.float32)
        values = np.linspace(0, 1, STEPS) ** (1 / options.gamma) * 255
        self._table = np.floor(values + 0.5).astype(np.uint8)

    def frame(
        self, shown: Sequence[Exposed], shares: FloatArray, gain: float
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8], float]:
        """(h, w, 3), the picture that it holds most of, and the largest share of a row's light that is of any other."""
        within: list[int] = np.flatnonzero(shares.max(axis=1) > 0).tolist()
        for past in shown[: within[0]]:
            past.forget()
        if len(within) == 1:
            seen: Light = shown[within[0]].light * np.float32(WHITE_VALUE * gain)
        else:
            weights = (WHITE_VALUE * gain * shares).astype(np.float32)[:, :, None, None]
            seen = np.asarray(np.sum([weights[index] * shown[index].light for index in within], axis=0))
        if np.isfinite(self._options.electrons):
            electrons, read_noise = np.float32(self._options.electrons), np.float32(self._options.read_noise)
            first = int(self._random.integers(NOISE_START))
            spread = np.clip(seen, 0, 1) / electrons  # in place from here on: frames are made by the thousand
            np.sqrt(np.add(spread, (read_noise / electrons) ** 2, out=spread), out=spread)
            spread *= self._noise[first : first + seen.size].reshape(seen.shape)
            seen += spread
        np.clip(seen, 0, 1, out=seen)
        seen *= STEPS - 1
        seen += np.float32(0.5)
        picture = np.take(self._table, seen.astype(np.uint16))
        main = shown[max(within, key=lambda index: float(shares[index].sum()))].picture
        own = [shares[index] for index in within if np.array_equal(shown[index].picture, main)]
        return picture, main, float(np.max(1 - np.sum(own, axis=0)))
