"""Two cameras that see one projected code."""

from __future__ import annotations

import numpy as np
import pytest

from retrue.calibration.board import parse_board
from retrue.calibration.observations import observation_groups
from retrue.calibration.views import StereoCapture, see_views
from retrue.correspondences import Correspondences
from retrue.errors import CaptureError, InputError
from retrue.geometry.arrays import FloatArray
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.through_code import match_through_code
from tests.calibration.test_board import drawn

PROJECTOR = Camera((400, 300), np.array([[420.0, 0, 200], [0, 420, 150], [0, 0, 1]]))
LEFT = Camera((640, 480), np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]]))
RIGHT = Camera((640, 480), np.array([[620.0, 0, 330], [0, 620, 230], [0, 0, 1]]), np.array([-0.1, 0.02, 0, 0, 0]))
POSES = {
    "left": RigidTransform.from_rotation_vector([0, 0.1, 0], [-120.0, 0, 0]),
    "right": RigidTransform.from_rotation_vector([0, -0.1, 0.02], [130.0, 5, 0]),
}
"""Of the projector, as the cameras see it: camera from projector."""


def surface(x: FloatArray) -> FloatArray:
    """Depth along the projector's rays: a curved wall, and a box before its middle."""
    wall = 900 + 100 * x[:, 0] + 150 * x[:, 1] ** 2
    return np.where((np.abs(x) < 0.08).all(axis=1), 700.0, wall)


def seen_by(side: str, camera: Camera, noise: float) -> Correspondences:
    """What a camera decodes, in points that are no pixels of it: of any code, to sub-pixel."""
    rng = np.random.default_rng(len(side))
    projector_px = rng.uniform([40, 30], [360, 270], (30_000, 2))
    rays = PROJECTOR.unproject(projector_px)
    points = np.column_stack([rays, np.ones(len(rays))]) * surface(rays)[:, None]
    camera_px = camera.project(POSES[side].apply(points))
    measured = projector_px + rng.normal(0, noise, projector_px.shape)
    return Correspondences(camera_px, measured, camera_size=camera.size, projector_size=PROJECTOR.size)


def test_matches_are_where_both_see_the_same() -> None:
    left, right = seen_by("left", LEFT, 0.05), seen_by("right", RIGHT, 0.05)
    match = match_through_code(left, right)
    assert (match.camera_size, match.projector_size) == (LEFT.size, RIGHT.size)
    assert len(match) > 0.8 * len(left)
    place = {tuple(pixel): index for index, pixel in enumerate(left.camera_px.tolist())}
    rows = [place[tuple(pixel)] for pixel in match.camera_px.tolist()]
    rays = PROJECTOR.unproject(left.projector_px[rows])
    points = np.column_stack([rays, np.ones(len(rays))]) * surface(rays)[:, None]
    error = np.linalg.norm(match.projector_px - RIGHT.project(POSES["right"].apply(points)), axis=1)
    assert np.median(error) < 0.1
    assert np.quantile(error, 0.99) < 1.0
    assert error.max() < 20  # on the box's edge one point of noise may fall on either surface


def test_centres_of_the_same_blocks_are_matched_as_they_are() -> None:
    blocks = np.stack(np.meshgrid(np.arange(10.0, 390, 19), np.arange(10.0, 290, 19)), axis=-1).reshape(-1, 2)
    left = Correspondences(blocks * 1.4 + 3, blocks)
    right = Correspondences(blocks[::-1] * 1.1 + [0.3, 0.7], blocks[::-1])
    match = match_through_code(left, right)
    np.testing.assert_allclose(match.projector_px, (match.camera_px - 3) / 1.4 * 1.1 + [0.3, 0.7])
    assert len(match) == len(blocks)


def test_codes_that_do_not_tell_are_refused() -> None:
    left = seen_by("left", LEFT, 0.05)
    columns = left.projector_px.copy()
    columns[:, 1] = np.nan
    with pytest.raises(CaptureError, match="second"):
        match_through_code(left, Correspondences(left.camera_px, columns))
    other = Correspondences(left.camera_px, left.projector_px, projector_size=(800, 600))
    with pytest.raises(InputError, match="a pattern of another size"):
        match_through_code(left, other)
    assert len(match_through_code(left, left.select(np.arange(0)))) == 0


def test_a_board_that_both_cameras_see_under_the_code_counts_by_its_corners_and_by_the_code() -> None:
    board = parse_board("chessboard:7x6:40mm")
    picture, _ = drawn(board)
    x, y = np.meshgrid(np.arange(60.0, 1000, 3), np.arange(60.0, 1000, 3))
    pixels = np.stack([x.ravel(), y.ravel()], axis=-1)
    moved = np.roll(picture, 20, axis=1)
    shift = np.array([20.0, 0])
    points = Correspondences(pixels, pixels + shift)
    views, left_out = see_views([StereoCapture("pose", picture, moved, points)], board, lambda message: None)
    assert left_out == []
    assert views[0].two_pictures
    names = [type(group).__name__ for group in observation_groups(views)]
    assert names == ["CornerObservations", "CornerObservations", "PlaneObservations", "SceneObservations"]
    np.testing.assert_allclose(views[0].patch_projector_px, views[0].patch_camera_px + shift, atol=1e-6)
