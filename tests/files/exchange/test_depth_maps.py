import json

import cv2
import numpy as np
import pytest

from retrue.errors import FileError, InputError
from retrue.files.exchange.depth_maps import write_depth_map
from retrue.reconstruction.depth_map import depth_map
from tests.files.exchange.rigs import CAMERA, NORMAL, wall

DEPTH = depth_map(wall(), CAMERA)


def plane_depth(camera):
    y, x = np.mgrid[: camera.size[1], : camera.size[0]]
    rays = camera.unproject(np.stack([x, y], axis=-1))
    return 1 / (rays @ NORMAL[:2] + NORMAL[2])


def test_depth_on_a_plane_is_that_of_each_pixels_own_ray():
    there = np.isfinite(DEPTH)
    assert np.allclose(DEPTH[there], plane_depth(CAMERA)[there], rtol=1e-12)
    inside = np.zeros(DEPTH.shape, bool)
    inside[4:41, 6:55] = True  # from the first to the last points of the wall
    assert there[inside].all()
    assert there.sum() == pytest.approx(inside.sum(), rel=0.02)  # the sides of faces bend by less than a pixel


def test_tiff_has_the_rigs_unit_and_nan(tmp_path):
    write_depth_map(tmp_path / "depth.tiff", DEPTH, CAMERA, "mm")
    read = cv2.imread(str(tmp_path / "depth.tiff"), cv2.IMREAD_UNCHANGED)
    assert read.dtype == np.float32
    assert np.array_equal(read, DEPTH.astype(np.float32), equal_nan=True)


def test_png_has_millimetres_and_zero(tmp_path):
    beside = write_depth_map(tmp_path / "depth.png", DEPTH, CAMERA, "mm")
    read = cv2.imread(str(tmp_path / "depth.png"), cv2.IMREAD_UNCHANGED)
    assert read.dtype == np.uint16
    assert np.array_equal(read, np.round(np.nan_to_num(DEPTH)))
    said = json.loads(beside.read_text())
    assert said["levels_per_metre"] == 1000
    assert said["camera"]["distortion"] == list(CAMERA.distortion)
    assert np.array_equal(np.reshape(said["intrinsic_matrix"], (3, 3)).T, CAMERA.K)


def test_what_16_bits_cannot_hold_is_refused(tmp_path):
    with pytest.raises(FileError, match=r"at most 65535 levels, found 7\d{5}: .*write \.tiff"):
        write_depth_map(tmp_path / "depth.png", DEPTH * 600, CAMERA, "mm")
    with pytest.raises(FileError, match="depth map that ends in"):
        write_depth_map(tmp_path / "depth.exr", DEPTH, CAMERA, "mm")
    with pytest.raises(InputError, match="expected shape 48 x 64, found 3 x 3"):
        write_depth_map(tmp_path / "depth.png", np.ones((3, 3)), CAMERA, "mm")
    assert not list(tmp_path.iterdir())
