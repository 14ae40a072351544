"""Poses do not depend on where the adjustment began, nor on how far the views' own sigmas are from the truth."""

from dataclasses import replace

import numpy as np
import pytest

from retrue.geometry.transform import RigidTransform
from retrue.merging.graph import adjust
from retrue.merging.view import make_view
from tests.merging.objects import turntable

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
