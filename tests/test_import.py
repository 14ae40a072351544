"""`import retrue` is quick because heavy libraries wait until they are needed."""

import ast
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import retrue

PUBLIC = [
    "AcceptOptions", "Accepted", "Artefact", "Board", "BoardCapture", "CadModel", "CadOptions", "Calibrated",
    "CalibrationOptions", "Camera", "CaptureError", "Cloud", "ColorGrid", "Correspondences", "DamagedLine",
    "DegenerateError", "DeviceError", "DistanceError", "Evidence", "FileError", "FittedView", "Frame",
    "FrameSequence", "GrayCode", "History", "HistoryEntry", "InputError", "KnownDistance", "LineGrid", "Lines",
    "LiveRig", "Matcher", "Matches", "MergeOptions", "Mesh", "PHOTOGRAPHS", "Photographs", "PlanarPose",
    "Plane", "PoseCandidate", "PoseChange", "PoseSigma", "Reason", "RecalibrateOptions", "ReconstructOptions",
    "RecordOptions", "Recorder", "Refused", "RefusedCalibration", "RetrueError", "RetrueWarning", "Rig",
    "RigidTransform", "RobustHomography", "Scale", "Setup", "SimulateOptions", "Simulated", "StereoCapture",
    "Verification", "VerifyOptions", "accept", "calibrate", "cloud_picture", "decode", "depth_map",
    "epipolar_residuals", "error_by_distance", "fill_holes", "fit_homography", "fit_homography_robust",
    "layout_sequence", "make_cad", "make_cloud", "make_color_grid", "make_line_grid", "make_mesh", "make_rig",
    "match_through_code", "merge", "parse_artefact", "parse_board", "parse_setup", "planar_pose_candidates",
    "planar_pose_candidates_batch", "read_board_capture", "read_board_captures", "read_capture", "read_device",
    "read_folder", "read_history", "read_image", "read_pattern", "read_points", "read_rig",
    "read_stereo_captures", "recalibrate", "reconstruct", "residual_picture", "rig_views", "roll_back",
    "scale_from_ball", "scale_from_ball_bar", "scale_from_points", "scaled_rig", "simulate", "triangulate",
    "verify", "view_html", "warp", "warped_picture", "with_normals", "write_bag", "write_cloud", "write_colmap",
    "write_depth_map", "write_in_place", "write_mesh", "write_nerfstudio", "write_pattern", "write_png",
    "write_points", "write_report", "write_rig", "write_ros", "write_st_map", "write_step", "write_view",
    "write_warp_mesh",
]  # fmt: skip
HEAVY = {"cv2", "scipy", "matplotlib", "tyro"}


def modules_after(code: str, *, whole: bool = False) -> set[str]:
    """Names of the modules, or of their packages."""
    lines = f"{code}\nimport sys\nprint(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", lines], capture_output=True, text=True, check=True)
    return {name if whole else name.partition(".")[0] for name in done.stdout.split()}


def test_heavy_libraries_are_not_imported() -> None:
    loaded = modules_after("import retrue\ndir(retrue)")
    assert "retrue" in loaded
    assert not (HEAVY | {"numpy"}) & loaded


def test_names_load_no_heavy_library_but_what_finds_the_board_and_compares_frames() -> None:
    skipped = {
        "BoardCapture",
        "Recorder",
        "StereoCapture",
        "calibrate",
        "read_board_capture",
        "read_board_captures",
        "read_stereo_captures",
    }
    code = f"import retrue\nfor name in {sorted(set(PUBLIC) - skipped)}: getattr(retrue, name)"
    assert not HEAVY & modules_after(code)


def test_help_loads_no_heavy_library() -> None:
    code = "from retrue.cli.main import main\ntry: main(['--help'])\nexcept SystemExit: pass"
    assert not (HEAVY - {"tyro"} | {"numpy"}) & modules_after(code)


@pytest.mark.parametrize("command", ["recalibrate", "verify"])
def test_a_command_loads_what_it_needs_and_no_more(command: str, tmp_path: Path) -> None:
    data = Path(retrue.__file__).parent / "demo_data"
    words = [command, str(data / "rig_before.json"), str(data / "scene.jpg"), "--pattern", str(data / "pattern.json")]
    words += ["--quiet", *(["--out", str(tmp_path / "new.json")] if command == "recalibrate" else [])]
    loaded = modules_after(f"from retrue.cli.main import main\nassert main({words}) in (0, 1)", whole=True)
    assert f"retrue.cli.{command}" in loaded
    assert not {"retrue.cli.calibrate", "retrue.cli.watch", "retrue.report.page"} & loaded
    assert not {"jinja2", "matplotlib", "PIL", "plotly", "trimesh"} & loaded


def test_the_public_names_are_these() -> None:
    assert dir(retrue) == PUBLIC


@pytest.mark.parametrize("name", PUBLIC)
def test_a_public_name_is_there_and_says_what_it_is(name: str) -> None:
    value = getattr(retrue, name)
    assert getattr(value, "__name__", name) == name  # a constant has none
    assert inspect.getdoc(value)
    assert not inspect.getdoc(value).startswith(f"{name}(")  # what a dataclass without a docstring gets


def test_the_stub_is_nothing_but_names_and_their_homes() -> None:
    stub = ast.parse(Path(retrue.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    for line in stub.body[1:]:
        assert isinstance(line, ast.ImportFrom)
        (name,) = line.names
        assert name.asname == name.name
        assert getattr(retrue, name.name).__module__ == line.module


@pytest.mark.parametrize("name", PUBLIC)
def test_the_manual_has_every_public_name(name: str) -> None:
    pages = (Path(__file__).parents[1] / "docs" / "api").glob("*.md")
    home = f"{getattr(retrue, name).__module__}.{name}"
    explained = [line for page in pages for line in page.read_text(encoding="utf-8").splitlines()]
    assert f"::: retrue.{name}" in explained or f"::: {home}" in explained


def test_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'recalibrat'"):
        _ = retrue.recalibrat
