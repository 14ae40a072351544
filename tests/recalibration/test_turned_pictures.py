"""A picture that was turned since the calibration is named: the points say that a device rolled over."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from retrue.correspondences import Card, Correspondences
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform, rotation_angle
from retrue.rasters import PictureMirrored
from retrue.recalibration import reasons
from retrue.recalibration.recalibrate import recalibrate
from retrue.recalibration.result import Accepted, Refused
from retrue.recalibration.turned_pictures import axes_exchanged, readings
from retrue.recalibration.verify import verify
from retrue.rig import Rig
from tests.recalibration.scenes import BALLS, CAMERA, POSE, RIG, SIDE_WALL, SPHERE, WALL, Scene, bumped, capture

OLD = bumped(RIG, [2, 5, -1], [0, 4, 0])
CORNER = Scene(planes=[WALL, SIDE_WALL])
SCENES = {"wall": Scene(), "corner": CORNER, "wall and ball": Scene(spheres=[SPHERE]), "balls": BALLS}


def turned(points: Correspondences, device: str, rig: Rig = RIG, quarters: int = 2) -> Correspondences:
    """Each quarter as `numpy.rot90` turns an array, looked up pixel by pixel."""
    width, height = getattr(rig, device).size
    name = f"{device}_px"
    x, y = getattr(points, name).T
    for _ in range(quarters):
        x, y, width, height = y, width - 1 - x, height, width
    return replace(points, **{name: np.stack([x, y], axis=-1)})


@pytest.mark.parametrize("device", ["camera", "projector"])
@pytest.mark.parametrize("scene", SCENES)
def test_a_picture_turned_by_half_is_named(scene: str, device: str) -> None:
    points = turned(capture(SCENES[scene]), device)
    for answer in (recalibrate(OLD, [points]), verify(RIG, [points])):
        assert not isinstance(answer, Accepted)
        assert isinstance(answer.cause, reasons.PictureTurned), answer.reason
        assert (answer.cause.device, answer.cause.quarters) == (device, 2)
        assert answer.cause.meant_deg < 15
        assert not isinstance(answer, Refused) or answer.evidence.lens == "unchecked"


def test_what_no_pose_explains_as_it_is_is_named_too() -> None:
    """A projector with its lens shifted far: turned over, its picture is none of it."""
    K = RIG.projector.K.copy()
    K[1, 2] = 1100
    rig = replace(RIG, projector=Camera(RIG.projector.size, K))
    points = turned(capture(Scene(planes=[WALL, SIDE_WALL], spheres=[SPHERE]), rig=rig, noise=0.02), "projector")
    answer = recalibrate(rig, [points])
    assert isinstance(answer, Refused)
    assert isinstance(answer.cause, reasons.PictureTurned), answer.reason
    assert answer.cause.device == "projector"


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_a_square_picture_may_be_turned_by_a_quarter(quarters: int) -> None:
    camera = Camera((1000, 1000), np.array([[1600, 0, 492], [0, 1600, 503], [0, 0, 1.0]]))
    rig = replace(RIG, camera=camera)
    points = turned(capture(CORNER, rig=rig), "camera", rig, quarters)
    (reading,) = [one for one in readings(rig, [points]) if one.device == "camera"]
    assert np.allclose(reading.captures[0].camera_px, capture(CORNER, rig=rig).camera_px)
    answer = recalibrate(rig, [points])
    assert isinstance(answer.cause, reasons.PictureTurned), answer.reason
    assert ("half" in answer.reason) == (quarters == 2)
    assert ("a quarter" in answer.reason) == (quarters != 2)


@pytest.mark.parametrize("scene", ["corner", "wall and ball", "balls"])
def test_a_camera_that_rolled_over_is_believed_where_its_lens_tells(scene: str) -> None:
    """Of a part of its sensor: turned, its picture would have the principal point on the other side."""
    rig = replace(
        RIG, camera=Camera(CAMERA.size, np.add(CAMERA.K, [[0, 0, 60], [0, 0, 40], [0, 0, 0]]), CAMERA.distortion)
    )
    over = RigidTransform(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))
    answer = recalibrate(replace(rig, projector_from_camera=POSE @ over), [capture(SCENES[scene], rig=rig)])
    assert isinstance(answer, Accepted), answer.reason
    assert np.degrees(rotation_angle(answer.rig.projector_from_camera.R @ POSE.R.T)) < 0.2


def mirrored(points: Correspondences, device: str, way: str) -> Correspondences:
    name, (width, height) = f"{device}_px", getattr(RIG, device).size
    x, y = getattr(points, name).T
    return replace(points, **{name: np.stack([width - 1 - x, y] if way == "left to right" else [x, height - 1 - y], 1)})


@pytest.mark.parametrize("way", ["left to right", "top to bottom"])
@pytest.mark.parametrize("device", ["camera", "projector"])
@pytest.mark.parametrize("scene", SCENES)
def test_whose_picture_is_mirrored_and_which_way(scene: str, device: str, way: str) -> None:
    points = mirrored(capture(SCENES[scene]), device, way)
    held = verify(RIG, [points])
    for answer in (recalibrate(OLD, [points]), held):
        assert isinstance(answer.cause, PictureMirrored), answer.reason
        assert answer.cause.device in (device, None)  # of a camera centred on its picture, points may not tell
        assert answer.cause.device is None or way in answer.reason
    assert isinstance(held.cause, PictureMirrored)
    assert held.cause.device == device


def exchanged(points: Correspondences, *devices: str) -> Correspondences:
    return replace(points, **{f"{device}_px": getattr(points, f"{device}_px")[:, ::-1] for device in devices})


@pytest.mark.parametrize("scene", SCENES)
def test_x_and_y_exchanged_in_both_devices_are_named(scene: str) -> None:
    inner = (0.1, 0.7, 0.1, 0.7)  # exchanged, they lie in the rasters, too
    points = exchanged(capture(SCENES[scene], area=inner), "camera", "projector")
    for answer in (recalibrate(OLD, [points]), verify(RIG, [points])):
        assert isinstance(answer.cause, reasons.AxesExchanged), answer.reason
        assert answer.cause.meant_deg < 15
        assert not isinstance(answer, Refused) or answer.evidence.lens == "unchecked"


def test_points_beyond_the_raster_may_be_exchanged() -> None:
    """Old pose and baseline on the diagonal, so that the exchange hardly moves the rig."""
    pose = RigidTransform.from_rotation_vector([0.11, -0.11, 0.0], [0.25, 0.25, 0.05])
    rig = replace(RIG, projector_from_camera=pose)
    points = exchanged(capture(SCENES["wall"], rig=rig), "camera", "projector")
    assert (points.camera_px[:, 1] > 960).mean() > 0.05
    answer = recalibrate(rig, [points])
    assert isinstance(answer.cause, reasons.AxesExchanged), answer.reason


@pytest.mark.parametrize("device", ["camera", "projector"])
@pytest.mark.parametrize("scene", SCENES)
def test_x_and_y_exchanged_in_one_device_are_named(scene: str, device: str) -> None:
    answer = recalibrate(OLD, [exchanged(capture(SCENES[scene]), device)])
    assert isinstance(answer.cause, PictureMirrored), answer.reason
    assert answer.cause.device in (device, None)
    assert "x and y of one are exchanged" in answer.reason or f"the {device}'s x and y are" in answer.reason


def test_what_a_decoder_read_has_no_axes_exchanged() -> None:
    points = exchanged(capture(CORNER, area=(0.1, 0.7, 0.1, 0.7)), "camera", "projector")
    assert [one.device for one in axes_exchanged(RIG, [points])] == ["both"]
    assert axes_exchanged(RIG, [replace(points, card=Card("pixels", 9, 9, {}, 0.5))]) == []


@pytest.mark.parametrize("degrees", [0, 30, 60])
def test_a_rig_that_moved_is_not_asked(degrees: float) -> None:
    old = bumped(RIG, [0, 0, degrees], [0, 0, 0])
    assert readings(old, [capture(CORNER)]) == []
