"""Simulated frames of a rig that jumps, drifts, goes dark and now and then breaks; as correspondences, for speed."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal

import numpy as np

from retrue.correspondences import Correspondences
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.recalibration.options import RecalibrateOptions, VerifyOptions
from retrue.recalibration.recalibrate import recalibrate
from retrue.recalibration.verify import verify
from retrue.rig import Rig
from retrue.watch.frame import Frame
from retrue.watch.stages import Stages

CAMERA = Camera((1280, 960), [[1600, 0, 640], [0, 1602, 480], [0, 0, 1]], [-0.1, 0.05, 4e-4, -3e-4, 0])
PROJECTOR = Camera((1024, 768), [[1400, 0, 510], [0, 1398, 700], [0, 0, 1]])
RIG = Rig(CAMERA, PROJECTOR, RigidTransform.from_rotation_vector([0.05, -0.2, 0.02], [0.35, -0.04, 0.06]), "m")
NOISE_PX = 0.1
POINTS = 400

Kind = Literal["seen", "dark", "broken"]


def turned(rig: Rig, angles_deg: Sequence[float]) -> Rig:
    """The projector turned about its own centre: R and t both change."""
    turn = RigidTransform.from_rotation_vector(np.radians(angles_deg), np.zeros(3))
    return replace(rig, projector_from_camera=turn @ rig.projector_from_camera)


def scene_points(rng: np.random.Generator, count: int) -> np.ndarray:
    """A wall, somewhat slanted, with a box before it; the camera's pixels are anywhere."""
    pixels = rng.uniform([40, 40], [1240, 920], (count, 2))
    rays = np.column_stack([CAMERA.unproject(pixels), np.ones(count)])
    depth = 1.6 / (rays @ np.array([0.25, 0.1, 1.0]))
    box = (np.abs(pixels - [600, 480]) < 170).all(axis=1)
    depth[box] *= 0.85
    return rays * depth[:, None]


def seen_by(rig: Rig, seed: int, count: int = POINTS) -> Correspondences:
    """What a decoder would return of the scene."""
    rng = np.random.default_rng(seed)
    points = scene_points(rng, count)
    camera_px = rig.camera.project(points) + rng.normal(0, NOISE_PX, (count, 2))
    return Correspondences(camera_px, rig.projector.project(rig.projector_from_camera.apply(points)))


def frame(name: str, content: Correspondences | None, number: int = 0) -> Frame:
    """A frame as a source would hand it over."""
    problem = "" if content is not None else "not a picture that can be read: damaged or cut short"
    return Frame(name, content, {"next": number + 1}, {"name": name, "sha256": name}, problem)


def decoded(frame: Frame) -> Correspondences:
    """Frames hold correspondences already."""
    assert isinstance(frame.content, Correspondences)
    return frame.content


# A wall and a box cannot check the lenses: somebody's word must.
TRUSTING = VerifyOptions(estimate=RecalibrateOptions(lens="fixed"))
STAGES = Stages(decoded, partial(verify, options=TRUSTING), partial(recalibrate, options=TRUSTING.estimate))


@dataclass(slots=True)
class SimulatedSource:
    """A stream of `count` frames.

    Attributes
    ----------
    jumps : number of the frame from which on the rig is turned by so many degrees more.
    drift : first and last frame of a slow drift, and its degrees in all.
    dark, broken : every how many frames one is dark, and one broken.
    """

    count: int
    jumps: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    drift: tuple[int, int, tuple[float, float, float]] = (0, 0, (0, 0, 0))
    dark: int = 0
    broken: int = 0
    first: int = 0
    live: bool = False

    def rig_at(self, number: int) -> Rig:
        """The true rig at that frame."""
        angles = np.zeros(3)
        for start, jump in self.jumps.items():
            angles += np.array(jump) * (number >= start)
        start, end, total = self.drift
        if end > start:
            angles += np.array(total) * np.clip((number - start) / (end - start), 0, 1)
        return turned(RIG, angles.tolist())

    def kind(self, number: int) -> Kind:
        """Whether that frame can be read at all, and holds light."""
        if self.broken and number % self.broken == self.broken - 1:
            return "broken"
        return "dark" if self.dark and number % self.dark == self.dark - 1 else "seen"

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        """As a source does."""
        for number in range(self.first, self.count):
            if stop.is_set():
                return
            kind = self.kind(number)
            points = None if kind == "broken" else seen_by(self.rig_at(number), number, 5 if kind == "dark" else POINTS)
            yield frame(f"frame {number}", points, number)


QUICK = {"poll_seconds": 0.01, "settle_seconds": 0.02, "patience_seconds": 0.05, "idle_seconds": 0.1}
"""Limits of a watch over files that are whole as soon as they are there."""


def quick_words() -> list[str]:
    """As options of the command line."""
    return [word for name, value in QUICK.items() for word in (f"--{name.replace('_', '-')}", str(value))]


def quick_table(**others: float) -> str:
    """As a fleet's file has them."""
    return "".join(["[limits]\n", *(f"{name} = {value}\n" for name, value in (QUICK | others).items())])
