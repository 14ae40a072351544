"""A known object of twelve views comes together, whatever the order; what is not of it is named."""

import numpy as np
import pytest

from retrue.errors import DegenerateError, InputError
from retrue.geometry.transform import vector_from_rotation
from retrue.merging.merge import Merged, NoCommonSurface, NoSurface, NothingInCommon, RefusedMerge, merge
from retrue.merging.options import MergeOptions
from retrue.reconstruction.cloud import Cloud
from tests.merging.objects import HEIGHTS, off_surface, seen, turntable, view_pose

NOISE = 0.05  # along the rays, mm


@pytest.fixture(scope="module")
def turn():
    return turntable(12, sigma=NOISE)


@pytest.fixture(scope="module")
def merged(turn):
    found = merge(turn[0])
    assert isinstance(found, Merged)
    return found


def rms(points):
    return float(np.sqrt(np.mean(off_surface(points) ** 2)))


def raw_rms(clouds, poses, found):
    """Of all points where the poses put them, the first view where it truly is."""
    first = next(iter(found))
    return rms(np.concatenate([(poses[first].inverse() @ pose).apply(clouds[k].points) for k, pose in found.items()]))


def test_all_views_are_where_they_were_within_two_sigma(turn, merged):
    _, poses = turn
    assert list(merged.poses) == list(range(12))
    for view in range(1, 12):
        off = merged.poses[view] @ (poses[0] @ poses[view].inverse()).inverse()
        turned, shifted = merged.pose_sigma[view]
        assert np.linalg.norm(vector_from_rotation(off.R)) < 2 * turned
        assert np.linalg.norm(off.apply(poses[0].t) - poses[0].t) < 2 * shifted
        assert shifted < 0.02
    assert merged.closure_sigma < 2


def test_poses_cost_next_to_nothing_beside_the_noise(turn, merged):
    clouds, poses = turn
    true = {view: poses[0] @ pose.inverse() for view, pose in enumerate(poses)}
    assert raw_rms(clouds, poses, merged.poses) < 1.01 * raw_rms(clouds, poses, true)


def test_the_surface_is_nearer_to_the_truth_than_any_view(turn, merged):
    clouds, poses = turn
    off = off_surface(poses[0].inverse().apply(merged.cloud.points))
    assert np.sqrt(np.mean(off**2)) < 0.5 * rms(poses[3].inverse().apply(clouds[3].points))
    assert (np.abs(off) <= 3 * np.hypot(merged.cloud.sigma, 0.01)).mean() > 0.9
    outward = poses[0].inverse().apply(merged.cloud.points)
    assert ((merged.cloud.normals @ poses[0].R * outward).sum(axis=1) > 0).mean() > 0.99


def test_the_mesh_is_one_surface(turn, merged):
    import trimesh

    mesh = merged.mesh(2.0)
    assert rms(turn[1][0].inverse().apply(mesh.points)) < 0.06
    made = trimesh.Trimesh(mesh.points, mesh.faces, process=False)
    largest = max(made.split(only_watertight=False), key=lambda part: len(part.faces))
    assert len(largest.faces) > 0.99 * len(mesh.faces)
    outward = turn[1][0].inverse().apply(made.triangles_center)
    assert ((made.face_normals @ turn[1][0].R * outward).sum(axis=1) > 0).mean() > 0.98


def test_a_foreign_view_among_shuffled_ones_is_named(turn):
    clouds, poses = turn
    order = np.random.default_rng(1).permutation(12)[:7]
    handed = [clouds[k] for k in sorted(order)]
    handed.insert(
        2, seen(view_pose(0.3), np.random.default_rng(3), heights=np.random.default_rng(5).permutation(HEIGHTS))
    )
    names = [f"v{k}.ply" for k in range(8)]
    found = merge(handed, names=names)
    assert isinstance(found, Merged)
    assert 2 in found.left_out
    assert isinstance(found.left_out[2], NoCommonSurface)
    assert "v2.ply was left out" in found.reason
    assert found.cause is found.left_out[min(found.left_out)]
    true = [poses[k] for k in sorted(order)]
    true.insert(2, view_pose(0.3))
    assert raw_rms(handed, true, found.poses) < 1.05 * NOISE


def test_a_turntable_is_told_by_the_number_of_its_steps(turn):
    clouds, _ = turn
    found = merge(clouds, MergeOptions(turntable=12))
    assert isinstance(found, Merged)
    assert len(found.poses) == 12
    with pytest.raises(InputError, match="turntable: expected as many views"):
        merge(clouds[:5], MergeOptions(turntable=12))


def without_surface(cloud):
    """Of the same camera: few points, none, none that is known, dust, all in one place, and along a line."""
    random = np.random.default_rng(2)
    grey, nowhere = np.full((400, 3), 99, np.uint8), np.full((400, 2), np.nan)
    line = np.array([1.0, 2.0, 400.0]) + np.linspace(0, 50, 400)[:, None] * [1.0, 0.2, 0.1]
    places = {
        "unknown.ply": np.full((400, 3), np.nan),
        "dust.ply": random.normal([0, 0, 400.0], 20.0, (400, 3)),
        "place.ply": np.full((400, 3), 400.0),
        "line.ply": line,
    }
    few = {"few.ply": cloud.select(np.arange(49)), "none.ply": cloud.select(np.arange(0))}
    return few | {name: Cloud(points, grey, nowhere, cloud.unit) for name, points in places.items()}


def test_views_without_a_surface_are_left_out_and_named(turn):
    """One of twelve that was taken into the light would undo the work on all others."""
    clouds, poses = turn
    useless = without_surface(clouds[0])
    handed, true = [clouds[0], *useless.values(), clouds[1], clouds[2]], [poses[0], *[None] * 6, *poses[1:3]]
    names = ["a.ply", *useless, "b.ply", "c.ply"]
    found = merge(handed, names=names)
    assert isinstance(found, Merged)
    assert list(found.poses) == [0, 7, 8]
    assert {names[view] for view in found.left_out} == set(useless)
    assert all(isinstance(reason, NoSurface) for reason in found.left_out.values())
    assert "few.ply was left out: expected 50 points on a surface, found 49" in found.reason
    assert "none.ply was left out: expected 50 points on a surface, found 0" in found.reason
    assert raw_rms(handed, true, found.poses) < 1.05 * NOISE


def test_a_turntable_goes_on_past_a_view_without_a_surface(turn):
    clouds, poses = turn
    handed = [*clouds[:4], clouds[4].select(np.arange(20)), *clouds[5:]]
    found = merge(handed, MergeOptions(turntable=12))
    assert isinstance(found, Merged)
    assert list(found.left_out) == [4]
    assert len(found.poses) == 11
    true = {view: poses[0] @ poses[view].inverse() for view in found.poses}
    assert raw_rms(handed, poses, found.poses) < 1.01 * raw_rms(handed, poses, true)


def test_a_refusal_names_what_was_not_asked(turn):
    found = merge([turn[0][0], turn[0][1].select(np.arange(9)), turn[0][6]], names=["front", "few", "back"])
    assert isinstance(found, RefusedMerge)
    assert "no two of 2 views show a common surface" in found.reason
    assert "few was left out: expected 50 points on a surface, found 9" in found.reason


def test_what_does_not_overlap_is_refused(turn):
    clouds, _ = turn
    found = merge([clouds[0], clouds[6]], names=["front", "back"])
    assert isinstance(found, RefusedMerge)
    assert isinstance(found.cause, NothingInCommon)
    assert "no two of 2 views show a common surface" in found.reason


def test_rubbish_is_refused(turn):
    cloud = turn[0][0]
    with pytest.raises(InputError, match="two clouds or more, found 1"):
        merge([cloud])
    inches = Cloud(cloud.points, cloud.colors, cloud.camera_px, "in")
    with pytest.raises(InputError, match="expected one unit of length, found in, mm"):
        merge([cloud, inches])
    few = cloud.select(np.arange(10))
    with pytest.raises(DegenerateError, match="few: merge: expected 50 points on a surface, found 10"):
        merge([cloud, few], names=["many", "few"])
    with pytest.raises(DegenerateError, match=r"few\.ply: merge: .* of 7 views fewer than two are left"):
        merge([*without_surface(cloud).values(), cloud], names=[*without_surface(cloud), "many.ply"])


def test_dust_is_refused():
    random = np.random.default_rng(0)
    places = random.normal(loc=(0, 0, 9), size=(2, 800, 3))
    dust = [Cloud(points, np.zeros((800, 3), np.uint8), np.zeros((800, 2)), "m") for points in places]
    with pytest.raises(DegenerateError, match="points on a surface"):
        merge(dust)


def test_a_whole_object_is_no_view(turn, merged):
    found = merge([turn[0][0], merged.cloud.select(np.flatnonzero(merged.cloud.points[:, 2] > 0))])
    assert isinstance(found, RefusedMerge)
    assert "before what that camera saw" in found.reason  # its far side lies behind nothing that a camera saw there


def test_cells_finer_than_the_points_are_refused(turn):
    with pytest.raises(InputError, match="cell: expected half of the points' distance or more"):
        merge(turn[0][:2], MergeOptions(cell=1e-6))


def test_what_stands_still_before_the_camera_ties_no_views(turn):
    """A wall behind a turntable has most of the points, and is the same in all views: they lay on it, as unturned."""
    clouds, poses = turn
    random = np.random.default_rng(5)
    before = [with_wall(cloud, random) for cloud in clouds]
    found = merge(before)
    assert isinstance(found, Merged)
    assert len(found.poses) == 12
    assert found.standing == pytest.approx(
        sum(len(b) - len(a) for a, b in zip(clouds, before, strict=True)) / sum(map(len, before)), abs=0.005
    )
    assert "without what stood still before the camera" in found.reason
    true = {view: poses[0] @ pose.inverse() for view, pose in enumerate(poses)}
    assert raw_rms(clouds, poses, found.poses) < 1.02 * raw_rms(clouds, poses, true)
    kept = merge(before[:3], MergeOptions(keep_standing=True))
    assert kept.standing == 0
    assert raw_rms(clouds, poses, kept.poses) > 10 * raw_rms(clouds, poses, true)  # the wall's word


def with_wall(cloud, random, count=40_000):
    """A leaning wall behind it, of which the camera sees what is not behind the object."""
    rays = random.uniform(-0.5, 0.5, (count, 2))
    points = np.column_stack([rays, np.ones(count)]) * (600 / (1 - 0.2 * rays[:, :1] + 0.05 * rays[:, 1:]))
    points *= 1 + NOISE / 600 * random.normal(size=(count, 1))
    reach = 1.1 * np.quantile(np.linalg.norm(cloud.points[:, :2] / cloud.points[:, 2:], axis=1), 0.99)
    points = points[np.linalg.norm(rays, axis=1) > reach]
    grey = np.full((len(points), 3), 99, np.uint8)
    every = np.concatenate([cloud.points, points])
    return Cloud(every, np.concatenate([cloud.colors, grey]), np.full((len(every), 2), np.nan), cloud.unit)


def test_views_at_rest_are_merged_whole(turn):
    """Nothing turned, so that all stands: copies of one view are no background."""
    _, poses = turn
    random = np.random.default_rng(6)
    again = [seen(poses[0], random, NOISE) for _ in range(3)]
    found = merge(again)
    assert (len(found.poses), found.standing) == (3, 0)


def test_a_mesh_has_cells_that_memory_allows(turn, merged, monkeypatch):
    fine = len(merged.mesh().faces)
    monkeypatch.setattr("retrue.merging.surface.MOST_NODES", 100_000)
    coarse = len(merged.mesh().faces)
    assert 1000 < coarse < 0.7 * fine
    with pytest.raises(DegenerateError, match="take larger ones"):
        merged.mesh(0.5)


def test_a_view_is_handed_in_once(turn):
    first, second = turn[0][:2]
    with pytest.raises(InputError, match="view 3: holds the same points as view 1"):
        merge([first, second, first])
