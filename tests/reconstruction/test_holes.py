import numpy as np
import pytest

from retrue.errors import InputError
from retrue.reconstruction.cloud import Cloud
from retrue.reconstruction.holes import fill_holes
from retrue.reconstruction.mesh import make_mesh

from .scenes import BALL, PLATE, WALL, scene


def cloud_without(gone, noise=0.0):
    """The scene less the cells that `gone` (N,) says; and the rows of those."""
    points, camera_px, cells, thing = scene(2, noise)
    missing = gone(cells, thing)
    colors = np.full((len(points), 3), 90, np.uint8)
    kept = Cloud(points[~missing], colors[~missing], camera_px[~missing], "mm", cells[~missing])
    return kept, points[missing], camera_px[missing], cells[missing]


def middle_of_the_ball(cells, thing):
    return (thing == BALL) & (np.abs(cells - [60, 110]) < [4, 6]).all(axis=1)


@pytest.mark.parametrize("noise", [0.0, 2e-4])
def test_a_hole_in_a_ball_is_filled_where_the_ball_is(noise):
    cloud, points, camera_px, cells = cloud_without(middle_of_the_ball, noise)
    filled = fill_holes(cloud)
    new = slice(len(cloud), None)
    assert (filled.card["holes_filled"], filled.card["points_filled_in"]) == (1, len(points))
    assert np.array_equal(filled.cells[new], cells)
    assert np.allclose(filled.camera_px[new], camera_px, atol=1e-6)
    exact = cloud_without(middle_of_the_ball)[1]
    assert np.abs(filled.points[new] - exact).max() < 2.0 + 4e3 * noise
    assert (filled.colors[new] == 90).all()
    assert np.array_equal(filled.points[: len(cloud)], cloud.points)


def test_what_is_filled_is_meshed():
    cloud, points, _, _ = cloud_without(middle_of_the_ball)
    assert len(make_mesh(fill_holes(cloud)).points) == len(make_mesh(cloud).points) + len(points)


def test_a_gap_between_two_surfaces_stays_open():
    def shadow_beside_the_plate(cells, thing):
        right_edge = cells[thing == PLATE][:, 1].max()
        rows = cells[thing == PLATE][:, 0]
        beside = (cells[:, 1] > right_edge - 3) & (cells[:, 1] < right_edge + 6)
        return beside & (cells[:, 0] > rows.min() + 3) & (cells[:, 0] < rows.max() - 3)

    cloud, *_ = cloud_without(shadow_beside_the_plate)
    filled = fill_holes(cloud)
    assert (filled.card["holes_filled"], filled.card["holes_left_open"]) == (0, 1)
    assert len(filled) == len(cloud)


def test_what_is_open_to_the_border_is_no_hole():
    cloud, *_ = cloud_without(lambda cells, thing: (thing == WALL) & (cells[:, 0] < 20) & (cells[:, 1] < 20))
    filled = fill_holes(cloud)
    assert (filled.card["holes_filled"], filled.card["holes_left_open"]) == (0, 0)


def test_scattered_points_have_no_holes_to_fill():
    points, camera_px, _, _ = scene(60)
    with pytest.raises(InputError, match="fill_holes: expected points of a capture with a grid"):
        fill_holes(Cloud(points, np.zeros((len(points), 3), np.uint8), camera_px, "mm"))
