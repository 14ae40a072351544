"""Other tools' files: every bit back, OpenCV reads ours, we read OpenCV's."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from retrue.errors import FileError, InputError, RetrueWarning
from retrue.files.foreign_rigs import RIG_FORMATS
from retrue.files.rigs import read_device, read_rig, write_rig
from retrue.files.tool_formats import TOOL_FORMATS, ToolFormat
from retrue.geometry.camera import Camera
from retrue.rig import Rig
from tests.files.awkward_rigs import SIZES, make_rig

ENDINGS = [".yml", ".xml", ".json"]
OPENCV_FORMATS = {
    ".yml": cv2.FILE_STORAGE_FORMAT_YAML,
    ".xml": cv2.FILE_STORAGE_FORMAT_XML,
    ".json": cv2.FILE_STORAGE_FORMAT_JSON,
}


def assert_same(a: Camera, b: Camera) -> None:
    assert a.size == b.size
    np.testing.assert_array_equal(a.K, b.K)
    np.testing.assert_array_equal(a.distortion, b.distortion)


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("tool", TOOL_FORMATS, ids=lambda tool: tool.name)
def test_tools_round_trip_to_the_last_bit(tool: ToolFormat, ending: str, tmp_path: Path) -> None:
    for seed in range(5):
        rig = make_rig(seed, skew=0.3)
        path = tmp_path / f"rig{ending}"
        lost = write_rig(path, rig, tool.name)
        assert "unit" in lost
        back = read_rig(path, **SIZES, unit="mm")
        assert_same(back.camera, rig.camera)
        assert_same(back.projector, rig.projector)
        np.testing.assert_array_equal(back.projector_from_camera.R, rig.projector_from_camera.R)
        np.testing.assert_array_equal(back.projector_from_camera.t, rig.projector_from_camera.t)


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("tool", TOOL_FORMATS, ids=lambda tool: tool.name)
def test_opencv_reads_what_we_write(tool: ToolFormat, ending: str, tmp_path: Path) -> None:
    rig = make_rig()
    path = tmp_path / f"rig{ending}"
    write_rig(path, rig, tool.name)
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    K = rig.projector.K.copy()
    K[:2, 2] += tool.first_pixel
    np.testing.assert_array_equal(storage.getNode(tool.projector[0]).mat(), K)
    np.testing.assert_array_equal(storage.getNode(tool.camera[1]).mat().ravel(), rig.camera.distortion)
    np.testing.assert_array_equal(storage.getNode(tool.T[0]).mat(), rig.projector_from_camera.t.reshape(3, 1))
    storage.release()


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("tool", TOOL_FORMATS, ids=lambda tool: tool.name)
def test_we_read_what_opencv_writes(tool: ToolFormat, ending: str, tmp_path: Path) -> None:
    rig = make_rig()
    path = tmp_path / f"anything{ending}.dat"
    flags = cv2.FILE_STORAGE_WRITE | getattr(
        cv2, f"FILE_STORAGE_FORMAT_{ {'.yml': 'YAML'}.get(ending, ending[1:].upper()) }"
    )
    storage = cv2.FileStorage(str(path), flags)
    storage.write("rms", 0.25)
    storage.write("note", "taken on: a Tuesday")
    for names, camera in ((tool.camera, rig.camera), (tool.projector, rig.projector)):
        K = camera.K.copy()
        K[:2, 2] += tool.first_pixel
        storage.write(names[0], K)
        storage.write(names[1], camera.distortion)  # one-dimensional: an nd-matrix for OpenCV 5
    storage.write(tool.R[-1], rig.projector_from_camera.R)
    storage.write(tool.T[0], rig.projector_from_camera.t.reshape(3, 1))
    storage.write("modelPts", np.arange(40_000.0).reshape(-1, 2))
    storage.release()
    back = read_rig(path, **SIZES, unit="m")
    assert_same(back.projector, rig.projector)
    assert_same(back.camera, rig.camera)
    assert back.unit == "m"


OPENCV_4_YAML = """%YAML:1.0
---
cam_size: !!opencv-matrix
   rows: 2
   cols: 1
   dt: i
   data: [ 2592, 1944 ]
cam_K: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 2.8213854678520406e+03, 0., 1.5067630790244727e+03, 0.,
       2.8189296399419081e+03, 1.0922506617197882e+03, 0., 0., 1. ]
cam_kc: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ -2.3139508355900590e-01, .5, 0., 0., 0. ]
pro_size: [ 1280, 800 ]
pro_K: !!opencv-matrix
   rows: 3
   cols: 3
   dt: f
   data: [ 1653.25, 0., 622.5, 0., 1719.25, 363.5, 0., 0., 1. ]
pro_kc: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -4.8e-02, 1.4, 0., 0., 0. ]
R: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 1., 0., 0., 0., 1., 0., 0., 0., 1. ]
T: !!opencv-matrix
   rows: 3
   cols: 1
   dt: d
   data: [ -183.25, -23.5, -60.75 ]
cam_rvecs:
   []
input_files:
   - "slscan_0000.yaml"
   - "slscan_0001.yaml"
"""


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_a_file_of_opencv_4_as_its_users_have_it(tmp_path: Path) -> None:
    rig = read_rig(write(tmp_path / "procam.yaml", OPENCV_4_YAML), unit="mm")
    assert (rig.camera.size, rig.projector.size) == ((2592, 1944), (1280, 800))
    assert rig.camera.K[1, 2] == 1.0922506617197882e03
    assert rig.camera.distortion[1] == 0.5
    assert rig.projector_from_camera.t.tolist() == [-183.25, -23.5, -60.75]
    windows = write(tmp_path / "windows.yaml", OPENCV_4_YAML.replace("\n", "\r\n"))
    np.testing.assert_array_equal(read_rig(windows, unit="mm").camera.K, rig.camera.K)


def test_procam_calibration_stores_height_first(tmp_path: Path) -> None:
    write_rig(tmp_path / "rig.xml", make_rig(), "procam-calibration")
    text = (tmp_path / "rig.xml").read_text()
    assert "1024.0 1280.0" in text
    assert "<roration " in text
    (tmp_path / "rig.xml").write_text(text.replace("roration", "rotation"))
    assert read_device(tmp_path / "rig.xml", "camera").size == (1280, 1024)


def test_a_size_that_a_tool_makes_up_is_not_believed(tmp_path: Path) -> None:
    write_rig(tmp_path / "rig.json", make_rig(), "procam-calibration")
    text = (tmp_path / "rig.json").read_text()
    (tmp_path / "rig.json").write_text(text.replace("{", '{"stereo_error": {"rows": 1, "cols": 1, "data": [0.5]},', 1))
    with pytest.raises(FileError, match="procam-calibration does not store camera_size"):
        read_device(tmp_path / "rig.json", "camera")


def test_a_tool_that_counts_from_one(tmp_path: Path) -> None:
    rig = make_rig()
    write_rig(tmp_path / "rig.yml", rig, "single-shot-pro-cam-calib")
    storage = cv2.FileStorage(str(tmp_path / "rig.yml"), cv2.FILE_STORAGE_READ)
    assert storage.getNode("camK").mat()[0, 2] == rig.camera.K[0, 2] + 1
    storage.release()


@pytest.mark.parametrize(
    ("given", "asked"),
    [
        ({}, "camera_size, projector_size, unit: .* --camera-size W H --projector-size W H --unit mm"),
        ({"camera_size": (1280, 1024)}, "projector_size, unit: .* --camera-size 1280 1024 --projector-size W H"),
        (SIZES, "store unit: .* --camera-size 1280 1024 --projector-size 1024 768 --unit mm"),
        ({"unit": "in", "camera_size": (1280, 1024)}, "store projector_size: .* --projector-size W H --unit in"),
    ],
)
def test_what_a_format_lacks_is_asked_for_at_once(given: dict[str, Any], asked: str, tmp_path: Path) -> None:
    write_rig(tmp_path / "rig.yml", make_rig(), "scan3d-capture")
    with pytest.raises(FileError, match=asked):
        read_rig(tmp_path / "rig.yml", **given)


@pytest.mark.parametrize("unit", ["", " ", "m\nm", "x" * 41])
def test_a_unit_that_no_file_could_hold_is_refused(unit: str, tmp_path: Path) -> None:
    write_rig(tmp_path / "rig.yml", make_rig(), "scan3d-capture")
    with pytest.raises(InputError, match="unit: expected the name"):
        read_rig(tmp_path / "rig.yml", **SIZES, unit=unit)


def test_arguments_that_contradict_the_file_are_refused(tmp_path: Path) -> None:
    write_rig(tmp_path / "rig.xml", make_rig(), "slstudio")
    with pytest.raises(FileError, match="projector_size: the file says 1024 x 768, but it is 800 x 600"):
        read_rig(tmp_path / "rig.xml", unit="mm", projector_size=(800, 600))
    write_rig(tmp_path / "rig.json", make_rig())
    with pytest.raises(FileError, match="unit: the file says 'mm', you say 'm'"):
        read_rig(tmp_path / "rig.json", unit="m")


FAULTS = [
    ("pro_kc:", "pro_xx:", "looks like sltk, but pro_kc is missing"),
    ("1.0922506617197882e+03", ".Nan", "cam_K: expected finite numbers, found '.Nan'"),
    ("1.0922506617197882e+03", ".Inf", "cam_K: expected finite numbers"),
    ("1.0922506617197882e+03", "1e999", "cam_K: expected finite numbers, found infinity"),
    ("1.0922506617197882e+03,", "", "cam_K: expected 3 x 3 numbers, found 8"),
    ("data: [ 1., 0., 0., 0., 1., 0., 0., 0., 1. ]", "data: [ 1., 0., 0., 0., 2., 0., 0., 0., 1. ]", "rotation R"),
    ("0., 0., 1. ]\ncam_kc", "0., 0., 2. ]\ncam_kc", "cam_K, cam_kc: K: expected"),
    ("2592, 1944", "2592, -1944", "cam_size: expected width and height"),
    ("-183.25, -23.5, -60.75", "-183.25, -23.5", "T: expected 3 x 1 numbers"),
    ("rows: 3", "rows: 99999999999", "cam_K: expected -1 numbers"),
]


@pytest.mark.parametrize(("old", "new", "message"), FAULTS)
def test_a_fault_is_named(old: str, new: str, message: str, tmp_path: Path) -> None:
    assert old in OPENCV_4_YAML
    with pytest.raises(FileError) as caught:
        read_rig(write(tmp_path / "rig.yaml", OPENCV_4_YAML.replace(old, new)), unit="mm")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


HOSTILE = [
    "inf",
    ".inf",
    "-Infinity",
    "nan",
    ".nan",
    "1e999",
    "-5.0",
    "0.0",
    '"x"',
    "9" * 400,
    "1.0, " * 20_000 + "1.0",
]


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("to", RIG_FORMATS)
def test_hostile_numbers_are_named_in_one_line(to: str, ending: str, tmp_path: Path) -> None:
    rig, path = make_rig(), tmp_path / f"rig{ending}"
    device = rig.projector if to.endswith("-projector") else rig.camera
    write_rig(path, rig, to)
    text, f = path.read_text(), float(device.K[0, 0])
    focal = next(digits for digits in (repr(f), f"{f:.17g}") if digits in text)
    for value in HOSTILE:
        path.write_text(text.replace(focal, value))
        with pytest.raises(FileError, match=r"rig\.\w+: ") as caught:
            read_device(path, "projector" if to.endswith("-projector") else "camera", size=device.size)
        assert "\n" not in str(caught.value)
        assert len(str(caught.value)) < 400 + len(str(path))


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("tool", TOOL_FORMATS, ids=lambda tool: tool.name)
def test_a_mirror_is_no_rotation(tool: ToolFormat, ending: str, tmp_path: Path) -> None:
    rig, path = make_rig(), tmp_path / f"rig{ending}"
    write_rig(path, rig, tool.name)
    text = path.read_text()
    for number in rig.projector_from_camera.R[0].tolist():  # one row turned round
        digits = f"{number:.17g}"
        text = text.replace(digits, digits[1:] if number < 0 else f"-{digits}").replace("--", "")
    path.write_text(text)
    with pytest.raises(FileError, match="rotation R"):
        read_rig(path, **SIZES, unit="mm")


def test_two_entries_of_one_name_are_refused_where_they_differ(tmp_path: Path) -> None:
    text = OPENCV_4_YAML + OPENCV_4_YAML.partition("---\n")[2]
    assert read_rig(write(tmp_path / "same.yaml", text), unit="mm").camera.size == (2592, 1944)
    with pytest.raises(FileError, match="cam_K: expected finite numbers, found 'two different entries"):
        read_rig(write(tmp_path / "other.yaml", text.replace("1.0922506617197882e+03", "1100.0", 1)), unit="mm")


def test_entities_are_not_expanded(tmp_path: Path) -> None:
    bomb = '<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "b">]><opencv_storage><M1>&a;</M1></opencv_storage>'
    with pytest.raises(FileError, match="declaration"):
        read_rig(write(tmp_path / "rig.xml", bomb), unit="mm", **SIZES)


def test_a_format_that_cannot_hold_the_rig_refuses(tmp_path: Path) -> None:
    rig = make_rig()
    wide = Camera(rig.camera.size, rig.camera.K, np.arange(8) / 100)
    eight = Rig(wide, rig.projector, rig.projector_from_camera)
    with pytest.raises(InputError, match="slstudio holds 5"):
        write_rig(tmp_path / "rig.xml", eight, "slstudio")
    with pytest.raises(InputError, match="mrcal has no skew"):
        write_rig(tmp_path / "rig.cameramodel", make_rig(skew=0.1), "mrcal-camera")
    with pytest.raises(InputError, match="format: expected one of retrue"):
        write_rig(tmp_path / "rig.xml", rig, "nonsense")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("role", ["camera", "projector"])
@pytest.mark.parametrize("tool", ["ros", "mrcal"])
@pytest.mark.parametrize("count", [5, 8])
def test_one_device_round_trips(role: Any, tool: str, count: int, tmp_path: Path) -> None:
    rig = make_rig()
    lens = np.random.default_rng(1).normal(size=count) / 9
    camera, projector = (Camera(device.size, device.K, lens) for device in (rig.camera, rig.projector))
    rig = Rig(camera, projector, rig.projector_from_camera)
    lost = write_rig(tmp_path / "device", rig, f"{tool}-{role}")
    assert "unit" in lost
    assert_same(read_device(tmp_path / "device", role), camera if role == "camera" else projector)
    with pytest.raises(FileError, match="expected a rig, found one device"):
        read_rig(tmp_path / "device")


def test_mrcal_as_mrcal_writes_it(tmp_path: Path) -> None:
    text = """# generated with mrcal-calibrate-cameras
{
    'lensmodel':  'LENSMODEL_OPENCV4',
    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....
    'intrinsics': [ 1766.0712405930, 1765.8925266865, 1944.0664501036,
                    1064.5231421210, -0.1, 0.25, 0.001, 1e-4,],
    'valid_intrinsics_region': [ [ 1, 2 ], ],
    'rt_cam_ref': [ 0, 0, 0, 0, 0, 0,],
    'imagersize': [ 3840, 2160,],
}
"""
    camera = read_device(write(tmp_path / "c.cameramodel", text), "camera", size=(3840, 2160))
    assert camera.K.tolist() == [[1766.071240593, 0, 1944.0664501036], [0, 1765.8925266865, 1064.523142121], [0, 0, 1]]
    assert camera.distortion.tolist() == [-0.1, 0.25, 0.001, 1e-4, 0]
    cahvor = write(tmp_path / "cahvor", text.replace("OPENCV4", "CAHVOR"))
    with pytest.raises(FileError, match="lensmodel: expected one of LENSMODEL_OPENCV12"):
        read_device(cahvor, "camera")


def test_ros_with_block_lists_and_comments(tmp_path: Path) -> None:
    text = """# by hand
image_width: 640
image_height: 480
camera_name: narrow
camera_matrix:
  rows: 3
  cols: 3
  data: [500.5, 0, 320,   # fx
         0, 501, 240, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data:
  - -0.25
  - 0.125
  - 0.0
  - 0.0
  - 0.0
"""
    camera = read_device(write(tmp_path / "ros.yaml", text), "projector")
    assert camera.size == (640, 480)
    assert camera.K[0].tolist() == [500.5, 0, 320]
    assert camera.distortion.tolist() == [-0.25, 0.125, 0, 0, 0]
    fisheye = write(tmp_path / "fisheye.yaml", text.replace("plumb_bob", "equidistant"))
    with pytest.raises(FileError, match="expected four coefficients of a fisheye, found 5"):
        read_device(fisheye, "camera")
    unknown = write(tmp_path / "unknown.yaml", text.replace("plumb_bob", "thin_prism"))
    with pytest.raises(FileError, match="distortion_model: expected plumb_bob, rational_polynomial, equidistant"):
        read_device(unknown, "camera")


def opencv_matrix(name: str, values: Any) -> str:
    matrix = np.atleast_2d(np.array(values, dtype=float))
    data = ", ".join(f"{value:.16e}" for value in matrix.ravel())
    rows, cols = matrix.shape
    return f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: [ {data} ]\n"


K_OF_SAMPLE = [[1510.0, 0, 634], [0, 1512, 487], [0, 0, 1]]
CAMERA_SAMPLE = (
    '%YAML:1.0\n---\ncalibration_time: "Tue Jun  5 10:11:12 2018"\nnr_of_frames: 22\nimage_width: 1280\n'
    "image_height: 960\nboard_width: 9\nboard_height: 6\nsquare_size: 25.\nfix_aspect_ratio: 1.\n"
    "# flags: +fix_aspectRatio +zero_tangent_dist\nflags: 6\nfisheye_model: 0\n"
    + opencv_matrix("camera_matrix", K_OF_SAMPLE)
    + opencv_matrix("distortion_coefficients", [[-0.09], [0.04], [0.0], [0.0], [0.0]])
    + "avg_reprojection_error: 2.1e-01\n"
    + opencv_matrix("extrinsic_parameters", np.ones((3, 6)))
)


def test_what_opencvs_calibration_sample_writes_is_a_known_camera(tmp_path: Path) -> None:
    camera = read_device(write(tmp_path / "out_camera_data.yml", CAMERA_SAMPLE), "camera")
    assert (camera.size, camera.K.tolist()) == ((1280, 960), K_OF_SAMPLE)
    assert camera.distortion.tolist() == [-0.09, 0.04, 0, 0, 0]
    with pytest.raises(FileError, match="found one device"):
        read_rig(tmp_path / "out_camera_data.yml")
    old = CAMERA_SAMPLE.replace("image_width", "image_Width").replace("image_height", "image_Height")
    old = old.replace("camera_matrix", "Camera_Matrix").replace("distortion_coefficients", "Distortion_Coefficients")
    assert_same(read_device(write(tmp_path / "opencv_2.yml", old), "camera"), camera)
    sizeless = "\n".join(line for line in CAMERA_SAMPLE.splitlines() if not line.startswith("image_"))
    assert_same(read_device(write(tmp_path / "python.yml", sizeless), "projector", size=(1280, 960)), camera)
    with pytest.raises(FileError, match="does not store camera_size"):
        read_device(tmp_path / "python.yml", "camera")


def test_what_opencvs_stereo_sample_writes_is_a_rig(tmp_path: Path) -> None:
    R = cv2.Rodrigues(np.array([0.05, 0.2, 0.03]))[0]
    devices = {"M1": K_OF_SAMPLE, "D1": [-0.09, 0.04, *[0] * 12], "M2": np.diag([1320.0, 1318, 1]), "D2": [0] * 14}
    intrinsics = "".join(opencv_matrix(name, values) for name, values in devices.items())
    extrinsics = opencv_matrix("R", R) + opencv_matrix("T", [[-432.0], [44], [24]]) + opencv_matrix("Q", np.eye(4))
    write(tmp_path / "both.yml", "%YAML:1.0\n---\n" + intrinsics + extrinsics)
    rig = read_rig(tmp_path / "both.yml", **SIZES, unit="mm")
    np.testing.assert_allclose(rig.projector_from_camera.R, R, atol=1e-15)
    assert rig.projector_from_camera.t.tolist() == [-432, 44, 24]
    assert rig.projector.K[0, 0] == 1320
    alone = write(tmp_path / "intrinsics.yml", "%YAML:1.0\n---\n" + intrinsics)
    assert read_device(alone, "projector", size=(1024, 768)).K[1, 1] == 1318
    with pytest.raises(FileError, match="looks like opencv-stereo, but R, T is missing: the sample writes"):
        read_rig(alone, **SIZES, unit="mm")
    write(tmp_path / "extrinsics.yml", "%YAML:1.0\n---\n" + extrinsics)
    lensless = write(tmp_path / "lensless.yml", (tmp_path / "both.yml").read_text().replace("D2:", "d2:"))
    with pytest.raises(FileError, match=r"but D2 is missing$"):
        read_rig(lensless, **SIZES, unit="mm")
    for half in ("intrinsics.yml", "extrinsics.yml"):
        assert read_rig(tmp_path / half, **SIZES, unit="mm").projector_from_camera.t.tolist() == [-432, 44, 24]


KALIBR = """cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.27695497, 0.06712482,
    0.00087538, 0.00011556]
  distortion_model: radtan
  intrinsics: [461.629, 460.152, 362.680, 246.049]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [0.99998854, 0.00216014, 0.00427195, -0.11003785]
  - [-0.00221074, 0.99992702, 0.01187697, 0.00045792]
  - [-0.00424598, -0.01188627, 0.99992034, -0.00064487]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0]
  camera_model: pinhole
  distortion_coeffs: [0.01, -0.02, 0.01, -0.003]
  distortion_model: equidistant
  intrinsics: [460.0, 461.0, 373.850, 253.749]
  resolution: [752, 480]
  rostopic: /cam1/image_raw
"""


def test_a_camchain_of_kalibr_is_a_rig_in_metres(tmp_path: Path) -> None:
    with pytest.warns(RetrueWarning, match=r"cam1: a lens .*\(pinhole-equidistant\), fitted to within 0\.0"):
        rig = read_rig(write(tmp_path / "camchain.yaml", KALIBR))
    assert (rig.unit, rig.camera.size, rig.camera.distortion.tolist()[:2]) == (
        "m",
        (752, 480),
        [-0.27695497, 0.06712482],
    )
    np.testing.assert_allclose(rig.projector_from_camera.t, [-0.11003785, 0.00045792, -0.00064487])
    rays = np.random.default_rng(0).uniform(-0.7, 0.7, (50, 2))
    k = np.array([0.01, -0.02, 0.01, -0.003])
    there = cv2.fisheye.distortPoints(rays[None], np.array([[460.0, 0, 373.85], [0, 461, 253.749], [0, 0, 1]]), k)[0]
    np.testing.assert_allclose(rig.projector.pixels_from_rays(rays), there, atol=0.01)
    with pytest.raises(FileError, match="expected one camera or two, found cam0, cam1, cam2"):
        read_rig(write(tmp_path / "three.yaml", KALIBR + KALIBR[: KALIBR.index("cam1")].replace("cam0", "cam2")))


def test_kalibrs_poses_to_the_imu_are_a_chain_too(tmp_path: Path) -> None:
    def pose(x: float) -> str:
        return f"  T_cam_imu: [[1, 0, 0, {x}], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n"

    start, end = KALIBR.index("  T_cn_cnm1"), KALIBR.index("  cam_overlaps: [0]")
    text = KALIBR[:start] + pose(0.3) + KALIBR[end:].replace("equidistant", "radtan")
    rig = read_rig(write(tmp_path / "imu.yaml", text.replace("cam0:\n", "cam0:\n" + pose(0.5))), unit="m")
    np.testing.assert_allclose(rig.projector_from_camera.t, [-0.2, 0, 0], atol=1e-15)


BOOFCV_CAMERA = """pinhole:
  fx: 701.0
  fy: 698.5
  cx: 308.25
  cy: 246.5
  width: 640
  height: 480
  skew: 0.0
model: pinhole_radial_tangential
radial_tangential:
  radial:
  - -0.25
  - 0.09
  t1: 0.001
  t2: -0.002
version: 0
"""


def test_boofcv_writes_cameras_and_stereo_pairs(tmp_path: Path) -> None:
    head = "# Pinhole camera model with radial and tangential distortion\n\n"
    camera = read_device(write(tmp_path / "intrinsic.yaml", head + BOOFCV_CAMERA), "camera")
    assert camera.distortion.tolist() == [-0.25, 0.09, 0.001, -0.002, 0]
    inner = "".join(f"  {line}\n" for line in BOOFCV_CAMERA.splitlines())
    long = inner.replace("    - 0.09\n", "    - 0.09\n    - -0.02\n    - 0.05\n")
    R = cv2.Rodrigues(np.array([0.05, 0.2, 0.03]))[0]
    turn = "".join(f"  - {value!r}\n" for value in R.ravel().tolist())
    pose = f"rightToLeft:\n  rotation:\n{turn}  x: 120.0\n  y: 1.0\n  z: -2.0\n"
    stereo = f"# Intrinsic and extrinsic\nleft:\n{inner}right:\n{long}{pose}model: stereo_camera\nversion: 0\n"
    with pytest.warns(RetrueWarning, match="right: a lens .*4 radial coefficients"):
        rig = read_rig(write(tmp_path / "stereo.yaml", stereo), unit="mm")
    np.testing.assert_allclose(rig.projector_from_camera.R, R.T, atol=1e-12)
    np.testing.assert_allclose(rig.projector_from_camera.t, -R.T @ [120.0, 1.0, -2.0], atol=1e-12)
    assert_same(rig.camera, camera)
    with pytest.warns(RetrueWarning), pytest.raises(FileError, match="BoofCV does not store unit"):
        read_rig(tmp_path / "stereo.yaml")


def test_a_tilted_sensor_is_fitted(tmp_path: Path) -> None:
    distortion = np.array([-0.1, 0.05, 1e-3, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0.004, -0.003])
    text = CAMERA_SAMPLE[: CAMERA_SAMPLE.index("distortion_coeff")] + opencv_matrix(
        "distortion_coefficients", distortion
    )
    with pytest.warns(RetrueWarning, match=r"tilted sensor\), fitted to within 0\.0"):
        camera = read_device(write(tmp_path / "tilted.yml", text), "camera")
    rays = np.random.default_rng(0).uniform(-0.3, 0.3, (50, 2))
    points = np.column_stack([rays, np.ones(50)])
    there = cv2.projectPoints(points, np.zeros(3), np.zeros(3), np.array(K_OF_SAMPLE), distortion)[0][:, 0]
    np.testing.assert_allclose(camera.pixels_from_rays(rays), there, atol=0.02)


def test_a_lens_that_folds_in_its_own_picture_is_said(tmp_path: Path) -> None:
    def sample(k1: float) -> Path:
        return write(
            tmp_path / "c.yml",
            CAMERA_SAMPLE.replace("-9.0000000000000024e-02", repr(k1)).replace("-8.9999999999999997e-02", repr(k1)),
        )

    with pytest.raises(FileError, match=r"camera: the lens model reaches only \d\d % of the picture"):
        read_device(sample(-1.2), "camera")
    with pytest.warns(RetrueWarning, match="reaches only 9"):
        read_device(sample(-0.75), "camera")


def test_a_format_is_named_only_where_most_of_its_entries_are_there(tmp_path: Path) -> None:
    text = "%YAML:1.0\n---\n" + opencv_matrix("M1", np.eye(3)) + opencv_matrix("focus", [1.0])
    with pytest.raises(FileError, match=r"expected a rig of .*; found entries M1, focus"):
        read_rig(write(tmp_path / "some.yml", text))
