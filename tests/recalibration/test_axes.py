"""The axes of a pose: what moved is told on its own axis, and sigma follows the covariance."""

from __future__ import annotations

import numpy as np
import pytest

from retrue import RigidTransform
from retrue.geometry.two_view import tangent_basis
from retrue.recalibration.axes import NAMES, axes_of, pose_frame
from retrue.recalibration.result import Evidence, PoseCandidate

OLD = RigidTransform.from_rotation_vector([0.1, -0.2, 0.05], [-0.3, 0.02, 0.04])


def found(new: RigidTransform, covariance: np.ndarray) -> Evidence:
    return Evidence(100, (PoseCandidate(new, (), 0.1, None, True),), details={"covariance": covariance.tolist()})


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_turn_about_one_axis_shows_there_alone(axis: int) -> None:
    about = pose_frame(OLD.t)[axis]
    turn = RigidTransform.from_rotation_vector(np.radians(0.3) * about, np.zeros(3))
    new = RigidTransform(turn.R @ OLD.R, OLD.t)
    moved = axes_of(OLD, found(new, np.eye(5)))
    assert [one.name for one in moved] == list(NAMES)
    expected = np.zeros(5)
    expected[axis] = 0.3
    assert np.allclose([one.moved_deg for one in moved], expected, atol=1e-9)


def test_t_turns_across_the_line_of_sight_and_towards_the_scene() -> None:
    baseline, sight, normal = pose_frame(OLD.t)
    for place, towards in ((3, normal), (4, sight)):
        new = RigidTransform(OLD.R, np.linalg.norm(OLD.t) * (baseline + 0.01 * towards))
        moved = [one.moved_deg for one in axes_of(OLD, found(new, np.eye(5)))]
        assert moved[place] == pytest.approx(np.degrees(0.01), rel=1e-3)
        assert np.allclose(np.delete(moved, place), 0, atol=1e-2)


def test_sigma_is_that_of_the_axis() -> None:
    _, sight, normal = pose_frame(OLD.t)
    unit = OLD.t / np.linalg.norm(OLD.t)
    along = np.zeros((5, 5))
    along[:3, :3] = 4e-6 * np.outer(sight, sight)
    direction = tangent_basis(unit).T @ normal
    along[3:, 3:] = 9e-6 * np.outer(direction, direction)
    sigma = [one.sigma_deg for one in axes_of(OLD, found(OLD, along))]
    assert np.allclose(sigma, np.degrees([0, 2e-3, 0, 3e-3, 0]), atol=1e-9)


def test_a_baseline_along_the_sight_still_has_axes() -> None:
    frame = np.stack(pose_frame(np.array([0.0, 0.01, 2.0])))
    assert np.allclose(frame @ frame.T, np.eye(3), atol=1e-12)
