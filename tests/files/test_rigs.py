"""Our rig file: every bit back, every fault named."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from retrue.errors import FileError, InputError, RetrueError
from retrue.files.rigs import read_rig, write_rig
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.rig import Rig


@pytest.fixture
def rig() -> Rig:
    return Rig(
        Camera((1280, 1024), [[4786 / 3, 0.1, 639.7], [0, 1595.1, 511.2], [0, 0, 1]], [-0.1 / 3, 0.2, 1e-5, 0, 0]),
        Camera((1024, 768), [[2300.5, 0, 500 / 7], [0, 2301.5, 1010.25], [0, 0, 1]]),
        RigidTransform.from_rotation_vector([0.1, -0.2, 0.3], [1 / 3, -200.0, 1e-9]),
        "mm",
        {"rms_px": 0.1 + 0.2, "views": ["a", "b"]},
    )


def document(rig: Rig, tmp_path: Path) -> dict[str, Any]:
    write_rig(tmp_path / "good.json", rig)
    return json.loads((tmp_path / "good.json").read_text())


def same(a: Rig, b: Rig) -> bool:
    pairs = [(a.camera, b.camera), (a.projector, b.projector)]
    intrinsics = all(
        x.size == y.size and np.array_equal(x.K, y.K) and np.array_equal(x.distortion, y.distortion) for x, y in pairs
    )
    pose = (a.projector_from_camera, b.projector_from_camera)
    return intrinsics and np.array_equal(pose[0].R, pose[1].R) and np.array_equal(pose[0].t, pose[1].t)


def test_round_trip_to_the_last_bit(rig: Rig, tmp_path: Path) -> None:
    write_rig(tmp_path / "rig.json", rig)
    back = read_rig(tmp_path / "rig.json")
    assert same(rig, back)
    assert back.unit == "mm"
    assert back.evidence == {"rms_px": 0.1 + 0.2, "views": ["a", "b"]}
    first = (tmp_path / "rig.json").read_bytes()
    write_rig(tmp_path / "rig.json", back)
    assert (tmp_path / "rig.json").read_bytes() == first


def test_evidence_may_be_absent(rig: Rig, tmp_path: Path) -> None:
    members = document(rig, tmp_path)
    del members["evidence"]
    (tmp_path / "rig.json").write_text(json.dumps(members))
    assert read_rig(tmp_path / "rig.json").evidence == {}


def test_evidence_that_is_no_json_is_refused_and_the_old_file_stays(rig: Rig, tmp_path: Path) -> None:
    write_rig(tmp_path / "rig.json", rig)
    before = (tmp_path / "rig.json").read_bytes()
    bad = Rig(rig.camera, rig.projector, rig.projector_from_camera, "mm", {"rms_px": float("nan")})
    with pytest.raises(InputError, match="evidence"):
        write_rig(tmp_path / "rig.json", bad)
    assert (tmp_path / "rig.json").read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["rig.json"]


@pytest.mark.parametrize("key", ["unit", "camera", "projector", "projector_from_camera", "version"])
def test_a_missing_key_is_named(rig: Rig, tmp_path: Path, key: str) -> None:
    members = document(rig, tmp_path)
    del members[key]
    (tmp_path / "rig.json").write_text(json.dumps(members))
    with pytest.raises(FileError, match=rf"rig\.json: {key}: expected"):
        read_rig(tmp_path / "rig.json")


FAULTS: list[tuple[str, str, Any, str]] = [
    ("camera", "K", [[1, 0], [0, 1]], "camera.K: expected shape 3 x 3, found 2 x 2"),
    ("camera", "K", [[0, 0, 1], [0, 1, 1], [0, 0, 1]], "camera.K: expected positive focal lengths"),
    ("projector", "K", [[1, 0, 0], [0, 1, 0], [0, 1, 1]], "projector.K: expected zeros below"),
    ("camera", "K", [[1, 0, 0], [0, 1], [0, 1, 1]], "camera.K: expected rows of equal length"),
    ("camera", "K", [["1", 0, 0], [0, 1, 0], [0, 0, 1]], "camera.K: expected a list of numbers"),
    ("camera", "K", [[True, 0, 0], [0, 1, 0], [0, 0, 1]], "camera.K: expected a list of numbers"),
    ("camera", "K", [[10**400, 0, 0], [0, 1, 0], [0, 0, 1]], "camera.K: expected rows of equal length of finite"),
    ("camera", "K", None, "camera.K: expected a list of numbers, found null"),
    ("camera", "size", [640.5, 480], "camera.size: expected width and height"),
    ("camera", "size", [640, 0], "camera.size: expected width and height"),
    ("projector", "size", 5, "projector.size: expected a list of numbers"),
    ("projector", "distortion", [1, 2, 3], "projector.distortion: expected"),
    ("projector_from_camera", "R", [[1, 0, 0], [0, 1, 0], [0, 0, 2]], "projector_from_camera: rotation R"),
    ("projector_from_camera", "R", [[1, 0, 0], [0, 1, 0], [0, 0, -1]], "projector_from_camera: rotation R"),
    ("projector_from_camera", "t", [1, 2], "projector_from_camera: translation t"),
]


@pytest.mark.parametrize(("device", "key", "value", "message"), FAULTS)
def test_a_bad_value_is_named(rig: Rig, tmp_path: Path, device: str, key: str, value: Any, message: str) -> None:
    members = document(rig, tmp_path)
    members[device][key] = value
    (tmp_path / "rig.json").write_text(json.dumps(members))
    with pytest.raises(FileError) as caught:
        read_rig(tmp_path / "rig.json")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"format": "retrue-rig", "version": NaN}', "NaN, which is no number"),
        ('{"format": "retrue-rig", "format": "x"}', "'format' twice"),
        ('{"a":' * 100_000, "expected JSON"),
        ("[1]", "expected a rig"),
        ("", "expected"),
        ('{"format": "retrue-rig", "version": 2}', "version: expected 1, found 2"),
        ('{"format": "retrue-rig", "version": true}', "version: expected 1"),
    ],
)
def test_what_is_no_rig_is_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "rig.json").write_text(text)
    with pytest.raises(FileError, match=message):
        read_rig(tmp_path / "rig.json")


def test_an_infinite_number_is_refused(rig: Rig, tmp_path: Path) -> None:
    members = document(rig, tmp_path)
    members["projector_from_camera"]["t"] = [1, 2, 12345]
    (tmp_path / "rig.json").write_text(json.dumps(members).replace("12345", "1e999"))
    with pytest.raises(FileError, match="finite"):
        read_rig(tmp_path / "rig.json")


def test_an_absurd_size_is_refused_unread(tmp_path: Path) -> None:
    with (tmp_path / "rig.json").open("wb") as stream:
        stream.truncate(2**40)  # sparse
    with pytest.raises(FileError, match="at most"):
        read_rig(tmp_path / "rig.json")


def test_what_is_no_text_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "binary.json").write_bytes(b"{\xff\xfe}")
    for name, message in [("binary.json", "UTF-8"), ("none.json", "cannot be read"), (".", "folder"), ("a\0b", "NUL")]:
        with pytest.raises(FileError, match=message):
            read_rig(tmp_path / name)


@given(st.binary(max_size=200))
def test_rubbish_raises_nothing_else(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "rubbish.json"
    path.write_bytes(content)
    with pytest.raises(RetrueError):
        read_rig(path)
