"""A checker put on a bent wall by the warp is found where a flat one would be."""

import cv2
import numpy as np
import pytest

from retrue.correspondences import Correspondences
from retrue.errors import DegenerateError, InputError
from retrue.files.exchange.warps import warped_picture, write_st_map, write_warp_mesh
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.reconstruction.reconstruct import reconstruct
from retrue.reconstruction.warp import warp
from retrue.rig import Rig
from retrue.simulation.scene import Scene, render
from retrue.simulation.surfaces import Sphere

CAMERA = Camera((640, 480), [[700, 0, 320], [0, 702, 241], [0, 0, 1]], [-0.12, 0.05, 0.001, 0, 0])
PROJECTOR = Camera((800, 600), [[1100, 0, 400], [0, 1100, 420], [0, 0, 1]], [-0.03, 0, 0, 0, 0])
RIG = Rig(CAMERA, PROJECTOR, RigidTransform.from_rotation_vector([0.02, 0.25, 0.01], [-300, 20, 30]), "mm")
BENT = Scene([Sphere(np.array([0.0, 0.0, 2100.0]), 900.0)], ambient=(0.05, 0.05, 0.05))
SQUARE = 60


@pytest.fixture(scope="module")
def cloud():
    seen = render(RIG, BENT, np.full((600, 800, 3), 255, np.uint8), supersample=1)
    v, u = np.mgrid[0:480:6, 0:640:6]
    lit = seen.visible[v, u]
    noise = np.random.default_rng(0).normal(scale=0.1, size=(lit.sum(), 2))
    camera_px, cells = (np.stack(pair, axis=-1)[lit] for pair in ((u, v), (v // 6, u // 6)))
    return reconstruct(RIG, Correspondences(camera_px, seen.projector_px[v, u][lit] + noise, cells=cells))


@pytest.fixture(scope="module")
def checker():
    squares = (np.indices((7, 10)).sum(axis=0) % 2 * 255).astype(np.uint8)
    return np.pad(np.kron(squares, np.ones((SQUARE, SQUARE), np.uint8)), SQUARE, constant_values=255)


def test_a_checker_on_a_bent_wall_lies_within_three_tenths_of_a_pixel(cloud, checker):
    laid = warp(RIG, cloud, checker.shape[::-1])
    shown = warped_picture(laid, checker)
    seen = render(RIG, BENT, np.repeat(shown[..., None], 3, axis=-1)).image
    found, corners = cv2.findChessboardCornersSB(seen[..., 0].copy(), (9, 6), flags=cv2.CALIB_CB_ACCURACY)
    assert found
    left, top, width, height = laid.rectangle
    i, j = np.meshgrid(np.arange(2, 11), np.arange(2, 8))
    asked = np.stack([left + SQUARE * i / checker.shape[1] * width, top + SQUARE * j / checker.shape[0] * height], -1)
    rays = laid.view.unproject(asked.reshape(-1, 2))
    expected = CAMERA.project(np.column_stack([rays, np.ones(len(rays))]))
    off = np.linalg.norm(corners.reshape(-1, 1, 2) - expected, axis=-1).min(axis=1)
    assert len(off) == 54
    assert np.sqrt(np.mean(off**2)) < 0.3


def test_another_viewer_sees_each_pixel_where_the_map_says(cloud):
    eye = RigidTransform.from_rotation_vector([0.0, -0.1, 0.0], [-150.0, 0.0, 0.0])
    laid = warp(RIG, cloud, (4, 3), view_from_camera=eye)
    rows, columns = np.argwhere(np.isfinite(laid.st[..., 0]))[::997].T
    ball, source = BENT.surfaces[0], RIG.projector_from_camera.inverse()
    rays = np.column_stack([PROJECTOR.unproject(np.column_stack([columns, rows])), np.ones(len(rows))]) @ source.R.T
    distance = ball.distance(np.tile(source.t, (len(rays), 1)), rays)
    at = laid.view.project(eye.apply(source.t + distance[:, None] * rays))
    left, top, width, height = laid.rectangle
    s, t = laid.st[rows, columns].T
    off = at - np.column_stack([left + s * width, top + (1 - t) * height])
    assert len(rows) > 100
    assert np.sqrt(np.mean(off**2)) < 0.3


def test_the_st_map_is_what_opencv_reads(cloud, tmp_path):
    laid = warp(RIG, cloud, (4, 3))
    write_st_map(tmp_path / "st.tiff", laid)
    read = cv2.imread(str(tmp_path / "st.tiff"), cv2.IMREAD_UNCHANGED)[..., ::-1]
    shown = np.isfinite(laid.st[..., 0])
    assert read.dtype == np.float32
    assert np.array_equal(read[..., 2] == 1, shown)
    assert np.allclose(read[shown][:, :2], laid.st[shown], atol=1e-7)
    assert not read[~shown].any()
    top = laid.st[np.nanargmax(np.where(shown, laid.st[..., 1], np.nan)) // 800, :, 1]
    assert np.nanmax(top) > 0.98  # t counts from the bottom: the top of the picture is at the top of the wall


def test_the_mesh_has_the_nodes_of_the_map(cloud, tmp_path):
    laid = warp(RIG, cloud, (4, 3))
    write_warp_mesh(tmp_path / "mesh.data", laid, 50)
    kind, size, *nodes = (tmp_path / "mesh.data").read_text().splitlines()
    columns, rows = map(int, size.split())
    assert kind == "2"
    table = np.array([line.split() for line in nodes], float).reshape(rows, columns, 5)
    assert table[0, 0, :2] == pytest.approx([-(799 / 800) * 4 / 3, -(599 / 600)])  # the bottom left pixel's centre
    assert table[-1, 0, 1] == pytest.approx(599 / 600)
    st = laid.st[300, 400]
    assert table[(table[..., 4] > 0) & (np.abs(table[..., 2] - st[0]) < 1e-5)][0, 3] == pytest.approx(st[1], abs=1e-5)
    assert np.array_equal(
        table[..., 4] == 1, np.isfinite(laid.st[[599, *range(550, -1, -50)]][:, [*range(0, 800, 50), 799], 0])
    )


def test_what_makes_no_sense_is_refused(cloud):
    with pytest.raises(InputError, match="rectangle: expected a positive width"):
        warp(RIG, cloud, (4, 3), rectangle=(0, 0, -1, 5))
    with pytest.raises(DegenerateError, match="no part of the rectangle"):
        warp(RIG, cloud, (4, 3), rectangle=(5000, 0, 10, 10))
    with pytest.raises(InputError, match="picture_size"):
        warp(RIG, cloud, (0, 3))
