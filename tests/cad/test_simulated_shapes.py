"""A ball before a leaning wall, of known size, from simulated pictures of a Gray code to CAD."""

import numpy as np
import pytest
import trimesh
from scipy.ndimage import map_coordinates

from retrue import Camera, Cloud, GrayCode, Rig, RigidTransform, decode, make_mesh, reconstruct
from retrue.cad.make_cad import make_cad
from retrue.cad.surfaces import fit_sphere
from retrue.files.models import write_mesh
from retrue.files.step import write_step
from retrue.simulation.camera_model import CameraModel, gaussian_blur
from retrue.simulation.scene import Scene, render
from retrue.simulation.surfaces import Sphere, Wall

from .occ import StepFile, require_opencascade

RADIUS = 120.0
CENTRE = np.array([20.0, -10.0, 720.0])
WALL = Wall.facing(900.0, [0.2, -0.25, 0.0])
CAMERA = Camera((480, 360), [[800, 0, 240], [0, 800, 180], [0, 0, 1]], [-0.05, 0.02, 0, 0, 0])
PROJECTOR = Camera((512, 384), [[800, 0, 256], [0, 800, 300], [0, 0, 1]])
RIG = Rig(CAMERA, PROJECTOR, RigidTransform.from_rotation_vector([0.02, 0.22, 0], [-180.0, 10, 20]), "mm")
FINER = 2
"""Rays a pixel, per axis: its light is their mean."""


def pictures_of(scene, code):
    """What the camera takes of each picture of the code: the scene is traced once, at a finer pitch."""
    K = CAMERA.K.copy()
    K[:2] *= FINER
    K[:2, 2] += (FINER - 1) / 2
    finer = Rig(Camera((480 * FINER, 360 * FINER), K, CAMERA.distortion), PROJECTOR, RIG.projector_from_camera)
    white = np.full((*PROJECTOR.size[::-1], 3), 255, np.uint8)
    ambient = scene.ambient[0] * 0.8
    seen = render(finer, scene, white, CameraModel(blur_px=1e-3), supersample=1)
    shading = np.maximum(seen.image[..., 0] / (255 * 0.7) - ambient, 0)
    x, y = np.moveaxis(np.nan_to_num(seen.projector_px), -1, 0)
    model = CameraModel(electrons=8000, read_noise=8)
    for seed, shown in enumerate(code.render()):
        lamp = gaussian_blur(shown[..., None] / 255.0, 0.4)[..., 0]
        light = np.where(seen.visible, map_coordinates(lamp, [y, x], order=1) * shading, 0.0) + ambient
        light = light.reshape(360, FINER, 480, FINER).mean(axis=(1, 3))
        yield model.picture(np.repeat(light[..., None], 3, axis=2), seed)


@pytest.fixture(scope="module")
def cloud():
    code = GrayCode(PROJECTOR.size)
    return reconstruct(RIG, decode(code, list(pictures_of(Scene([WALL, Sphere(CENTRE, RADIUS)]), code))))


@pytest.fixture(scope="module")
def model(cloud):
    return make_cad(cloud)


def in_metres(cloud):
    return Cloud(cloud.points / 1000, cloud.colors, cloud.camera_px, "m", cloud.cells, cloud.card)


def on_the_ball(points):
    return points[np.abs(np.linalg.norm(points - CENTRE, axis=1) - RADIUS) < 3]


def test_the_ball_and_the_wall_are_told_and_have_their_size(model):
    by_kind = {patch.surface.kind: patch for patch in model.patches}
    assert set(by_kind) == {"plane", "sphere"}
    ball, wall = by_kind["sphere"].surface, by_kind["plane"].surface
    assert ball.radius == pytest.approx(RADIUS, rel=2e-3)
    assert np.abs(ball.centre - CENTRE).max() < 0.3
    normal = WALL.pose.R[:, 2]
    assert np.degrees(np.arccos(-wall.normal @ normal)) < 0.02
    assert -wall.distance == pytest.approx(normal @ WALL.pose.t, abs=0.1)


def test_every_patch_is_within_its_tolerance_and_hardly_a_point_on_none(model):
    assert all(patch.met and patch.rms_error < patch.tolerance / 3 for patch in model.patches)
    assert model.left_out < 0.03 * model.points


@pytest.mark.parametrize(("ending", "per_mm"), [(".stl", 1.0), (".glb", 1e-3), (".ply", 1.0), (".obj", 1.0)])
def test_the_ball_of_a_mesh_read_back_has_its_size(tmp_path, cloud, ending, per_mm):
    write_mesh(tmp_path / f"mesh{ending}", make_mesh(cloud))
    back = trimesh.load_scene(tmp_path / f"mesh{ending}")
    if ending == ".glb":
        back.apply_transform(np.diag([1.0, -1, -1, 1]))
    vertices = np.asarray(back.to_mesh().vertices) / per_mm
    assert fit_sphere(on_the_ball(vertices)).radius == pytest.approx(RADIUS, rel=2e-3)


def test_step_reads_back_valid_in_millimetres_and_within_its_tolerance(tmp_path, cloud, model):
    require_opencascade()
    write_step(tmp_path / "part.step", model)
    step = StepFile.read(tmp_path / "part.step")
    assert step.valid
    assert set(step.kinds()) == {"Plane", "Sphere"}
    (radius,) = {face.Sphere().Radius() for face in step.faces() if "Sphere" in str(face.GetType())}
    assert radius == pytest.approx(RADIUS, rel=2e-3)
    for patch in model.patches:
        some = patch.rows[:: len(patch.rows) // 60]
        assert np.quantile(step.distances(cloud.points[some]), 0.95) <= patch.tolerance


def test_a_rig_in_metres_comes_to_the_same_step(tmp_path, cloud):
    require_opencascade()
    write_step(tmp_path / "part.step", make_cad(in_metres(cloud)))
    step = StepFile.read(tmp_path / "part.step")
    radii = [face.Sphere().Radius() for face in step.faces() if "Sphere" in str(face.GetType())]
    assert radii[0] == pytest.approx(RADIUS, rel=2e-3)
