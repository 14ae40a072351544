"""Colours without the shading of the projector's light, against a paint that is known."""

from dataclasses import replace

import numpy as np
import pytest

from retrue.correspondences import Correspondences
from retrue.errors import InputError
from retrue.reconstruction.options import ReconstructOptions
from retrue.reconstruction.reconstruct import reconstruct
from retrue.reconstruction.surface_grid import cells_from_rim, surface_grid
from tests.reconstruction.scenes import BALL, RIG, WALL, scene

PAINT = np.array([[200, 200, 200], [60, 160, 220], [30, 90, 40]])
ROOM = 0.2


def shaded(cells=True, colors=True, own_light=True):
    """The three things, each of one paint, in the projector's light and the room's."""
    X, camera_px, places, thing = scene(3)
    way = RIG.projector_from_camera.inverse().t - X
    distance = np.linalg.norm(way, axis=1)
    normals = np.zeros_like(X)
    # Numerically, from the surface itself: the ball is exact, flat things by their own points.
    for number in np.unique(thing):
        here = thing == number
        if number == BALL:
            centre = np.array([250.0, 0.0, 1300.0])
            normals[here] = (X[here] - centre) / np.linalg.norm(X[here] - centre, axis=1)[:, None]
        else:
            away = X[here] - X[here].mean(axis=0)
            normals[here] = np.linalg.svd(away, full_matrices=False)[2][2]
    normals *= np.where((normals * X).sum(axis=1) > 0, -1, 1)[:, None]
    light = np.maximum((normals * way).sum(axis=1) / distance, 0) * (1500 / distance) ** 2
    paint = PAINT[thing % 3]
    seen = np.clip(0.6 * paint * (light + ROOM)[:, None], 0, 255)
    points = Correspondences(
        camera_px,
        RIG.projector.project(RIG.projector_from_camera.apply(X)),
        cells=places if cells else None,
        colors=seen.round().astype(np.uint8) if colors else None,
        light=0.6 * (paint * light[:, None]).mean(axis=1) if own_light else None,
    )
    return points, paint, thing, light


def test_the_paint_is_left_when_shading_is_divided_out():
    points, paint, thing, light = shaded()
    cloud = reconstruct(RIG, points, ReconstructOptions(albedo=True, keep_strays=True))
    sure = (light > 0.3) & np.isin(thing, [WALL, BALL])
    found, true = cloud.colors[sure].astype(float), paint[sure].astype(float)
    off = found - true * (found * true).sum() / (true**2).sum()
    plain = points.colors[sure] - true * (points.colors[sure] * true).sum() / (true**2).sum()
    assert np.median(np.abs(off)) < 2.5
    assert np.sqrt(np.mean(off**2)) < 0.4 * np.sqrt(np.mean(plain**2))
    assert np.median(cloud.colors.max(axis=1)) == pytest.approx(np.median(points.colors.max(axis=1)), abs=1)


@pytest.mark.parametrize("lacking", ["cells", "colors"])
def test_without_neighbours_or_colours_there_is_no_albedo(lacking):
    points = shaded(**{lacking: False})[0]
    with pytest.raises(InputError, match="albedo: expected coloured points of a capture with a grid"):
        reconstruct(RIG, points, ReconstructOptions(albedo=True))


@pytest.mark.parametrize("lost", [0.0, 0.3])
def test_what_the_lens_loses_towards_its_corners_is_no_paint(lost):
    points, _, thing, light = shaded()
    half = np.array(RIG.camera.size) / 2
    radius = np.linalg.norm(points.camera_px - RIG.camera.K[:2, 2], axis=1) / np.linalg.norm(half)
    seen = (points.colors * (1 - lost * radius**2)[:, None]).round().astype(np.uint8)
    dimmed = replace(points, colors=seen, light=points.light * (1 - lost * radius**2))
    cloud = reconstruct(RIG, dimmed, ReconstructOptions(albedo=True, keep_strays=True))
    wall = (light > 0.3) & (thing == WALL)
    bright = cloud.colors[wall].max(axis=1).astype(float)
    assert np.std(bright) / np.mean(bright) < 0.02
    outer, inner = (bright[part].mean() for part in (radius[wall] > 0.6, radius[wall] < 0.3))
    assert outer / inner == pytest.approx(1, abs=0.02)


@pytest.mark.parametrize("seed", [5, 17, 20])  # some of 30 that are darkest outwards
def test_a_print_is_no_loss_of_the_lens(seed):
    points, _, thing, light = shaded()
    rng = np.random.default_rng(seed)
    waves, phases = rng.normal(0, 0.02, (5, 2)), rng.uniform(0, 2 * np.pi, 5)
    printed = 0.75 + 0.12 * np.clip(np.round(np.sin(points.camera_px @ waves.T + phases).sum(axis=1)), -2, 2)
    seen = (points.colors * printed[:, None]).round().astype(np.uint8)
    cloud = reconstruct(
        RIG,
        replace(points, colors=seen, light=points.light * printed),
        ReconstructOptions(albedo=True, keep_strays=True),
    )
    wall = (light > 0.3) & (thing == WALL)
    left = cloud.colors[wall].max(axis=1) / printed[wall]
    radius = np.linalg.norm(points.camera_px - RIG.camera.K[:2, 2], axis=1)[wall]
    outer, inner = (np.median(left[part]) for part in (radius > 0.6 * radius.max(), radius < 0.3 * radius.max()))
    assert outer / inner == pytest.approx(1, abs=0.02)


def test_a_print_goes_on_at_the_rim():
    points, _, thing, light = shaded()
    printed = 0.7 + 0.3 * np.sin(points.camera_px @ [0.31, 0.12]) * np.sin(points.camera_px @ [-0.09, 0.27])
    seen = (points.colors * printed[:, None]).round().astype(np.uint8)
    cloud = reconstruct(
        RIG,
        replace(points, colors=seen, light=points.light * printed),
        ReconstructOptions(albedo=True, keep_strays=True),
    )
    cells = cells_from_rim(surface_grid(cloud.points, cloud.cells), len(cloud), 3)
    wall = (light > 0.3) & (thing == WALL)
    left = np.log(cloud.colors.max(axis=1) / printed)
    left -= np.median(left[wall])
    assert np.sqrt(np.mean(left[wall & (cells == 0)] ** 2)) < 0.05  # neighbours differ by 0.15
