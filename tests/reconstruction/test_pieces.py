import numpy as np
import pytest

from retrue.correspondences import Correspondences
from retrue.reconstruction.options import ReconstructOptions
from retrue.reconstruction.pieces import find_strays
from retrue.reconstruction.reconstruct import reconstruct
from retrue.reconstruction.surface_grid import surface_grid

from .scenes import PLATE, RIG, WALL, correspondences, scene


def strays_of(points, cells):
    return find_strays(surface_grid(points, cells), len(points))


def test_a_wall_and_a_plate_have_no_strays():
    points, _, cells, thing = scene(2, noise=3e-4)
    on_flat = (thing == WALL) | (thing == PLATE)
    strays = strays_of(points[on_flat], cells[on_flat])
    assert not strays.alone.any()
    assert not strays.islands.any()


@pytest.mark.parametrize("noise", [0.0, 3e-4])
def test_points_off_the_surface_are_strays_and_their_neighbours_are_not(noise):
    points, _, cells, thing = scene(2, noise)
    wall = thing == WALL
    points, cells = points[wall], cells[wall]
    wrong = np.arange(57, len(points), 211)
    points[wrong] *= np.random.default_rng(1).choice([0.9, 0.97, 1.04, 1.2], (len(wrong), 1))
    strays = strays_of(points, cells)
    assert np.array_equal(np.flatnonzero(strays.alone), wrong)
    assert not strays.islands.any()


def test_a_piece_without_an_inside_is_an_island():
    points, _, cells, thing = scene(2)
    wall = thing == WALL
    points, cells = points[wall], cells[wall]
    off = (np.abs(cells - [100, 60]) <= [0, 4]).all(axis=1)  # nine in a row
    whole = (np.abs(cells - [100, 140]) <= 1).all(axis=1)  # three by three, and so with an inside
    points[off | whole] *= 0.8
    strays = strays_of(points, cells)
    assert np.array_equal(strays.islands, off)
    assert not strays.alone.any()


def test_reconstruct_drops_and_counts_them_unless_told_to_keep_them():
    points, _, cells, thing = scene(2)
    wall = thing == WALL
    points, cells = points[wall], cells[wall]
    points[1234] *= 0.9
    seen = correspondences(points, cells=cells)
    cloud = reconstruct(RIG, seen)
    assert len(cloud) == len(points) - 1 == cloud.card["points"]
    assert (cloud.card["dropped_alone"], cloud.card["dropped_in_islands"]) == (1, 0)
    assert len(reconstruct(RIG, seen, ReconstructOptions(keep_strays=True))) == len(points)


def test_without_a_grid_nobody_is_a_stray():
    exact = correspondences(scene(step=40)[0])
    cloud = reconstruct(RIG, Correspondences(exact.camera_px, exact.projector_px))
    assert len(cloud) == len(exact)
    assert "dropped_alone" not in cloud.card
