"""The path tracer's pixels are the rig's: against the other renderer, against dots, and against light that adds up."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from retrue.errors import FileError, InputError
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.patterns.color_grid import make_color_grid
from retrue.patterns.gray_code import GrayCode
from retrue.rig import Rig
from retrue.simulation import mitsuba_check, mitsuba_scene
from retrue.simulation.built_in_scenes import SCENES, built_in_scene, meeting_distance
from retrue.simulation.mitsuba_check import require_true_dots
from retrue.simulation.mitsuba_scene import MeshFile, shapes
from retrue.simulation.mitsuba_stage import Stage
from retrue.simulation.mitsuba_truth import find_truth
from retrue.simulation.options import SimulateOptions
from retrue.simulation.scene import Scene, render
from retrue.simulation.simulate import simulate

pytest.importorskip("mitsuba", reason='the renderer is not installed: pip install ".[simulate]"')

# Lens shift in both devices, square pixels in neither, skew, lenses.
CAMERA = Camera((200, 150), [[250, 1, 110], [0, 252, 60], [0, 0, 1]], [-0.15, 0.05, 0.001, -0.001, 0])
PROJECTOR = Camera((128, 96), [[176, 0, 64], [0, 175, 92], [0, 0, 1]], [-0.05, 0.02, 0, 0.001, 0])
POSE = RigidTransform.from_rotation_vector([0.12, 0.22, 0.03], [-300, -60, 40])
RIG = Rig(CAMERA, PROJECTOR, POSE)
SQUARE = Camera(CAMERA.size, [[250, 0, 110], [0, 250, 60], [0, 0, 1]])
PINHOLES = Rig(SQUARE, Camera(PROJECTOR.size, PROJECTOR.K), POSE)
QUICK = SimulateOptions(samples=4, bounces=1)


def stage_of(rig: Rig, name: str) -> Stage:
    distance = meeting_distance(rig)
    return Stage(rig, shapes(built_in_scene(name, rig, distance), False), distance, samples=4, bounces=1)


@pytest.mark.parametrize(("rig", "silhouettes"), [(PINHOLES, 0.002), (RIG, 0.02)], ids=["pinholes", "lenses"])
def test_truth_is_that_of_the_other_renderer(rig: Rig, silhouettes: float) -> None:
    items = built_in_scene("clutter", rig, meeting_distance(rig))
    truth = find_truth(stage_of(rig, "clutter"), np.array([[64.0, 48.0]]))
    other = render(rig, Scene(items), np.full((96, 128, 3), 255, np.uint8), supersample=1)
    same = truth.item == other.surface
    assert len(np.unique(truth.item)) > 5
    assert (~same).mean() < silhouettes
    error = np.abs(truth.depth / other.depth - 1)[same & (truth.item >= 0)]
    assert (error > 1e-4).mean() < silhouettes
    assert np.median(error) < 1e-6
    assert (truth.lit != other.visible)[same].mean() < 2 * silhouettes
    assert 0.1 < truth.lit.mean() < 0.9


def test_true_matches_are_where_depth_and_rig_say() -> None:
    grid = make_color_grid((128, 96), rows=8, columns=10)
    truth = find_truth(stage_of(PINHOLES, "corner"), grid.centres().reshape(-1, 2))
    assert 40 < len(truth.camera_px) <= 80
    column, row = np.round(truth.camera_px).astype(int).T
    rays = np.column_stack([SQUARE.normalise(truth.camera_px), np.ones(len(row))])
    expected = PINHOLES.projector.project(POSE.apply(rays * truth.depth[row, column][:, None]))
    # Depth is that of the pixel's centre: a wall at 45 degrees is half a pixel deeper or nearer at its rim.
    assert np.abs(expected - truth.projector_px).max() < 0.5


def test_dots_land_where_they_should() -> None:
    errors = require_true_dots(stage_of(RIG, "wall"))
    assert set(errors) == {"camera", "projector"}
    assert all(0 < error < 0.05 for error in errors.values())


def test_a_picture_that_is_a_pixel_off_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    through_lens = mitsuba_check.through_lens
    monkeypatch.setattr(mitsuba_check, "through_lens", lambda *views: np.roll(through_lens(*views), 1, axis=1))
    with pytest.raises(InputError, match=r"found 1\.\d+ px in the camera"):
        require_true_dots(stage_of(RIG, "wall"))


def test_a_projector_whose_pixels_count_from_their_corner_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = stage_of(RIG, "wall")
    K = np.array(PROJECTOR.K)
    K[:2, 2] += 0.5
    shifted = replace(stage, rig=replace(RIG, projector=replace(PROJECTOR, K=K)))
    emitter = Stage.projector

    def half_a_pixel_off(self: Stage, raster: np.ndarray) -> object:
        return emitter(replace(self, rig=shifted.rig), raster)

    monkeypatch.setattr(Stage, "projector", half_a_pixel_off)
    with pytest.raises(InputError, match=r"found 0\.\d+ px in the projector"):
        require_true_dots(stage)


def test_the_seed_decides_the_pictures() -> None:
    grid = make_color_grid((128, 96), rows=8, columns=10)
    first, again = (simulate(RIG, "wall", grid, QUICK) for _ in range(2))
    other = simulate(RIG, "wall", grid, replace(QUICK, seed=1))
    assert list(first.pictures) == ["capture", "white", "black"]
    for name, picture in first.pictures.items():
        assert picture.shape == (150, 200, 3)
        assert np.array_equal(picture, again.pictures[name])
        assert not np.array_equal(picture, other.pictures[name])
    means = [float(picture.mean()) for picture in first.pictures.values()]
    assert means[1] > means[0] > means[2] > 0


def test_a_gray_code_is_taken_whole_and_its_light_adds_up() -> None:
    calls: list[tuple[int, int]] = []
    options = replace(QUICK, electrons=float("inf"), read_noise=0.0)
    code = GrayCode((128, 96), step=8)
    pictures = simulate(RIG, "clutter", code, options, lambda *count: calls.append(count)).pictures
    assert list(pictures) == [f"{number:02d}" for number in range(code.picture_count)]
    assert calls[-1][0] == calls[-1][1] == len(calls)
    taken = [picture.astype(float) for picture in pictures.values()]
    white, black = taken[-2:]
    unsaturated = white < 250
    for shown, inverse in zip(taken[:-2:2], taken[1:-2:2], strict=True):
        assert np.abs(shown + inverse - white - black)[unsaturated].max() <= 2  # rounded four times


@pytest.mark.parametrize("kind", ["obj", "ply"])
def test_a_mesh_stands_where_its_file_says(tmp_path: Path, kind: str) -> None:
    corners = [(-900, -900, 1500), (900, -900, 1500), (900, 900, 1500), (-900, 900, 1500)]
    path = tmp_path / f"square.{kind}"
    if kind == "obj":
        lines = [*("v {} {} {}".format(*corner) for corner in corners), "f 1 2 3", "f 1 3 4"]
    else:
        head = "ply|format ascii 1.0|element vertex 4|property float x|property float y|property float z"
        head += "|element face 2|property list uchar int vertex_indices|end_header"
        lines = [*head.split("|"), *("{} {} {}".format(*corner) for corner in corners), "3 0 1 2", "3 0 2 3"]
    path.write_text("\n".join(lines) + "\n")
    stage = Stage(PINHOLES, shapes([MeshFile(path)], False), 1500.0, samples=4)
    truth = find_truth(stage, np.array([[64.0, 48.0]]))
    assert np.nanmax(np.abs(truth.depth - 1500)) < 0.01
    assert np.isfinite(truth.depth).mean() > 0.5


@pytest.mark.parametrize("name", ["broken.ply", "broken.obj", "mesh.stl"])
def test_what_is_no_mesh_is_refused_in_one_line(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("nothing\nof the kind\n")
    with pytest.raises(FileError, match=name) as refused:
        Stage(RIG, shapes([MeshFile(tmp_path / name)], False), 1500.0).room(0.1, 0)
    assert "\n" not in str(refused.value)


def test_what_cannot_be_simulated_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    grid = make_color_grid((128, 96), rows=8, columns=10)
    with pytest.raises(InputError, match="wall, corner"):
        simulate(RIG, "castle", grid)
    with pytest.raises(InputError, match="128 x 96, found one for 64 x 48"):
        simulate(RIG, "wall", make_color_grid((64, 48), rows=4, columns=5))
    with pytest.raises(InputError, match="--distance"):
        simulate(RIG, "wall", grid, replace(QUICK, distance=60.0))
    with pytest.raises(InputError, match="4 times a square"):
        SimulateOptions(samples=8)
    with pytest.raises(InputError, match="ambient"):
        SimulateOptions(ambient=float("nan"))
    monkeypatch.setattr(mitsuba_scene, "find_spec", lambda _: None)
    with pytest.raises(InputError, match=r"\.\[simulate\]"):
        simulate(RIG, "wall", grid)


def test_built_in_scenes_stand_where_both_devices_look() -> None:
    distance = meeting_distance(RIG)
    for name in SCENES:
        scene = Scene(built_in_scene(name, RIG, distance))
        lit = render(RIG, scene, np.full((96, 128, 3), 255, np.uint8), supersample=1).visible
        assert lit.mean() > 0.25, name
