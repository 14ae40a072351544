import contextlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from retrue.errors import FileError
from retrue.files.model_reader import read_model
from retrue.files.models import CLOUD_ENDINGS, MESH_ENDINGS, write_cloud, write_mesh
from retrue.reconstruction.cloud import Cloud, Mesh

POINTS = np.array([[0.5, -1.25, 300.0], [100.0, 200.0, 400.0], [0.0, 0.0, 550.0], [50.0, -80.0, 420.0]])
COLORS = np.array([[255, 0, 1], [2, 3, 4], [5, 6, 254], [9, 8, 7]], dtype=np.uint8)
FACES = np.array([[0, 2, 1], [0, 1, 3]])
SCALES = {"mm": 1.0, "m": 1e-3, "cm": 0.1}


@pytest.mark.parametrize("ending", CLOUD_ENDINGS)
def test_a_cloud_comes_back_in_the_unit_that_the_file_names(tmp_path, ending):
    write_cloud(tmp_path / f"cloud{ending}", Cloud(POINTS / 10, COLORS, np.zeros((4, 2)), "cm"))
    back = read_model(tmp_path / f"cloud{ending}", "furlong")
    assert isinstance(back, Cloud)
    assert back.unit == ("m" if ending == ".glb" else "cm")
    assert np.allclose(back.points / SCALES[back.unit], POINTS, atol=1e-3)
    assert np.array_equal(back.colors, COLORS)


@pytest.mark.parametrize("ending", MESH_ENDINGS)
def test_a_mesh_comes_back(tmp_path, ending):
    write_mesh(tmp_path / f"mesh{ending}", Mesh(POINTS, COLORS, FACES, "mm"))
    back = read_model(tmp_path / f"mesh{ending}", "furlong")
    assert isinstance(back, Mesh)
    assert back.unit == ("m" if ending == ".glb" else "mm")
    corners = back.points[back.faces] / SCALES[back.unit]
    expected = POINTS[FACES]
    assert np.allclose(sorted(corners.reshape(-1, 3).tolist()), sorted(expected.reshape(-1, 3).tolist()), atol=1e-3)


def test_a_file_without_a_unit_is_in_the_unit_that_is_given(tmp_path):
    header = [
        "ply",
        "format ascii 1.0",
        "element vertex 1",
        *(f"property float {axis}" for axis in "xyz"),
        "end_header",
    ]
    (tmp_path / "cloud.ply").write_text("\n".join([*header, "1 2 3", ""]))
    back = read_model(tmp_path / "cloud.ply", "furlong")
    assert back.unit == "furlong"
    assert back.points.tolist() == [[1.0, 2.0, 3.0]]


@pytest.mark.parametrize("ending", MESH_ENDINGS)
@settings(max_examples=25, deadline=None)
@given(content=st.binary(max_size=200))
def test_any_bytes_are_a_model_or_a_file_error(tmp_path_factory, ending, content):
    path = tmp_path_factory.mktemp("model") / f"model{ending}"
    for start in (b"", b"ply\nformat binary_little_endian 1.0\n", b"glTF\x02\x00\x00\x00", b"v 1 2 3\n"):
        path.write_bytes(start + content)
        with contextlib.suppress(FileError):
            read_model(path, "mm")


@pytest.mark.parametrize("ending", MESH_ENDINGS)
def test_nothing_is_an_error(tmp_path, ending):
    (tmp_path / f"empty{ending}").write_bytes(b"")
    with pytest.raises(FileError):
        read_model(tmp_path / f"empty{ending}", "mm")


def test_another_ending_is_an_error(tmp_path):
    with pytest.raises(FileError, match="expected a cloud or mesh that ends in"):
        read_model(tmp_path / "scene.fbx", "mm")
