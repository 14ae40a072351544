import struct

import numpy as np
import pytest

from retrue.errors import FileError
from retrue.files.ply import read_ply, write_cloud, write_mesh
from retrue.reconstruction.cloud import Cloud, Mesh

POINTS = np.array([[0.5, -1.25, 3.0], [1.0, 2.0, 4.0], [0.0, 0.0, 5.5]])
COLORS = np.array([[255, 0, 1], [2, 3, 4], [5, 6, 254]], dtype=np.uint8)
FACES = np.array([[0, 2, 1]])


def test_the_bytes_of_a_cloud_are_those_of_the_contract(tmp_path):
    write_cloud(tmp_path / "cloud.ply", Cloud(POINTS, COLORS, np.zeros((3, 2)), "mm"))
    header, _, body = (tmp_path / "cloud.ply").read_bytes().partition(b"end_header\n")
    assert header.decode().splitlines() == [
        "ply",
        "format binary_little_endian 1.0",
        "comment unit mm",
        "element vertex 3",
        "property float x",
        "property float y",
        "property float z",
        "property uchar red",
        "property uchar green",
        "property uchar blue",
    ]
    assert len(body) == 3 * 15
    assert struct.unpack("<fffBBB", body[:15]) == (0.5, -1.25, 3.0, 255, 0, 1)


def test_a_cloud_comes_back(tmp_path):
    write_cloud(tmp_path / "cloud.ply", Cloud(POINTS, COLORS, np.zeros((3, 2)), "mm"))
    points, colors, faces = read_ply(tmp_path / "cloud.ply")
    assert np.array_equal(points, POINTS)
    assert np.array_equal(colors, COLORS)
    assert faces.shape == (0, 3)


def test_a_mesh_comes_back(tmp_path):
    write_mesh(tmp_path / "mesh.ply", Mesh(POINTS, COLORS, FACES, "m"))
    content = (tmp_path / "mesh.ply").read_bytes()
    assert b"element face 1\nproperty list uchar int vertex_indices\n" in content
    assert struct.unpack("<Biii", content[-13:]) == (3, 0, 2, 1)
    points, colors, faces = read_ply(tmp_path / "mesh.ply")
    assert np.array_equal(points, POINTS)
    assert np.array_equal(colors, COLORS)
    assert np.array_equal(faces, FACES)


def test_a_unit_cannot_break_the_header(tmp_path):
    write_cloud(tmp_path / "cloud.ply", Cloud(POINTS, COLORS, np.zeros((3, 2)), "mm\nelement face 9"))
    assert len(read_ply(tmp_path / "cloud.ply")[0]) == 3


@pytest.mark.parametrize("content", [b"", b"ply\n", b"solid cube\n", b"ply\nformat ascii 1.0\nend_header\n"])
def test_what_is_no_such_ply(tmp_path, content):
    (tmp_path / "cloud.ply").write_bytes(content)
    with pytest.raises(FileError, match="expected a binary little-endian PLY"):
        read_ply(tmp_path / "cloud.ply")


def test_a_file_cut_off_is_named(tmp_path):
    write_cloud(tmp_path / "cloud.ply", Cloud(POINTS, COLORS, np.zeros((3, 2)), "mm"))
    content = (tmp_path / "cloud.ply").read_bytes()
    (tmp_path / "cloud.ply").write_bytes(content[:-1])
    with pytest.raises(FileError, match="is it cut off"):
        read_ply(tmp_path / "cloud.ply")
