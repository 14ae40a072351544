"""The viewer without a browser: what the scene holds, and who can reach it."""

import json
import re
import signal
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from retrue import Camera, Cloud, Mesh, Rig, RigidTransform, write_points, write_rig
from retrue.correspondences import Correspondences
from retrue.errors import FileError, InputError
from retrue.files.history import write_in_place
from retrue.files.models import write_cloud, write_mesh
from retrue.recalibration.result import Accepted, Evidence
from retrue.report.space import PROJECTOR_COLOR
from retrue.viewer.contents import read_contents
from retrue.viewer.scene import TWIN_COLOR, make_scene
from retrue.viewer.server import serving

CAMERA = Camera((640, 480), [[500, 0, 320], [0, 500, 240], [0, 0, 1]])
POSE = RigidTransform.from_rotation_vector([0, 0.2, 0], [-200.0, 0, 0])
RIG = Rig(CAMERA, CAMERA, POSE, "mm")
TWIN = RigidTransform.from_rotation_vector([0.1, -0.2, 0], [-100.0, 150, 60])


def free_port():
    with closing(socket.create_server(("127.0.0.1", 0))) as listener:
        return listener.getsockname()[1]


def plate(count=400, unit="mm"):
    points = np.random.default_rng(0).uniform([-300, -200, 900], [300, 200, 1100], (count, 3))
    colors = np.full((count, 3), 77, np.uint8)
    return Cloud(points, colors, np.zeros((count, 2)), unit)


@pytest.fixture
def files(tmp_path):
    """A rig with two entries in its history, an answer with two candidates, a cloud, a mesh and points."""
    rig = tmp_path / "rig.json"
    write_rig(rig, RIG)
    moved = Rig(CAMERA, CAMERA, TWIN, "mm")
    write_in_place(rig, Accepted(moved, "a test", Evidence(4)))
    poses = [
        {"R": pose.R.tolist(), "t": pose.t.tolist(), "chosen": chosen} for pose, chosen in ((POSE, True), (TWIN, False))
    ]
    (tmp_path / "answer.json").write_text(json.dumps({"verdict": "accepted", "candidates": poses}))
    cloud = plate()
    write_cloud(tmp_path / "cloud.ply", cloud)
    write_mesh(tmp_path / "mesh.glb", Mesh(cloud.points, cloud.colors, np.arange(399).reshape(-1, 3), "mm"))
    seen = Correspondences(CAMERA.project(cloud.points), CAMERA.project(TWIN.apply(cloud.points)))
    write_points(tmp_path / "points.csv", seen)
    return [tmp_path / name for name in ("rig.json", "answer.json", "cloud.ply", "mesh.glb", "points.csv")]


def test_the_scene_holds_all_that_the_files_hold(files):
    scene = make_scene(read_contents(files))
    once = [line for line in scene.lines if not line.moment]
    assert [line.name for line in once] == [
        "rig.json: camera",
        "rig.json: projector",
        "answer.json: candidate 1",
        "answer.json: candidate 2",
    ]
    assert [layer.name for layer in scene.layers] == ["cloud.ply", "mesh.glb", "points.csv"]
    history = [line for line in scene.lines if line.moment]
    assert {line.name for line in history} == {"rig.json: history"}
    assert [line.moment.split(",")[0] for line in history] == ["1: found", "2: recalibrated"]
    assert scene.notes == ()


def test_everything_is_in_the_unit_and_the_camera_frame_of_the_rig(files):
    scene = make_scene(read_contents(files))
    exact = plate().points
    for layer in scene.layers:
        assert layer.model.unit == "mm"
        assert np.allclose(layer.model.points, exact[: len(layer.model.points)], atol=1e-3)
    _, projector, chosen, twin, *_ = scene.lines
    assert np.allclose(projector.places[0], TWIN.inverse().t)
    assert np.allclose(chosen.places[0], POSE.inverse().t)
    # The far corners of the projector's frustum are seen in the corners of its picture.
    corners = [[-0.5, -0.5], [639.5, -0.5], [639.5, 479.5], [-0.5, 479.5]]
    assert np.allclose(CAMERA.project(TWIN.apply(projector.places[1::4])), corners)
    assert (chosen.color, chosen.label) == (PROJECTOR_COLOR, "chosen")
    assert (twin.color, twin.label) == (TWIN_COLOR, "twin")


def test_without_a_rig_the_first_model_gives_the_unit(tmp_path):
    write_cloud(tmp_path / "a.ply", plate(unit="cm"))
    write_cloud(tmp_path / "b.ply", plate(unit="m"))
    a, b = make_scene(read_contents([tmp_path / "a.ply", tmp_path / "b.ply"])).layers
    assert a.model.unit == b.model.unit == "cm"
    assert np.allclose(b.model.points, 100 * a.model.points)


def test_of_two_clouds_the_first_is_before(files):
    contents = read_contents([files[2], files[3]])
    assert [layer.when for layer in make_scene(contents, compare=True).layers] == ["before", "after"]
    with pytest.raises(InputError, match="expected two clouds to compare, found 3"):
        make_scene(read_contents(files), compare=True)


def test_one_page_is_served_on_loopback_only_and_to_nobody_elses_name(files):
    port = free_port()
    with serving(make_scene(read_contents(files)).page("a view"), "127.0.0.1", port):
        with urllib.request.urlopen(f"http://127.0.0.1:{port}") as page:
            assert page.status == 200
            assert "<title>a view</title>" in page.read().decode()
        assert listening_addresses(port) == {"127.0.0.1"}
        stranger = urllib.request.Request(f"http://127.0.0.1:{port}", headers={"Host": f"elsewhere.example:{port}"})
        for request in (stranger, f"http://127.0.0.1:{port}/etc/passwd"):
            with pytest.raises(urllib.error.HTTPError) as refused:
                urllib.request.urlopen(request)
            with refused.value as answer:
                assert answer.status == 404
                assert answer.read() == b""


def listening_addresses(port):
    """Local IPv4 addresses that a socket of this machine listens on at this port; IPv6 ones by their hex digits."""
    found = set()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        for line in Path(table).read_text().splitlines()[1:] if Path(table).exists() else []:
            local, _, state = line.split()[1:4]
            address, _, number = local.partition(":")
            if int(number, 16) == port and state == "0A":
                found.add(socket.inet_ntoa(bytes.fromhex(address)[::-1]) if len(address) == 8 else address)
    return found or pytest.skip("no /proc/net to ask")


def test_a_port_in_use_is_an_error():
    with closing(socket.create_server(("127.0.0.1", 0))) as taken:
        port = taken.getsockname()[1]
        with (
            pytest.raises(InputError, match=f"cannot listen on 127.0.0.1:{port}.*another --port"),
            serving("", "127.0.0.1", port),
        ):
            pass


@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
def test_the_command_prints_its_address_and_ends_cleanly(files, stop):
    program = "import sys; from retrue.cli.main import main; sys.exit(main())"
    arguments = ["view", *map(str, files), "--port", str(free_port()), "--json"]
    with subprocess.Popen(
        [sys.executable, "-c", program, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stderr is not None
            line = process.stderr.readline()
            found = re.fullmatch(r"look at (http://127\.0\.0\.1:\d+) \(Ctrl-C ends it\)\n", line)
            assert found, line + process.stderr.read()
            with urllib.request.urlopen(found.group(1)) as page:
                assert page.status == 200
            process.send_signal(stop)
            out, err = process.communicate(timeout=30)
        finally:
            process.kill()  # one that goes on would be waited for
    assert process.returncode == 0, err
    assert json.loads(out) == {"address": found.group(1), "notes": []}


def test_what_cannot_be_viewed_is_named(tmp_path, files):
    rig, answer, _, _, points = files
    with pytest.raises(InputError, match="candidates need the rig"):
        make_scene(read_contents([answer]))
    with pytest.raises(FileError, match="points need the rig that saw them"):
        read_contents([points])
    with pytest.raises(FileError, match="no such file"):
        read_contents([tmp_path / "nothing.ply"])
    with pytest.raises(InputError, match="at least one FILE"):
        read_contents([])
    (tmp_path / "refused.json").write_text('{"candidates": []}')
    with pytest.raises(FileError, match="the answer was refused before that"):
        read_contents([rig, tmp_path / "refused.json"])
    (tmp_path / "bad.json").write_text('{"candidates": [{"R": 1}]}')
    with pytest.raises(FileError, match="expected poses with R, t and chosen"):
        read_contents([tmp_path / "bad.json"])
    (tmp_path / "picture.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    with pytest.raises(FileError, match=r"picture\.png"):
        read_contents([tmp_path / "picture.png"])


def test_two_files_of_one_name_are_told_apart(tmp_path):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        write_cloud(tmp_path / folder / "cloud.ply", plate())
    scene = make_scene(read_contents([tmp_path / folder / "cloud.ply" for folder in ("a", "b")]))
    assert len({layer.name for layer in scene.layers}) == 2
