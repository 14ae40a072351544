"""Each format is read back by what its own users read it with."""

import numpy as np
import pye57
import pytest
import trimesh

from retrue.errors import FileError, InputError
from retrue.files.exchange.clouds import make_cloud
from retrue.files.models import require_cloud_ending, write_cloud
from retrue.reconstruction.cloud import Cloud
from tests.files.exchange.rigs import wall

CLOUD = wall()
FLOAT32 = 2**-23


def test_e57_is_in_metres_and_keeps_colours(tmp_path):
    write_cloud(tmp_path / "cloud.e57", CLOUD)
    scan = pye57.E57(str(tmp_path / "cloud.e57")).read_scan(0, colors=True, ignore_missing_fields=True)
    points = np.column_stack([scan[f"cartesian{axis}"] for axis in "XYZ"])
    colors = np.column_stack([scan[f"color{name}"] for name in ("Red", "Green", "Blue")])
    assert np.allclose(points, CLOUD.points / 1000, rtol=FLOAT32)
    assert np.array_equal(colors, CLOUD.colors)


def test_npz_holds_every_array_exactly(tmp_path):
    write_cloud(tmp_path / "cloud.npz", CLOUD)
    with np.load(tmp_path / "cloud.npz", allow_pickle=False) as archive:
        assert sorted(archive) == ["camera_px", "cells", "colors", "normals", "points", "unit"]
        assert archive["unit"] == "mm"
        for name in ("points", "colors", "camera_px", "cells", "normals"):
            assert np.array_equal(archive[name], getattr(CLOUD, name))


def test_xyz_is_a_point_a_line(tmp_path):
    write_cloud(tmp_path / "cloud.xyz", CLOUD)
    table = np.loadtxt(tmp_path / "cloud.xyz")
    assert np.allclose(table[:, :3], CLOUD.points, rtol=1e-8, atol=1e-8)
    assert np.array_equal(table[:, 3:], CLOUD.colors)
    assert np.allclose(trimesh.load(tmp_path / "cloud.xyz").vertices, CLOUD.points, rtol=1e-8, atol=1e-8)


def test_pcd_has_the_fields_that_its_header_says(tmp_path):
    write_cloud(tmp_path / "cloud.pcd", CLOUD)
    header, _, body = (tmp_path / "cloud.pcd").read_bytes().partition(b"DATA binary\n")
    words = dict(line.split(" ", 1) for line in header.decode().splitlines() if not line.startswith("#"))
    assert words["FIELDS"] == "x y z rgb normal_x normal_y normal_z"
    assert words["POINTS"] == words["WIDTH"] == str(len(CLOUD))
    assert b"unit mm" in header.splitlines()[0]
    table = np.frombuffer(body, "<f4").reshape(len(CLOUD), 7)
    assert np.allclose(table[:, :3], CLOUD.points, rtol=FLOAT32)
    assert np.allclose(table[:, 4:], CLOUD.normals, rtol=FLOAT32)
    packed = np.frombuffer(body, "<u4").reshape(len(CLOUD), 7)[:, 3]
    assert np.array_equal(np.stack([packed >> 16, packed >> 8 & 255, packed & 255], axis=1), CLOUD.colors)


def test_e57_refuses_a_cloud_without_points(tmp_path):
    with pytest.raises(InputError, match="E57: expected points, found none"):
        write_cloud(tmp_path / "cloud.e57", CLOUD.select(np.zeros(len(CLOUD), bool)))
    assert not (tmp_path / "cloud.e57").exists()


def test_e57_refuses_a_unit_of_unknown_length(tmp_path):
    cloud = Cloud(CLOUD.points, CLOUD.colors, CLOUD.camera_px, "cubit")
    with pytest.raises(InputError, match="cubit"):
        write_cloud(tmp_path / "cloud.e57", cloud)
    with pytest.raises(InputError, match="cubit"):
        require_cloud_ending(tmp_path / "cloud.e57", "cubit")
    assert not list(tmp_path.iterdir())


def test_another_ending_is_refused_with_those_that_there_are(tmp_path):
    with pytest.raises(FileError, match=r"\.ply, \.pcd, \.xyz, \.e57, \.npz.*found \.las"):
        write_cloud(tmp_path / "cloud.las", CLOUD)


def test_arrays_of_other_libraries_become_a_cloud_and_go_back():
    made = make_cloud(CLOUD.points, CLOUD.colors / 255, CLOUD.normals, unit="mm")
    assert np.array_equal(made.colors, CLOUD.colors)
    assert np.array_equal(made.normals, CLOUD.normals)
    other = trimesh.PointCloud(made.points, made.colors)
    back = make_cloud(other.vertices, other.colors, [], unit="mm")  # trimesh's colours have an opacity too
    assert np.array_equal(back.points, CLOUD.points)
    assert np.array_equal(back.colors, CLOUD.colors)
    assert back.normals is None


@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        (([[0, 0]],), "points: expected shape N x 3"),
        (([[0, 0, np.nan]],), "points: expected finite numbers"),
        (([[0, 0, 1]], [[1, 2]]), "colors: expected 1 rows of three or more, found 1 x 2"),
        (([[0, 0, 1]], None, [[0, 1]]), "normals: expected shape 1 x 3, found 1 x 2"),
    ],
)
def test_arrays_that_are_no_cloud_are_refused(arrays, said):
    with pytest.raises(InputError, match=said):
        make_cloud(*arrays, unit="mm")
