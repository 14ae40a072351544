import numpy as np
import pytest

from retrue.errors import InputError
from retrue.reconstruction.cloud import Cloud
from retrue.reconstruction.normals import with_normals
from retrue.reconstruction.resolution import resolution
from retrue.reconstruction.surface_grid import surface_grid

from .scenes import BALL, CAMERA, PLATE, WALL, scene

BALL_CENTRE = np.array([250.0, 0.0, 1300.0])
WALL_NORMAL = -np.array([-0.15, -0.1, 0.5]) / np.linalg.norm([-0.15, -0.1, 0.5])


def cloud_of(points, camera_px, cells):
    return Cloud(points, np.zeros((len(points), 3), np.uint8), camera_px, "mm", cells)


def angles_deg(a, b):
    return np.degrees(np.arccos(np.clip((a * b).sum(axis=1), -1, 1)))


def test_normals_of_planes_are_exact_up_to_the_edges_of_depth_jumps():
    points, camera_px, cells, thing = scene(2)
    normals = with_normals(cloud_of(points, camera_px, cells)).normals
    for flat in (WALL, PLATE):
        assert angles_deg(normals[thing == flat], WALL_NORMAL).max() < 1e-3
    assert np.allclose(np.linalg.norm(normals[thing != BALL], axis=1), 1)


def test_normals_of_a_ball_point_outwards_and_to_the_camera():
    points, camera_px, cells, thing = scene(2)
    normals = with_normals(cloud_of(points, camera_px, cells)).normals
    outwards = (points - BALL_CENTRE) / 260.0
    facing = (thing == BALL) & (-(outwards * points).sum(axis=1) > 0.5 * np.linalg.norm(points, axis=1))
    assert angles_deg(normals[facing], outwards[facing]).max() < 1.5
    assert ((normals[facing] * points[facing]).sum(axis=1) < 0).all()


def test_noise_turns_normals_by_what_it_must():
    points, camera_px, cells, thing = scene(2, noise=3e-4)
    normals = with_normals(cloud_of(points, camera_px, cells)).normals
    assert np.median(angles_deg(normals[thing == WALL], WALL_NORMAL)) < 2.0


def test_a_point_without_neighbours_has_no_normal():
    points, camera_px, cells, _ = scene(60)
    assert np.isnan(with_normals(cloud_of(points, camera_px, 2 * cells)).normals).all()


def test_scattered_points_have_no_normals():
    points, camera_px, _, _ = scene(60)
    with pytest.raises(InputError, match="normals: expected points of a capture with a grid"):
        with_normals(cloud_of(points, camera_px, None))


@pytest.mark.parametrize("noise", [1e-4, 1e-3])
def test_resolution_tells_noise_and_spacing(noise):
    points, _, cells, thing = scene(2, noise)
    wall = thing == WALL
    found = resolution(points[wall], surface_grid(points[wall], cells[wall]))
    depth = float(np.median(points[wall, 2]))
    assert found.noise == pytest.approx(noise * depth, rel=0.1)
    pixel = depth / CAMERA.K[0, 0]
    assert 2 * pixel < found.spacing < 2.6 * pixel  # the wall leans


def test_resolution_of_almost_nothing_is_unknown():
    points, _, cells, _ = scene(60)
    found = resolution(points, surface_grid(points, 2 * cells))
    assert np.isnan(found.spacing)
    assert np.isnan(found.noise)
