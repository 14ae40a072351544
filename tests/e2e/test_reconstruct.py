"""`retrue reconstruct`: every format, and what it says."""

from dataclasses import replace
from importlib.resources import files as resources
from pathlib import Path

import numpy as np
import pytest
import trimesh

from retrue import read_points, read_rig, write_points, write_rig
from retrue.correspondences import Correspondences
from retrue.files.ply import read_ply

from .conftest import Files, Retrue, names

DEMO = Path(str(resources("retrue") / "demo_data"))
SCENE = (DEMO / "scene.jpg", "--pattern", DEMO / "pattern.json")


def test_cloud_mesh_and_surfaces_of_one_picture(retrue: Retrue, tmp_path: Path) -> None:
    pytest.importorskip("OCP.STEPControl", reason="OpenCASCADE is not installed")
    run = retrue(
        *("reconstruct", DEMO / "rig_true.json", *SCENE, "--out", tmp_path / "cloud.ply", "--mesh", tmp_path / "m.stl"),
        *("--cad", tmp_path / "part.step", "--fill-holes", "--normals", "--json"),
    )
    assert run.status == 0, run.err
    found = run.json
    assert found["points"] == len(read_ply(tmp_path / "cloud.ply")[0])
    assert b"property float nx" in (tmp_path / "cloud.ply").read_bytes()[:400]
    mesh = trimesh.load(tmp_path / "m.stl")
    assert len(mesh.faces) == found["faces"]
    assert 1000 < np.median(mesh.vertices[:, 2]) < 4000, "millimetres of a scene some two metres away"
    assert found["dropped_alone"] + found["dropped_in_islands"] < 0.02 * found["correspondences"]
    assert 0.005 < found["point_spacing"] < 0.05
    assert 0 < found["noise"] < 0.001
    assert {"plane", "sphere"} <= {patch["type"] for patch in found["patches"]}
    assert all(patch["met"] and patch["max_error"] <= patch["tolerance"] for patch in found["patches"])
    on_patches = sum(patch["points"] for patch in found["patches"])
    assert on_patches + found["points_on_no_patch"] == found["points"]
    assert names(tmp_path) == ["cloud.ply", "m.stl", "part.step"]


def test_the_text_says_how_many_points_were_left_out_and_fits_80_columns(retrue: Retrue, tmp_path: Path) -> None:
    pytest.importorskip("OCP.STEPControl", reason="OpenCASCADE is not installed")
    arguments = ("--out", "c.ply", "--mesh", "m.glb", "--cad", "p.step", "--fill-holes", "--cad-tolerance", "0.002")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path)
        run = retrue("reconstruct", DEMO / "rig_true.json", *SCENE, *arguments)
    assert run.status == 0, run.err
    for part in ("strays left out", "holes left open", "spacing of points", "tolerance", "sphere", "0.002"):
        assert part in run.out
    assert max(map(len, run.out.splitlines())) <= 80


@pytest.mark.parametrize("cloud", ["cloud.ply", "cloud.obj", "cloud.glb", "CLOUD.PLY"])
@pytest.mark.parametrize("mesh", ["mesh.ply", "mesh.obj", "mesh.stl", "mesh.glb"])
def test_each_ending_reads_back(retrue: Retrue, files: Files, cloud: str, mesh: str) -> None:
    run = retrue(
        "reconstruct", files.rig, files.points, "--out", files.folder / cloud, "--mesh", files.folder / mesh, "--json"
    )
    assert run.status == 0, run.err
    ending = cloud.lower()[-3:]
    points = trimesh.load(files.folder / cloud, file_type=ending)
    assert len(points.dump()[0].vertices if ending == "glb" else points.vertices) == run.json["points"]
    scene = trimesh.load_scene(files.folder / mesh)
    assert len(scene.to_mesh().faces) == run.json["faces"]


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (("--out", "c.las"), ("c.las", "expected a cloud that ends in .ply, .pcd, .xyz, .e57, .npz, .obj, .glb")),
        (("--out", "c.stl"), ("c.stl", "expected a cloud that ends in")),
        (("--out", "c.ply", "--mesh", "m.fbx"), ("m.fbx", "expected a mesh that ends in .ply, .obj, .stl, .glb")),
        (("--out", "c.ply", "--cad", "p.iges"), ("p.iges", "expected a CAD file that ends in .step or .stp")),
        (("--out", "c.ply", "--cad", "p.step"), ("cad: expected points of a capture with a grid",)),
        (("--out", "c.ply", "--normals"), ("normals: expected points of a capture with a grid",)),
        (("--out", "c.ply", "--fill-holes"), ("fill_holes: expected points of a capture with a grid",)),
    ],
)
def test_what_cannot_be_written_is_said_and_nothing_is_written(
    retrue: Retrue, files: Files, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], parts: tuple[str, ...]
) -> None:
    if "p.step" in arguments:
        pytest.importorskip("OCP.STEPControl", reason="OpenCASCADE is not installed")
    monkeypatch.chdir(files.folder)
    before = names(files.folder)
    retrue("reconstruct", files.rig, files.points, *arguments).require_complaint(*parts)
    assert names(files.folder) == before


def test_a_unit_without_a_length_stays_in_formats_without_a_unit(retrue: Retrue, files: Files) -> None:
    write_rig(files.rig, replace(read_rig(files.rig), unit="square"))
    to = ("--out", files.folder / "cloud.ply", "--mesh")
    assert retrue("reconstruct", files.rig, files.points, *to, files.folder / "mesh.obj").status == 0
    retrue("reconstruct", files.rig, files.points, *to, files.folder / "mesh.glb").require_complaint("'square'")


def test_of_no_points_nothing_is_written(retrue: Retrue, files: Files) -> None:
    write_points(files.points, Correspondences(np.empty((0, 2)), np.empty((0, 2))))
    run = retrue("reconstruct", files.rig, files.points, "--out", files.folder / "cloud.ply", "--anyway")
    assert run.status == 1
    assert "nothing was written: expected at least 12 correspondences, found 0" in run.out
    assert not (files.folder / "cloud.ply").exists()


def test_columns_alone_make_a_cloud_and_say_that_nothing_checks_the_rig(retrue: Retrue, files: Files) -> None:
    points, to = read_points(files.points), ("--out", files.folder / "cloud.ply", "--json")
    write_points(files.points, replace(points, projector_px=points.projector_px * [1, np.nan]))
    run = retrue("reconstruct", files.rig, files.points, *to)
    assert run.status == 0
    assert run.json["verdict"] == "unknown"
    assert run.json["cause"] == "OneCoordinate"
    in_the_picture = read_rig(files.rig).projector.contains(points.projector_px)
    assert run.json["points"] == pytest.approx(
        np.count_nonzero(in_the_picture), abs=3
    )  # as near the edge as noise has it


@pytest.mark.parametrize("rows", [1, 2])
def test_too_few_points_for_a_mesh(retrue: Retrue, files: Files, rows: int) -> None:
    write_points(files.points, Correspondences(np.full((rows, 2), 600.0), np.full((rows, 2), 500.0)))
    to = ("--out", files.folder / "cloud.ply", "--mesh", files.folder / "mesh.ply")
    retrue("reconstruct", files.rig, files.points, *to, "--anyway").require_complaint("points")
