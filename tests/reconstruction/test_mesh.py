from dataclasses import replace

import numpy as np
import pytest

from retrue.errors import DegenerateError, InputError
from retrue.reconstruction.cloud import Cloud
from retrue.reconstruction.mesh import make_mesh

from .scenes import scene


def cloud_of(points, camera_px, cells=None):
    colors = np.arange(3 * len(points), dtype=np.uint32).astype(np.uint8).reshape(-1, 3)
    return Cloud(points, colors, camera_px, "mm", cells)


def rows_of(points, mesh):
    """Which point each vertex of the mesh is."""
    row_of = {point: row for row, point in enumerate(map(tuple, points.tolist()))}
    return np.array([row_of[point] for point in map(tuple, mesh.points.tolist())])


@pytest.mark.parametrize("noise", [0.0, 3e-4, 1e-3])
@pytest.mark.parametrize(("step", "gridded"), [(1, True), (6, True), (6, False)])
def test_faces_cover_surfaces_and_bridge_no_jump(step, gridded, noise):
    points, camera_px, cells, thing = scene(step, noise)
    mesh = make_mesh(cloud_of(points, camera_px, cells if gridded else None))
    things = thing[rows_of(points, mesh)][mesh.faces]
    assert (things.min(axis=1) == things.max(axis=1)).all()
    whole = 2 * cells[:, 0].max() * cells[:, 1].max()
    assert len(mesh.faces) > (0.95 if step == 1 else 0.8) * whole


@pytest.mark.parametrize("gridded", [True, False])
def test_faces_point_to_the_camera_and_keep_their_colours(gridded):
    points, camera_px, cells, _ = scene(6)
    cloud = cloud_of(points, camera_px, cells if gridded else None)
    mesh = make_mesh(cloud)
    a, b, c = (mesh.points[mesh.faces[:, corner]] for corner in range(3))
    assert ((np.cross(b - a, c - a) * a).sum(axis=1) < 0).all()
    assert np.array_equal(mesh.colors, cloud.colors[rows_of(points, mesh)])
    assert np.array_equal(np.unique(mesh.faces), np.arange(len(mesh.points)))


def test_a_stray_point_between_two_surfaces_builds_no_bridge():
    points, camera_px, cells, thing = scene(6)
    column = cells[:, 1]
    wall_beside_plate = [
        row for row in np.flatnonzero(thing == 1) if column[row] == column[thing == 1].max() and points[row, 2] > 0
    ]
    stray = wall_beside_plate[len(wall_beside_plate) // 2]
    points[stray] *= 1.02  # half way from the plate to the wall
    mesh = make_mesh(cloud_of(points, camera_px, cells))
    rows = rows_of(points, mesh)
    touching = mesh.faces[(rows[mesh.faces] == stray).any(axis=1)]
    assert not (thing[rows[touching]] == 0).any()


def test_a_crease_is_no_jump():
    v, u = np.mgrid[0:40, 0:40]
    x, y = (u.ravel() - 20) / 100, (v.ravel() - 20) / 100
    depth = 1000 / (1 + np.abs(x) * 1.5)  # two walls that meet in an edge
    points = np.column_stack([x, y, np.ones_like(x)]) * depth[:, None]
    cells = np.column_stack([v.ravel(), u.ravel()])
    assert len(make_mesh(cloud_of(points, cells[:, ::-1].astype(float), cells)).faces) == 2 * 39 * 39


def test_a_missing_corner_leaves_one_face_of_its_square():
    v, u = np.mgrid[0:2, 0:2]
    points = np.column_stack([u.ravel(), v.ravel(), np.full(4, 20.0)])
    cells = np.column_stack([v.ravel(), u.ravel()])
    assert len(make_mesh(cloud_of(points, cells[:, ::-1].astype(float), cells)).faces) == 2
    for missing in range(4):
        kept = np.delete(np.arange(4), missing)
        mesh = make_mesh(cloud_of(points[kept], cells[kept, ::-1].astype(float), cells[kept]))
        assert len(mesh.faces) == 1


def test_no_face_spans_a_hole():
    points, camera_px, _, _ = scene(6)
    outside = ~(np.abs(camera_px - [160, 120]) < 40).all(axis=1)
    mesh = make_mesh(cloud_of(points[outside], camera_px[outside]))
    pixels = camera_px[rows_of(points, mesh)]
    longest = max(
        np.linalg.norm(pixels[mesh.faces[:, i]] - pixels[mesh.faces[:, i - 1]], axis=1).max() for i in range(3)
    )
    assert longest < 20


@pytest.mark.parametrize("pixels", [[[0, 0], [5, 0]], [[0, 0], [5, 0], [10, 0]]], ids=["two points", "a line"])
def test_points_that_span_nothing_are_an_error(pixels):
    pixels = np.array(pixels, dtype=float)
    points = np.column_stack([pixels, np.full(len(pixels), 100.0)])
    with pytest.raises(DegenerateError, match="mesh: expected points that span an area"):
        make_mesh(cloud_of(points, pixels))


def test_cells_without_neighbours_are_an_error():
    points, camera_px, cells, _ = scene(60)
    with pytest.raises(DegenerateError, match="mesh: no three of"):
        make_mesh(cloud_of(points, camera_px, 2 * cells))


def test_a_grid_too_large_for_memory_is_an_error():
    points, camera_px, cells, _ = scene(60)
    with pytest.raises(InputError, match="cells: expected a grid of at most"):
        make_mesh(cloud_of(points, camera_px, 100_000 * cells))


def test_neighbours_that_err_alike_tear_no_surface_where_their_sigma_is_known():
    v, u = np.mgrid[0:60, 0:90]
    cells = np.stack([v, u], axis=-1).reshape(-1, 2)
    rays = np.column_stack([(cells[:, ::-1] - [45, 30]) / 500.0, np.ones(len(cells))])
    stripe = np.random.default_rng(1).normal(0, 1.0, 18)[cells[:, 1] // 5]  # mm, of each stripe of five pixels
    depth = np.where(cells[:, 0] < 30, 700.0, 720.0) + stripe
    cloud = replace(cloud_of(rays * depth[:, None], cells[:, ::-1].astype(float), cells), unit="mm")
    torn, whole = make_mesh(cloud), make_mesh(replace(cloud, sigma=np.full(len(cloud), 1.0)))
    assert len(torn.faces) < 0.95 * len(whole.faces)
    assert len(whole.faces) == pytest.approx(2 * 2 * 29 * 89, rel=0.01)
    assert np.ptp(whole.points[whole.faces][:, :, 2], axis=1).max() < 10  # the step of 20 mm is one
