"""The closed-form derivatives against differences."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from retrue.calibration.jacobians import linearise, residuals
from retrue.calibration.observations import CornerObservations, Group, PlaneObservations, SceneObservations
from retrue.calibration.setup import OF_VIEW, Setup
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform


@pytest.fixture
def setup() -> Setup:
    lens = np.array([-0.2, 0.05, 1e-3, -2e-3, 0.01])
    camera = Camera((1280, 1024), np.array([[1500.0, 2, 640], [0, 1490, 500], [0, 0, 1]]), lens)
    projector = Camera((1024, 768), np.array([[1300.0, 0, 500], [0, 1310, 800], [0, 0, 1]]), -lens / 2)
    boards = [RigidTransform.from_rotation_vector([0.3, -0.4, 0.1 * i], [-100, -80, 1000 + 50 * i]) for i in range(2)]
    pose = RigidTransform.from_rotation_vector([-0.2, 0.1, 0.05], [50, -300, 20])
    bend, shifts = np.array([4e-8, -3e-8, 5e-8]), np.array([[0.02, -0.01], [0.03, 0.02]])
    return Setup((camera, projector), pose, tuple(boards), bend, shifts)


def groups() -> list[Group]:
    rng = np.random.default_rng(0)
    view = np.array([0, 0, 0, 1, 1, 1])
    points = np.pad(rng.uniform(0, 200, (6, 2)), ((0, 0), (0, 1)))
    camera_px, projector_px = rng.uniform(400, 800, (6, 2)), rng.uniform(300, 700, (6, 2))
    return [
        CornerObservations(0, view, points, camera_px, np.ones(6)),
        CornerObservations(1, view, points, projector_px, np.ones(6)),
        PlaneObservations(view, camera_px, projector_px, np.ones(6)),
    ]


@pytest.mark.parametrize("index", range(3))
def test_derivatives(setup: Setup, index: int) -> None:
    group = groups()[index]
    error, jacobian = linearise(setup, group)
    np.testing.assert_allclose(residuals(setup, group), error, atol=1e-9)
    scale = np.array([1, 1, 1, 1, 1e-3, 1e-3, 1e-4, 1e-4, 1e-3] * 2 + [1e-4] * 3 + [0.1] * 3 + [1e-6] * 3) * 1e-2
    for column, step in enumerate(scale):
        change = np.zeros(setup.columns.shared)
        change[column] = step
        check(setup, group, change, np.zeros((2, OF_VIEW)), jacobian[:, :, column], step)
    for column, step in enumerate([1e-6] * 3 + [1e-3] * 5):
        boards = np.zeros((2, OF_VIEW))
        boards[:, column] = step
        check(setup, group, np.zeros(setup.columns.shared), boards, jacobian[:, :, setup.columns.shared + column], step)


def check(setup: Setup, group: Group, change: Any, boards: Any, expected: Any, step: float) -> None:
    ahead, behind = setup.moved(change, boards), setup.moved(-change, -boards)
    assert ahead is not None
    assert behind is not None
    if isinstance(group, CornerObservations):
        found = (residuals(ahead, group) - residuals(behind, group)) / (2 * step)
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5 * (1 + np.abs(expected).max()))
        return
    # Along and across the epipolar line: the line itself turns a little with the step, which the derivative leaves
    # out on purpose; the length of the whole change does not depend on it where the residual is small.
    small = PlaneObservations(group.view, group.camera_px, on_target(setup, group), group.sigma)
    _, jacobian = linearise(setup, small)
    column = (
        int(np.flatnonzero(change)[0]) if change.any() else setup.columns.shared + int(np.flatnonzero(boards[0])[0])
    )
    found = (residuals(ahead, small) - residuals(behind, small)) / (2 * step)
    np.testing.assert_allclose(found, jacobian[:, :, column], rtol=1e-4, atol=1e-4 * (1 + np.abs(found).max()))


def on_target(setup: Setup, group: Any) -> Any:
    """Projector pixels with no residual at all."""
    from retrue.calibration.jacobians import _board_poses, _on_board

    R, t = _board_poses(setup, group.view)
    points = _on_board(setup, setup.devices[0].unproject(group.camera_px), R, t)[0]
    return setup.devices[1].project(setup.second_from_first.apply(points)) + setup.shifts[group.view]


def test_a_scene_tells_nothing_along_its_epipolar_lines(setup: Setup) -> None:
    plane = groups()[2]
    assert isinstance(plane, PlaneObservations)
    scene = SceneObservations(plane.view, plane.camera_px, on_target(setup, plane), plane.sigma)
    error, jacobian = linearise(setup, scene)
    np.testing.assert_allclose(error, 0, atol=1e-8)
    assert not jacobian[:, 0].any()
    assert not jacobian[:, :, setup.columns.board].any()  # the board does not matter
    for column, step in ((0, 1e-2), (11, 1e-2), (4, 1e-5), (13, 1e-5), (18, 1e-6), (22, 1e-3)):
        change = np.zeros(setup.columns.shared)
        change[column] = step
        ahead, behind = setup.moved(change, np.zeros((2, OF_VIEW))), setup.moved(-change, np.zeros((2, OF_VIEW)))
        assert ahead is not None
        assert behind is not None
        found = (residuals(ahead, scene) - residuals(behind, scene)) / (2 * step)
        np.testing.assert_allclose(found[:, 1], jacobian[:, 1, column], rtol=1e-3, atol=1e-4)
