"""A pose at which surfaces lie on each other is believed only where each camera saw of the other's what it ought to."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from retrue.geometry.transform import RigidTransform, vector_from_rotation
from retrue.merging import ties
from retrue.merging.merge import Merged, RefusedMerge, merge
from retrue.merging.options import MergeOptions
from retrue.merging.pairs import TURNS, Pair, _all_around, alike, fine_pair, turned_poses
from retrue.merging.sight import Sight, evidence
from retrue.merging.view import make_view
from retrue.reconstruction.cloud import Cloud
from tests.merging.objects import view_pose

CELL, NOISE, HALF = 2.5, 0.05, 30.0
KNOBS = np.array([[30.0, -12, 10], [-8, 14, 30], [-30, 10, -12], [10, -10, -30], [12, -30, 12]])  # one or two a side
QUARTER = RigidTransform.from_rotation_vector([0.0, np.pi / 2, 0.0], [0.0, 0.0, 0.0])


def surface(random, knob, count=60_000):
    """Points and normals of a cube with balls grown into its sides: without them, a quarter of a turn is no turn."""
    side = random.integers(0, 6, count)
    points = random.uniform(-HALF, HALF, (count, 3))
    normals = np.zeros((count, 3))
    rows = np.arange(count)
    normals[rows, side % 3] = np.where(side < 3, 1.0, -1.0)
    points[rows, side % 3] = HALF * normals[rows, side % 3]
    outward = random.normal(size=(count, 3))
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    balls = KNOBS[random.integers(0, len(KNOBS), count)] + knob * outward
    free = (np.abs(balls) > HALF).any(axis=1)
    bare = (np.linalg.norm(points[:, None] - KNOBS, axis=2) > knob).all(axis=1)
    return np.concatenate([points[bare], balls[free]]), np.concatenate([normals[bare], outward[free]])


def cube_view(angle, random, knob=8.0):
    """What a camera sees of it: in each pixel only what is nearest."""
    pose = view_pose(angle)
    points, normals = surface(random, knob)
    points, normals = pose.apply(points), normals @ pose.R.T
    faces = (normals * points).sum(axis=1) < -0.2 * np.linalg.norm(points, axis=1)
    pixel = np.unique(np.floor(points[:, :2] / points[:, 2:] * 150), axis=0, return_inverse=True)[1].ravel()
    nearest = np.full(pixel.max() + 1, np.inf)
    np.minimum.at(nearest, pixel, points[:, 2])
    points = points[faces & (points[:, 2] < nearest[pixel] + 4)]
    points = points * (1 + NOISE / np.linalg.norm(points, axis=1) * random.normal(size=len(points)))[:, None]
    return cloud_of(points)


def cloud_of(points):
    return Cloud(points, np.full((len(points), 3), 128, np.uint8), np.full((len(points), 2), np.nan), "mm")


def at(first, second, rival=None):
    """first_from_second; `rival`: as if the object had been turned by so much more in between."""
    return view_pose(first) @ (RigidTransform.identity() if rival is None else rival) @ view_pose(second).inverse()


@pytest.mark.parametrize("angle", [0.3, 0.6])
def test_a_quarter_of_a_turn_of_a_cube_loses_though_its_sides_lie_on_each_other(angle):
    random = np.random.default_rng(2)
    views = [make_view(cube_view(each, random).points, None, CELL) for each in (0.2, 0.2 + angle)]
    right = fine_pair(0, 1, views, at(0.2, 0.2 + angle), CELL)
    wrong = fine_pair(0, 1, views, at(0.2, 0.2 + angle, QUARTER), CELL)
    assert wrong.overlap > 0.25  # or nothing is shown
    assert right.evidence > ties.PROVEN
    assert wrong.evidence < 1


def test_views_are_not_tied_by_the_wrong_pose_that_starts_lead_to(monkeypatch):
    random = np.random.default_rng(3)
    clouds = [cube_view(angle, random) for angle in (0.2, 0.7)]
    monkeypatch.setattr(ties, "turned_poses", lambda *_: [at(0.2, 0.7, QUARTER)])
    monkeypatch.setattr(ties, "shaped_poses", lambda *_: [])
    assert isinstance(merge(clouds), RefusedMerge)
    monkeypatch.setattr(ties, "shaped_poses", lambda *_: [at(0.2, 0.7)])
    assert isinstance(merge(clouds), Merged)


@pytest.mark.parametrize("trial", range(4))
def test_turns_lead_far_turned_views_to_each_other(trial):
    random = np.random.default_rng([6, trial])
    angle, step = random.uniform(0, 6), random.uniform(0.9, 1.1)
    views = [make_view(cube_view(each, random).points, None, CELL) for each in (angle, angle + step)]
    found = [fine_pair(0, 1, views, start, CELL).pose for start in turned_poses(*views, CELL)]
    assert any(alike(views[1], pose, at(angle, angle + step), CELL / 10) for pose in found)


def test_what_one_view_missed_by_itself_is_no_proof_against_all_others():
    """Half of it in shadow, five others miss half of their points there; together they tell of one shadow."""
    each = Sight(200, 0, 600, 2000)
    assert evidence([each] * 5) > 5 * evidence([each])
    assert evidence([Sight(1000, 0, 100, 2000)]) > 2
    assert evidence([Sight(1000, 300, 100, 2000)]) < 0


def bumpy_wall(shift, random, count=8000):
    """Part of a wall far larger than the picture, which cuts it off at all four sides."""
    bumps = np.random.default_rng(9)
    middle, height, width = bumps.uniform(-300, 300, (90, 2)), bumps.uniform(-15, 20, 90), bumps.uniform(15, 45, 90)
    x = np.array([shift, 0.0]) + random.uniform(-150, 150, (3 * count, 2))
    z = (height * np.exp(-((x[:, None] - middle) ** 2).sum(axis=2) / (2 * width**2))).sum(axis=1)
    points = np.column_stack([x - [shift, 0.0], 400 - z])
    points = points[(np.abs(points[:, :2] / points[:, 2:]) < [0.25, 0.2]).all(axis=1)][:count]
    return cloud_of(points * (1 + NOISE / 400 * random.normal(size=(len(points), 1))))


def test_what_lies_beyond_the_picture_is_not_missed():
    random = np.random.default_rng(4)
    clouds = [bumpy_wall(shift, random) for shift in (0.0, 90.0)]
    views = [make_view(cloud.points, None, 4.0) for cloud in clouds]
    for view in views:
        assert np.allclose(view.field, [[-0.25, -0.2], [0.25, 0.2]], atol=0.003)
    pair = fine_pair(0, 1, views, RigidTransform(np.eye(3), [90.0, 0.0, 0.0]), 4.0)
    assert pair.overlooked < 0.05
    found = merge(clouds)
    assert isinstance(found, Merged)
    assert np.linalg.norm(found.poses[1].t - [90.0, 0.0, 0.0]) < 0.3
    assert np.linalg.norm(vector_from_rotation(found.poses[1].R)) < 1e-3


def test_an_object_that_ends_within_the_picture_is_not_cut_off():
    field = make_view(cube_view(0.6, np.random.default_rng(5)).points, None, CELL).field
    assert np.isinf(field).sum() >= 3


def test_turns_are_tried_all_around():
    turns = Rotation.from_matrix(_all_around(TURNS))
    apart = [(turns.inv() * any_turn).magnitude().min() for any_turn in Rotation.random(300, random_state=8)]
    assert np.degrees(max(apart)) < 38
    assert np.degrees(np.quantile(apart, 0.9)) < 28


def test_what_a_pair_does_not_prove_waits_for_those_that_do(monkeypatch):
    """Two views next to each other that may be front and back; a third, tried later, knows better."""
    odds = {(0, 1): 1.0, (1, 2): -20.0, (0, 2): 9.0}
    heard = []

    def joined(groups, pair, *_):
        heard.append((pair.first, pair.second))
        return groups

    def best(first, second, *_):
        return Pair(first, second, RigidTransform.identity(), 0.5, 0.0, 0.0, odds[first, second])

    monkeypatch.setattr(ties, "_best", best)
    monkeypatch.setattr(ties, "_joined", joined)
    ties.ties(dict.fromkeys(range(3)), MergeOptions(), CELL, {}, None)
    assert heard.index((0, 2)) < heard.index((0, 1))
    assert (0, 1) in heard
