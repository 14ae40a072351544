"""Colours of a grid's points: what the scene looks like in white light, with a white picture and without."""

import numpy as np
import pytest

from retrue.decoding.decode import decode
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.patterns.color_grid import make_color_grid
from retrue.rig import Rig
from retrue.simulation.camera_model import CameraModel
from retrue.simulation.scene import Scene, render
from retrue.simulation.surfaces import Paint, Wall

CAMERA = Camera((640, 480), [[700, 0, 320], [0, 700, 240], [0, 0, 1]])
PROJECTOR = Camera((640, 480), [[800, 0, 320], [0, 800, 240], [0, 0, 1]])
RIG = Rig(CAMERA, PROJECTOR, RigidTransform.from_rotation_vector([0, 0.2, 0], [-0.2, 0, 0]), unit="m")
GRID = make_color_grid((640, 480), 18, 24)
MIXED = CameraModel(mixing=((0.9, 0.1, 0.0), (0.05, 0.9, 0.05), (0.0, 0.1, 0.9)))
PAINT = Paint((0.9, 0.55, 0.35), blob_size=0.15, contrast=0.4, seed=2)


@pytest.fixture(scope="module")
def pictures():
    scene = Scene([Wall.facing(1.0, [0.1, 0.1, 0], PAINT)], (0.05, 0.05, 0.05))
    shown = [GRID.render(), *(np.full((480, 640, 3), level, np.uint8) for level in (0, 255))]
    return [render(RIG, scene, picture, MIXED).image for picture in shown]


def levels(picture, points):
    column, row = np.rint(points.camera_px).astype(int).T
    return picture[row, column].astype(float)


def rms(error):
    return float(np.sqrt(np.mean(error**2)))


def test_a_white_picture_tells_the_colors(pictures):
    points = decode(GRID, pictures)
    assert len(points) > 200
    assert rms(points.colors - levels(pictures[2], points)) < 3


@pytest.mark.parametrize("given", [1, 2])
def test_without_one_they_are_those_of_the_surface_and_not_of_the_blocks(pictures, given):
    points = decode(GRID, pictures[:given])
    error = points.colors - (levels(pictures[2], points) - levels(pictures[1], points))
    assert rms(error) < 10
    code = np.asarray(GRID.code)[tuple(points.cells.T)]
    by_color = np.array([error[code == index].mean(axis=0) for index in range(len(GRID.colors))])
    assert np.abs(by_color).max() < 8  # no block's own colour shows through


def test_sixteen_bit_pictures_have_the_same_colors(pictures):
    narrow, wide = decode(GRID, pictures), decode(GRID, [picture.astype(np.uint16) * 257 for picture in pictures])
    assert np.abs(np.median(narrow.colors, axis=0) - np.median(wide.colors, axis=0)).max() <= 1
