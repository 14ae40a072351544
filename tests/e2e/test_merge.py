"""`retrue merge`, from files to files."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from retrue import write_cloud
from retrue.files.models import read_model
from tests.merging.objects import turntable

from .conftest import Retrue, names


@pytest.fixture(scope="module")
def views(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("views")
    clouds, _ = turntable(12)
    paths = [folder / f"view_{number}.ply" for number in (0, 1, 2, 6)]
    for path, cloud in zip(paths, (clouds[0], clouds[1], clouds[2], clouds[6]), strict=True):
        write_cloud(path, cloud)
    return paths


def test_views_become_an_object(retrue: Retrue, views: list[Path], tmp_path: Path) -> None:
    run = retrue("merge", *views[:3], "--out", tmp_path / "o.ply", "--mesh", tmp_path / "o.stl", "--json")
    assert run.status == 0, run.err
    assert run.json["verdict"] == "merged"
    assert run.json["closure_sigma"] < 2
    assert [view["left_out"] for view in run.json["views"]] == [None] * 3
    assert len(read_model(tmp_path / "o.ply", "m").points) == run.json["points"]
    mesh = trimesh.load(tmp_path / "o.stl")
    assert len(mesh.faces) == run.json["faces"]
    assert np.ptp(mesh.vertices, axis=0).max() > 80
    run = retrue("merge", *views[:3], "--out", tmp_path / "o.ply")
    assert "loops close within" in run.out
    assert max(map(len, run.out.splitlines()[1:])) <= 80


def test_what_does_not_overlap_is_refused_and_nothing_is_written(
    retrue: Retrue, views: list[Path], tmp_path: Path
) -> None:
    run = retrue("merge", views[0], views[3], "--out", tmp_path / "o.ply", "--json")
    assert run.status == 1
    assert (run.json["verdict"], run.json["cause"], run.json["out"]) == ("refused", "NothingInCommon", None)
    assert names(tmp_path) == []


def test_mistakes_are_one_line(retrue: Retrue, views: list[Path], tmp_path: Path) -> None:
    out = ("--out", tmp_path / "o.ply")
    retrue("merge", views[0], *out).require_complaint("expected two CLOUDs or more, found 1")
    retrue("merge", *views[:2], "--out", tmp_path / "o.doc").require_complaint("o.doc", "ends in")
    retrue("merge", *views[:2], *out, "--turntable", "7").require_complaint("turntable", "found 2")
    retrue("merge", views[0], tmp_path / "none.ply", *out).require_complaint("none.ply", "cannot be read")
    assert names(tmp_path) == []
