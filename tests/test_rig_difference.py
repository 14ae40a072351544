"""How far two rigs are apart, against displacements known in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from retrue.errors import InputError
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.rig import Rig
from retrue.rig_difference import rig_difference

CAMERA = Camera((640, 480), [[800, 0, 319.5], [0, 800, 239.5], [0, 0, 1]])
RIG = Rig(CAMERA, CAMERA, RigidTransform(np.eye(3), [-100.0, 0, 0]))


def turned(angles_deg, rig=RIG):
    turn = RigidTransform.from_rotation_vector(np.radians(angles_deg), np.zeros(3))
    return replace(rig, projector_from_camera=turn @ rig.projector_from_camera)


def test_a_rig_is_no_distance_from_itself():
    difference = rig_difference(RIG, RIG, 1000.0)
    assert difference.rotation_deg == difference.translation_deg == difference.translation == difference.length == 0
    assert difference.displacement < 1e-9


def test_a_small_turn_about_y_moves_depth_by_z_squared_over_the_baseline():
    """Disparity b / Z changes by the angle at the centre, so that Z changes by Z^2 / b times it."""
    angle = 1e-3
    difference = rig_difference(RIG, turned([0, angle, 0]), 1000.0)
    assert difference.rotation_deg == pytest.approx(angle, rel=1e-6)
    expected = np.radians(angle) * 1000.0**2 / 100.0
    assert difference.displacement == pytest.approx(expected, rel=0.25)
    doubled = rig_difference(RIG, turned([0, angle, 0]), 2000.0)
    assert doubled.displacement == pytest.approx(4 * difference.displacement, rel=0.02)


def test_lengths_and_directions():
    longer = replace(RIG, projector_from_camera=RigidTransform(np.eye(3), [-100.0, 100.0, 0]))
    difference = rig_difference(RIG, longer)
    assert difference.translation_deg == pytest.approx(45)
    assert difference.translation == pytest.approx(100)
    assert difference.length == pytest.approx(100 * (np.sqrt(2) - 1))
    assert difference.working_distance is None
    assert difference.displacement is None


def test_a_changed_focal_length_moves_points_too():
    zoomed = Camera((640, 480), [[808, 0, 319.5], [0, 808, 239.5], [0, 0, 1]])
    assert rig_difference(RIG, replace(RIG, camera=zoomed), 1000.0).displacement > 1


def test_what_a_lens_model_folds_into_its_picture_is_not_lit():
    """A camera that sees far beyond the projector's picture, where its lens model turns back."""
    wide = Camera((640, 480), [[230, 0, 319.5], [0, 230, 239.5], [0, 0, 1]])
    bent = Camera((640, 480), CAMERA.K, [-0.3, 0, 0, 0, 0])
    straight = replace(RIG, camera=wide)
    expected = rig_difference(straight, turned([0, 1e-3, 0], straight), 1000.0).displacement
    folded = replace(straight, projector=bent)
    assert bent.contains(bent.project([1.8, 0.0, 1.0]))
    assert rig_difference(folded, turned([0, 1e-3, 0], folded), 1000.0).displacement == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize(
    ("other", "distance", "message"),
    [
        (replace(RIG, unit="m"), None, "unit"),
        (replace(RIG, projector=Camera((1024, 768), CAMERA.K)), None, "projector: expected one size"),
        (RIG, 0.0, "positive length"),
        (RIG, float("nan"), "positive length"),
    ],
)
def test_rigs_that_cannot_be_compared(other, distance, message):
    with pytest.raises(InputError, match=message):
        rig_difference(RIG, other, distance)


def test_a_patch_of_light_between_a_few_rays_is_measured_where_it_is():
    """A projector of narrow view lights a thousandth of the picture, between the rays of a coarse grid."""
    narrow = Camera((64, 48), [[9000, 0, 31.5], [0, 9000, 23.5], [0, 0, 1]])
    aside = RigidTransform.from_rotation_vector([0.0, -0.13, 0.0], [0.0, 0, 0]) @ RIG.projector_from_camera
    spot = replace(RIG, projector=narrow, projector_from_camera=aside)
    found = rig_difference(spot, turned([0, 1e-3, 0], spot), 1000.0).displacement
    assert found == pytest.approx(np.radians(1e-3) * 1000.0**2 / 100.0, rel=0.1)


def test_rays_that_no_longer_meet_are_infinitely_far_off():
    found = rig_difference(RIG, replace(RIG, projector_from_camera=RigidTransform(np.eye(3), [0.0, 0, 0])), 1000.0)
    assert found.displacement == np.inf
