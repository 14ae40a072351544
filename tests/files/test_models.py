"""Each format, read back by another library."""

import contextlib

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from retrue.errors import FileError, InputError
from retrue.files.models import (
    CLOUD_ENDINGS,
    MESH_ENDINGS,
    read_model,
    require_cloud_ending,
    require_mesh_ending,
    write_cloud,
    write_mesh,
)
from retrue.files.ply import read_ply
from retrue.reconstruction.cloud import Cloud, Mesh

POINTS = np.array([[0.5, -1.25, 300.0], [100.0, 200.0, 400.0], [0.0, 0.0, 550.0], [50.0, -80.0, 420.0]])
COLORS = np.array([[255, 0, 1], [2, 3, 4], [5, 6, 254], [9, 8, 7]], dtype=np.uint8)
FACES = np.array([[0, 2, 1], [0, 1, 3]])


def mesh_in(unit):
    return Mesh(POINTS, COLORS, FACES, unit)


def cloud_in(unit, normals=None):
    return Cloud(POINTS, COLORS, np.zeros((len(POINTS), 2)), unit, normals=normals)


def triangles(mesh):
    return np.sort(np.asarray(mesh.triangles).reshape(-1, 9), axis=0)


@pytest.mark.parametrize("ending", [".ply", ".obj"])
def test_ply_and_obj_keep_unit_frame_and_colours(tmp_path, ending):
    path = tmp_path / f"mesh{ending}"
    write_mesh(path, mesh_in("cubit"))
    back = trimesh.load(path, process=False)
    assert np.allclose(back.vertices, POINTS, atol=1e-4)
    assert np.array_equal(back.faces, FACES)
    assert np.array_equal(back.visual.vertex_colors[:, :3], COLORS)
    assert "cubit" in path.read_bytes()[:200].decode(errors="replace")


@pytest.mark.parametrize(("unit", "mm"), [("mm", 1.0), ("cm", 10.0), ("m", 1000.0), ("in", 25.4)])
def test_stl_is_in_millimetres(tmp_path, unit, mm):
    write_mesh(tmp_path / "mesh.stl", mesh_in(unit))
    back = trimesh.load(tmp_path / "mesh.stl", process=False)
    assert np.allclose(triangles(back), triangles(trimesh.Trimesh(POINTS * mm, FACES, process=False)), rtol=1e-6)


@pytest.mark.parametrize(
    "write", [lambda path: write_mesh(path, mesh_in("mm")), lambda p: write_cloud(p, cloud_in("mm"))]
)
def test_glb_is_in_metres_with_y_up(tmp_path, write):
    write(tmp_path / "model.glb")
    scene = trimesh.load(tmp_path / "model.glb", process=False)
    (node,) = scene.graph.nodes_geometry
    pose, name = scene.graph[node]
    model = scene.geometry[name]
    assert np.allclose(model.vertices, POINTS / 1000, atol=1e-7)
    colors = model.visual.vertex_colors if hasattr(model, "visual") else model.colors
    assert np.array_equal(np.asarray(colors)[:, :3], COLORS)
    assert np.array_equal(pose, np.diag([1, -1, -1, 1]))


def test_a_cloud_with_normals_comes_back(tmp_path):
    normals = np.tile([0.0, 0.6, -0.8], (len(POINTS), 1))
    write_cloud(tmp_path / "cloud.ply", cloud_in("mm", normals))
    points, colors, _ = read_ply(tmp_path / "cloud.ply")
    assert np.array_equal(points, POINTS)
    assert np.array_equal(colors, COLORS)
    raw = trimesh.load(tmp_path / "cloud.ply").metadata["_ply_raw"]["vertex"]["data"]
    assert np.allclose([list(row)[3:6] for row in raw], normals)


@pytest.mark.parametrize("ending", [".stl", ".glb"])
def test_a_unit_that_nobody_knows_cannot_be_converted(tmp_path, ending):
    with pytest.raises(InputError, match="found 'square', whose length is not known"):
        require_mesh_ending(tmp_path / f"mesh{ending}", "square")
    with pytest.raises(InputError, match="whose length is not known"):
        write_mesh(tmp_path / f"mesh{ending}", mesh_in("square"))
    assert not list(tmp_path.iterdir())


def test_endings_that_nobody_writes_are_refused(tmp_path):
    for path in ("mesh.fbx", "mesh"):
        with pytest.raises(FileError, match=r"expected a mesh that ends in \.ply, \.obj, \.stl, \.glb, found"):
            require_mesh_ending(tmp_path / path, "mm")
    with pytest.raises(FileError, match=r"expected a cloud that ends in \.ply, .*\.glb, found \.stl"):
        require_cloud_ending(tmp_path / "cloud.stl", "mm")


SCALES = {"mm": 1.0, "m": 1e-3, "cm": 0.1}


@pytest.mark.parametrize("ending", [ending for ending in CLOUD_ENDINGS if ending in MESH_ENDINGS])
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


def test_vertices_of_two_numbers_are_no_points_in_space(tmp_path):
    path = tmp_path / "flat.obj"
    path.write_text("v 1 2\nv 3 4\nv 5 6\nf 1 2 3\n", encoding="ascii")
    with pytest.raises(FileError, match=r"flat\.obj: expected vertices of three numbers, found 2"):
        read_model(path, "m")
