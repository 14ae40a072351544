"""Poses do not depend on where the adjustment began, nor on how far the views' own sigmas are from the truth."""

from dataclasses import replace

import numpy as np
import pytest

from retrue.geometry.transform import RigidTransform, vector_from_rotation
from retrue.merging.graph import adjust
from retrue.merging.view import make_view
from tests.merging.objects import radius, turntable, view_pose

CELL, VIEWS = 3.0, 12


@pytest.mark.parametrize("understated", [1, 30, 100])
def test_what_a_loop_misses_is_shared_by_all_its_pairs(understated):
    """Half of it starts .1 mm off: all pairs are content but two, which sigmas that are too small do not believe."""
    clouds, true = turntable(VIEWS, seed=2)
    views = [make_view(cloud.points, None, CELL) for cloud in clouds]
    views = [replace(view, sigma=view.sigma / understated) for view in views]
    poses = {view: true[0] @ pose.inverse() for view, pose in enumerate(true)}
    aside = np.array([0.2, -0.15, 0.15]) / 3
    start = {view: RigidTransform(np.eye(3), (view > VIEWS / 2) * aside) @ pose for view, pose in poses.items()}
    found = adjust(views, start, [(view, (view + 1) % VIEWS) for view in range(VIEWS)], CELL)
    for view, pose in poses.items():
        assert np.linalg.norm(found.poses[view].apply(true[view].t) - pose.apply(true[view].t)) < 0.03
    assert max(found.closures.values()) < 2


@pytest.mark.parametrize("count", [2, 4])
def test_poses_are_as_sure_as_they_say_however_many_views_see_one_place(count):
    """Pairs share their views' errors: of four views of one side six pairs tell no more than three would alone."""
    random = np.random.default_rng(count)
    draws = 8
    squares = [squared_error(count, random) for _ in range(draws)]
    numbers = 6 * (count - 1) * draws
    assert abs(np.sum(squares) / numbers - 1) < 4 * np.sqrt(2 / numbers)


def squared_error(count, random):
    """Of the poses of so many views from one place, in their covariance."""
    views = [make_view(from_one_place(random), None, CELL) for _ in range(count)]
    start = {view: RigidTransform.identity() for view in range(count)}
    pairs = [(first, second) for first in range(count) for second in range(first + 1, count)]
    found = adjust(views, start, pairs, CELL)
    off = np.concatenate(
        [np.append(vector_from_rotation(pose.R), pose.t) for view, pose in found.poses.items() if view]
    )
    return off @ np.linalg.solve(found.covariance[6:, 6:], off)


def from_one_place(random, count=5000):
    directions = random.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = view_pose(0.4).apply(directions * radius(directions)[:, None])
    points = points[points[:, 2] < np.median(points[:, 2]) - 10]
    return points * (1 + 0.05 / 400 * random.normal(size=(len(points), 1)))
