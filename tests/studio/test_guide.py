"""Where the board is asked for: what shows most, in words that lead there."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from retrue.calibration.board import parse_board
from retrue.calibration.detection import BoardCorners
from retrue.geometry.transform import RigidTransform, rotation_from_vector
from retrue.studio.guide import Guide, SeenBoard

BOARD = parse_board("chessboard:9x7:29mm")
EMPTY = Guide(BOARD, (640, 480), (1024, 768))


def held(guide: Guide, lean_deg: tuple[float, float] = (0.0, 0.0), x: float = 0.0, z: float = 650.0) -> SeenBoard:
    """As the camera would see it: leaning about the axes of its picture, so far to the right, so far away."""
    pose = RigidTransform(rotation_from_vector(np.radians([*lean_deg, 0.0])), [x, 0.0, z])
    points = pose.apply(np.column_stack([guide.plan, np.zeros(len(guide.plan))])) @ guide.K.T
    seen = guide.seen(BoardCorners(BOARD.points, points[:, :2] / points[:, 2:], True))
    assert seen is not None
    assert np.allclose(seen.pose.R, pose.R, atol=1e-6)
    assert np.allclose(seen.pose.t, pose.t, rtol=1e-6)
    return seen


def test_who_does_what_is_asked_shows_all_there_is_in_eight_poses():
    guide, gains = EMPTY, list[float]()
    for _ in range(8):
        gains.append(guide.gain(guide.wish))
        assert guide.is_worth(guide.wish)
        guide = replace(guide, taken=(*guide.taken, guide.wish))
        assert not guide.is_worth(guide.taken[-1])  # the same again shows nothing
    assert all(late <= early + 1e-9 for early, late in pairwise(gains))
    assert len(guide.covered("camera_px")) > 0.7 * 48
    normals = np.array([pose.normal for pose in guide.taken])
    assert np.degrees(np.arccos(np.clip(normals @ normals.T, -1, 1))).max() > 45
    distances = [pose.pose.t[2] for pose in guide.taken]
    assert max(distances) / min(distances) > 1.2


@pytest.mark.parametrize(
    ("wished", "now", "words"),
    [
        ({"lean_deg": (0, 35)}, {}, "tilt it more: its left edge away"),
        ({"lean_deg": (0, -35)}, {}, "tilt it more: its right edge away"),
        ({"lean_deg": (35, 0)}, {}, "tilt it more: its lower edge away"),
        ({"lean_deg": (-35, 0)}, {}, "tilt it more: its upper edge away"),
        ({}, {"lean_deg": (0, 35)}, "hold it flat"),
        ({"x": 120.0}, {}, "move it right"),
        ({"x": -120.0}, {}, "move it left"),
        ({"z": 500.0}, {}, "hold it nearer"),
        ({"z": 900.0}, {}, "hold it farther away"),
    ],
)
def test_the_largest_step_is_said_first(wished: dict, now: dict, words: str):
    guide = Guide(BOARD, (640, 480), (1024, 768))
    guide.__dict__["wish"] = held(guide, **wished)
    assert guide.advice(held(guide, **now)).startswith(words)


def test_the_edge_that_is_said_is_the_one_that_lies_farther_away():
    seen = held(EMPTY, lean_deg=(0, 35))
    right, left = EMPTY.plan[:, 0].max(), EMPTY.plan[:, 0].min()
    assert seen.pose.apply([left, 0, 0])[2] > seen.pose.apply([right, 0, 0])[2]


def test_corners_that_lie_on_one_spot_tell_no_pose():
    assert EMPTY.seen(BoardCorners(BOARD.points, np.full((63, 2), 240.0), True)) is None
