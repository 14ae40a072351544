"""Whole projector pixels: noticed, and no steps left of them."""

from __future__ import annotations

import numpy as np

from retrue.correspondences import Correspondences
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.reconstruction.mesh import make_mesh
from retrue.reconstruction.quantised import between_readings, quantisation_px
from retrue.reconstruction.reconstruct import reconstruct
from retrue.rig import Rig

CAMERA = Camera((320, 240), [[400.0, 0, 160], [0, 400, 120], [0, 0, 1]])
PROJECTOR = Camera((200, 160), [[180.0, 0, 100], [0, 180, 80], [0, 0, 1]], [-0.05, 0.01, 0, 0, 0])
RIG = Rig(CAMERA, PROJECTOR, RigidTransform.from_rotation_vector([0, 0.15, 0.02], [-150.0, 10, 20]), "mm")


def scene(*, step: float = 1.0) -> tuple[Correspondences, np.ndarray]:
    """A curved wall with a box before it, read to whole steps; and the true points."""
    x, y = np.meshgrid(np.arange(30, 290.0), np.arange(30, 210.0))
    camera_px = np.stack([x.ravel(), y.ravel()], axis=-1)
    depth = 900 + 0.002 * (camera_px[:, 0] - 160) ** 2 + 0.3 * camera_px[:, 1]
    depth[(np.abs(camera_px - [150, 120]) < 30).all(axis=1)] = 700
    points = np.column_stack([CAMERA.unproject(camera_px), np.ones(len(camera_px))]) * depth[:, None]
    projector_px = PROJECTOR.project(RIG.projector_from_camera.apply(points))
    projector_px = np.round(projector_px / step) * step if step else projector_px
    return Correspondences(camera_px, projector_px, cells=camera_px[:, ::-1].astype(int)), points


def test_a_surface_of_whole_pixels_is_whole() -> None:
    read, truth = scene()
    fine, _ = scene(step=0.0)
    cloud, best = reconstruct(RIG, read), reconstruct(RIG, fine)
    assert cloud.card["quantised_px"] == [1.0, 1.0]
    assert "quantised_px" not in best.card
    assert len(cloud) > 0.97 * len(best)
    assert len(make_mesh(cloud).faces) > 0.95 * len(make_mesh(best).faces)
    rows = ((cloud.camera_px[:, 1] - 30) * 260 + cloud.camera_px[:, 0] - 30).astype(int)
    error = np.abs(cloud.points[:, 2] - truth[rows, 2])
    assert np.median(error) < 2.0  # half a pixel is 6 mm in depth there


def test_every_reading_is_kept_to() -> None:
    read, _ = scene(step=2.0)
    assert quantisation_px(read) == (2.0, 2.0)
    between = between_readings(read, (2.0, 2.0))
    assert np.abs(between - read.projector_px).max() <= 1.0
    assert np.abs(between - read.projector_px).mean() > 0.3


def test_places_of_a_pattern_are_no_rounded_readings() -> None:
    row, column = (index.ravel() for index in np.mgrid[0:40, 0:51])
    cells = np.stack([row, column], axis=-1)
    blocks = Correspondences(cells[:, ::-1] * 17.3 + 5, cells[:, ::-1] * 19 + [35.5, 12.5], cells=cells)
    assert quantisation_px(blocks) == (0.0, 0.0)
    few = Correspondences(cells[:30, ::-1] * 1.0, cells[:30, ::-1] * 1.0)
    assert quantisation_px(few) == (0.0, 0.0)
    assert quantisation_px(few.select(np.arange(0))) == (0.0, 0.0)


def test_one_coordinate_of_whole_pixels() -> None:
    read, _ = scene()
    columns = read.projector_px.copy()
    columns[:, 1] = np.nan
    one = Correspondences(read.camera_px, columns, cells=read.cells)
    assert quantisation_px(one) == (1.0, 0.0)
    assert reconstruct(RIG, one).card["quantised_px"] == [1.0, 0.0]
