"""Every pixel of a pair: where the truth has it, as well as it says; whichever way the cameras stand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from retrue import Camera, CaptureError, DegenerateError, Rig, RigidTransform, decode, reconstruct
from retrue.decoding.photographs.dense import match_densely
from retrue.decoding.photographs.rectify import rectify
from retrue.patterns.photographs import PHOTOGRAPHS
from retrue.simulation.photographs import photograph, textured_scene

CAMERA = Camera((320, 240), [[300, 0, 159.5], [0, 300, 119.5], [0, 0, 1]], [-0.1, 0.02, 0, 0, 0])
OTHER = Camera((300, 260), [[330, 0, 150], [0, 330, 131], [0, 0, 1]], [-0.08, 0.02, 0, 0, 0])
POSES = {
    "to the right": RigidTransform.from_rotation_vector([0.02, -0.06, 0.03], [-120.0, 4, 6]),
    "to the left": RigidTransform.from_rotation_vector([0.02, 0.06, 0.03], [120.0, 4, 6]),
    "below": RigidTransform.from_rotation_vector([-0.06, 0.02, 0.03], [5.0, -120, 6]),
}


@pytest.mark.parametrize("side", POSES)
def test_a_scene_is_seen_everywhere_and_sigma_is_honest(side: str) -> None:
    rig = Rig(CAMERA, OTHER, POSES[side])
    pair = photograph(rig, textured_scene(rig, 1200.0, seed=4), supersample=1)
    matches = decode(PHOTOGRAPHS, [pair.left, pair.right])
    points = match_densely(rig, pair.left, pair.right, matches)
    true = pair.right_px[points.cells[:, 0], points.cells[:, 1]]
    off = np.linalg.norm(points.projector_px - true, axis=1)
    seen = np.isfinite(off)
    assert np.mean(~seen) < 0.02
    assert np.count_nonzero(seen) > 0.85 * np.count_nonzero(np.isfinite(pair.right_px[..., 0]))
    assert np.mean(off[seen] < 1) > 0.97
    right = seen & (off < 1)
    assert np.median(off[right] / points.projector_sigma_px[right]) == pytest.approx(0.6745, abs=0.25)
    assert np.array_equal(points.camera_px, points.cells[:, ::-1])
    cloud = reconstruct(rig, points)
    depth = pair.depth[cloud.cells[:, 0], cloud.cells[:, 1]]
    assert np.median(np.abs(cloud.points[:, 2] / depth - 1)) < 0.005
    assert len(cloud) > 0.95 * len(points)


def test_rows_of_a_rectified_pair_show_the_same() -> None:
    for pose in POSES.values():
        rig = Rig(CAMERA, OTHER, pose)
        plan = rectify(rig)
        points = np.random.default_rng(0).uniform([-200, -150, 800], [200, 150, 2000], (50, 3))
        first = plan.rectified_px(CAMERA, plan.first_turn, CAMERA.project(points))
        second = plan.rectified_px(OTHER, plan.second_turn, OTHER.project(pose.apply(points)))
        assert np.allclose(first[:, 1], second[:, 1], atol=1e-6)
        depth = points @ plan.first_turn[2]
        disparity = plan.view.K[0, 0] * plan.baseline / depth
        assert np.allclose(first[:, 0] - second[:, 0], disparity, atol=1e-6)
        back = plan.photograph_px(CAMERA, plan.first_turn, first)
        assert np.allclose(back, CAMERA.project(points), atol=1e-6)
        assert abs(plan.baseline) == pytest.approx(np.linalg.norm(pose.t))


def test_cameras_that_share_no_rows_are_refused() -> None:
    with pytest.raises(DegenerateError, match="t = 0"):
        rectify(Rig(CAMERA, OTHER, RigidTransform(np.eye(3), [0.0, 0, 0])))
    with pytest.raises(DegenerateError, match="looks along the line"):
        rectify(Rig(CAMERA, OTHER, RigidTransform(np.eye(3), [1.0, 0, -100])))


def test_a_pose_that_the_matches_contradict_makes_no_cloud() -> None:
    rig = Rig(CAMERA, OTHER, POSES["to the right"])
    pair = photograph(rig, textured_scene(rig, 1200.0, seed=4), supersample=1)
    matches = decode(PHOTOGRAPHS, [pair.left, pair.right])
    turned = RigidTransform.from_rotation_vector([0.06, 0, 0], np.zeros(3))
    with pytest.raises(CaptureError, match="lie on the rig's epipolar lines: recalibrate first"):
        match_densely(replace(rig, projector_from_camera=turned @ rig.projector_from_camera),
                      pair.left, pair.right, matches)  # fmt: skip
