"""A setup says which devices there are; what it cannot mean is refused in one line that names it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from retrue.devices.drivers import make_rig
from retrue.devices.opencv_camera import OpencvCamera
from retrue.devices.setup import parse_setup
from retrue.devices.simulated_rig import SimulatedRig, default_rig
from retrue.devices.window_projector import WindowProjector
from retrue.errors import DeviceError, FileError
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.rig import Rig

SIMULATED = '[camera]\ndriver = "simulated"\n{}\n[projector]\ndriver = "simulated"\n'
REAL = '[camera]\ndriver = "{}"\n{}\n[projector]\ndriver = "window"\n{}\n'


def test_a_setup_of_real_devices():
    text = 'rig = "a/rig.json"\n' + REAL.format(
        "opencv", 'device = "rtsp://there"\nexposure_ms = 20', "screen = 1\nsize = [1920, 1080]"
    )
    setup = parse_setup(text, "rigs/setup.toml")
    assert setup.rig == Path("rigs/a/rig.json")
    live = make_rig(setup)
    assert live.camera == OpencvCamera("rtsp://there", exposure_ms=20)
    assert live.projector == WindowProjector(1, (1920, 1080))


def test_simulated_devices_are_one_rig_of_the_size_that_is_asked_for():
    live = make_rig(parse_setup(SIMULATED.format("size = [64, 48]\nprojector_size = [32, 24]\nscene = 'wall'")))
    assert isinstance(live.simulated, SimulatedRig)
    assert live.projector.size == (32, 24)
    assert live.camera.frame().picture.shape == (48, 64, 3)


def test_simulated_devices_stand_as_in_the_rig_that_is_there():
    K = [[80, 0, 31.5], [0, 80, 23.5], [0, 0, 1]]
    rig = Rig(
        Camera((64, 48), K), Camera((32, 24), K), RigidTransform.from_rotation_vector([0, 0.2, 0], [-0.2, 0, 0]), "m"
    )
    live = make_rig(parse_setup(SIMULATED.format("scene = 'wall'")), rig)
    assert live.simulated is not None
    assert live.simulated.true_rig == rig
    assert live.camera.frame().picture.shape == (48, 64, 3)
    assert default_rig(live.simulated.options).camera.size == (64, 48)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("rig = ", "setup.toml: not a setup, which is TOML: "),
        ("x = 1", "setup.toml: x: expected rig, [camera] and [projector], and nothing else"),
        ("rig = 3", "setup.toml: rig: expected the name of the rig's file, found 3"),
        ("", "setup.toml: [camera] is missing: it says which driver to use, one of opencv, genicam,"),
        ("camera = 3", "setup.toml: [camera] is missing"),
        ('[camera]\ndriver = "webcam"', "setup.toml: [camera] driver: expected one of opencv, genicam, gphoto2"),
        ('[camera]\ndriver = ["opencv"]', "setup.toml: [camera] driver: expected one of opencv"),
        (SIMULATED.format("lag = 3"), "setup.toml: [camera] lag: this driver has no such setting; it has scene,"),
        (SIMULATED.format("drop = 2.0"), "setup.toml: [camera] drop: expected 0 to 0.9, found 2.0"),
        (SIMULATED.format("size = 3"), "setup.toml: size: expected [width, height], found 3"),
        (SIMULATED.format("scene = 'moon'"), "setup.toml: [camera] scene: expected wall, corner, step, sphere,"),
        (SIMULATED.format("seed = 'a'"), "setup.toml: [camera] seed: expected a whole number, found 'a'"),
        (SIMULATED.format("") + "x = 1", "setup.toml: [projector] x: a simulated projector has no such setting"),
        (REAL.format("simulated", "", ""), 'setup.toml: driver: "simulated" stands for a whole rig: give it to both'),
        (REAL.format("opencv", "fps = true", ""), "setup.toml: [camera] fps: expected a number, found True"),
        (REAL.format("opencv", "size = [1.5, 2]", ""), "setup.toml: [camera] size: expected [width, height], found"),
        (REAL.format("opencv", "triggered = true", ""), "setup.toml: [camera] triggered: this driver has no such"),
    ],
)
def test_what_a_setup_cannot_mean_is_refused(text: str, complaint: str):
    with pytest.raises(FileError) as refused:
        make_rig(parse_setup(text))
    assert str(refused.value).startswith(complaint)


@pytest.mark.parametrize(
    ("package", "extra", "setup", "part"),
    [
        ("harvesters", "genicam", REAL.format("genicam", 'producer = "x.cti"', ""), "camera"),
        ("gphoto2", "gphoto2", REAL.format("gphoto2", "", ""), "camera"),
        ("picamera2", "picamera2", REAL.format("picamera2", "", ""), "camera"),
        ("glfw", "window", REAL.format("opencv", "", ""), "projector"),
    ],
)
def test_a_driver_without_its_package_names_the_extra(package, extra, setup, part, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    device = getattr(make_rig(parse_setup(setup)), part)
    with pytest.raises(DeviceError, match=rf"needs {package}: pip install '\.\[{extra}\]'$"):
        device.open()


def test_no_driver_is_imported_that_is_not_used():
    imports = "from retrue.devices.drivers import make_rig\nfrom retrue.devices.setup import parse_setup\nimport sys"
    code = f"{imports}\nmake_rig(parse_setup({SIMULATED.format('')!r}))\nprint(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"glfw", "harvesters", "gphoto2", "picamera2"} & set(loaded)
