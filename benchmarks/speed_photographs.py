"""From two photographs to a judged pose, beside the time that OpenCV's SIFT takes on both alone."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from importlib import import_module
from time import process_time

import numpy as np
from speed_rows import Row, compare, peer

from retrue import PHOTOGRAPHS, Camera, Rig, RigidTransform, decode, recalibrate
from retrue.geometry.arrays import Image
from retrue.simulation.camera_model import CameraModel
from retrue.simulation.photographs import photograph, textured_scene

SIZE, SMALL = (1280, 960), (320, 240)
CAMERA = CameraModel(exposure=0.9, blur_px=0.6, electrons=10_000)


def photograph_rows(rounds: int, size: tuple[int, int] = SIZE, scenes: int = 3) -> Iterator[Row]:
    """By processor time, as SIFT runs on all cores: matched; and judged, the rig turned by a degree before."""
    for seed in range(scenes):
        rig = rig_of(size)
        taken = photograph(rig, textured_scene(rig, 1200.0, seed=seed), CAMERA, supersample=1, seed=seed)
        turn = RigidTransform.from_rotation_vector([0.01, -0.01, 0.01], [0.0, 0, 0])
        moved = Rig(rig.camera, rig.projector, turn @ rig.projector_from_camera, unit="mm")
        pair = [taken.left, taken.right]
        what = f"photographs of scene {seed}, {size[0]} x {size[1]}, {len(decode(PHOTOGRAPHS, pair))} matches"
        name = peer("OpenCV", "SIFT on both")
        sift = {name: partial(features, pair)}
        matching = partial(decode, PHOTOGRAPHS, pair)
        yield from compare(f"{what}: `decode`, processor time", matching, sift, rounds, clock=process_time)
        judged = partial(pose, moved, pair)
        yield from compare(
            f"{what}: to a pose, processor time", judged, sift, rounds, goals={name: 1.5}, clock=process_time
        )


def rig_of(size: tuple[int, int]) -> Rig:
    """Two cameras of different lenses, 150 mm apart."""
    left, right = (
        Camera(size, np.array([[f * size[0], 0, x], [0, f * size[0], y], [0, 0, 1]]), np.array([bend, 0.02, 0, 0, 0]))
        for f, (x, y), bend in (
            (0.94, np.multiply(size, (0.5, 0.5)), -0.1),
            (0.97, np.multiply(size, (0.49, 0.506)), -0.08),
        )
    )
    return Rig(left, right, RigidTransform.from_rotation_vector([0.01, -0.05, 0.02], [-150.0, 3, 5]), unit="mm")


def features(pair: list[Image]) -> None:
    """As a user of OpenCV would begin: grey, at its defaults."""
    cv2 = import_module("cv2")  # whose stubs lack its features
    finder = cv2.SIFT_create()
    for image in pair:
        finder.detectAndCompute(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), None)


def pose(rig: Rig, pair: list[Image]) -> object:
    return recalibrate(rig, [decode(PHOTOGRAPHS, pair)])
