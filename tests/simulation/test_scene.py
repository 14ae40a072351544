"""The renderer's truth is the rig's geometry, and its pictures are what that truth says."""

import numpy as np
import pytest

from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.rig import Rig
from retrue.simulation.camera_model import CameraModel, gaussian_blur
from retrue.simulation.scene import Scene, render
from retrue.simulation.surfaces import Box, Paint, Sphere, Wall


@pytest.fixture
def rig():
    camera = Camera((160, 120), [[200, 0, 79.5], [0, 200, 59.5], [0, 0, 1]], [-0.1, 0.02, 0.001, 0, 0])
    projector = Camera((128, 96), [[190, 0, 63.5], [0, 190, 47.5], [0, 0, 1]])
    return Rig(camera, projector, RigidTransform.from_rotation_vector([0, 0.2, 0], [-200, 0, 20]))


def test_truth_of_a_wall_is_a_homography_of_undistorted_rays(rig):
    wall = Wall.facing(1000.0, tilt=(0.2, -0.3, 0.1))
    rendered = render(rig, Scene([wall]), np.full((96, 128, 3), 255, np.uint8), supersample=1)
    y, x = np.mgrid[0:120:7, 0:160:7]
    rays = rig.camera.unproject(np.stack([x, y], axis=-1))
    points = np.concatenate([rays, np.ones((*rays.shape[:-1], 1))], axis=-1) * rendered.depth[y, x][..., None]
    assert np.allclose((points - wall.pose.t) @ wall.pose.R[:, 2], 0, atol=1e-9)
    expected = rig.projector.project(rig.projector_from_camera.apply(points))
    assert np.allclose(rendered.projector_px[y, x], expected, atol=1e-9)


def test_picture_shows_the_projected_pixel_where_truth_says(rig):
    ramp = np.zeros((96, 128, 3), np.uint8)
    ramp[..., 0] = np.arange(128)
    ramp[..., 1] = 2 * np.arange(96)[:, None]
    paint = Paint((1.0, 1.0, 1.0))
    scene = Scene([Wall.facing(1000.0, paint=paint)], ambient=(0, 0, 0))
    rendered = render(rig, scene, ramp, CameraModel(exposure=1.0, blur_px=0), supersample=1, projector_blur_px=0)
    seen = rendered.visible & (rendered.image[..., 2] == 0)
    assert seen.sum() > 5000
    red, green = rendered.image[seen][:, 0].astype(float), rendered.image[seen][:, 1].astype(float)
    u, v = rendered.projector_px[seen].T
    far = (u > 20) & (u < 126) & (v > 1) & (v < 94)  # not on the raster's border, where light ends
    rounding = 0.5 + v / u  # half a level in green, and half a level in red times green over red
    assert (np.abs(green - red * 2 * v / u) < rounding + 0.1)[far].all()


def test_a_sphere_shadows_the_wall_behind_it(rig):
    scene = Scene([Wall.facing(1000.0), Sphere(np.array([0.0, 0.0, 700.0]), 80.0)], ambient=(0, 0, 0))
    rendered = render(rig, scene, np.full((96, 128, 3), 255, np.uint8), CameraModel(blur_px=0), supersample=1)
    assert rendered.surface[60, 80] == 1
    assert rendered.depth[60, 80] == pytest.approx(620.0, abs=1.0)
    inside = rig.projector.contains(rendered.projector_px)
    shadow = (rendered.surface == 0) & inside & ~rendered.visible
    assert shadow.sum() > 100
    assert not rendered.image[shadow].any()


def test_box_faces_are_hit_from_outside_with_outward_normals():
    box = Box(RigidTransform(np.eye(3), [0.0, 0.0, 10.0]), (1.0, 2.0, 3.0))
    rays = np.array([[0, 0, 1.0], [0.05, 0, 1.0], [1.0, 0, 1.0]])
    distance = box.distance(np.zeros(3), rays)
    assert distance[:2].tolist() == [7.0, 7.0]
    assert np.isinf(distance[2])
    assert box.normals(np.zeros(3), rays[:1], distance[:1]).tolist() == [[0, 0, -1]]


def test_the_same_seed_gives_the_same_picture(rig):
    model = CameraModel(electrons=2000.0, read_noise=4.0, bayer=True, gamma=2.2, vignetting=0.3)
    scene = Scene([Wall.facing(900.0, paint=Paint(blob_size=80.0, contrast=0.5, gloss=0.2))])
    projected = np.full((96, 128, 3), 200, np.uint8)
    first, again, other = (render(rig, scene, projected, model, seed=seed).image for seed in (1, 1, 2))
    assert (first == again).all()
    assert (first != other).any()


def test_blur_keeps_the_light_and_its_centre():
    image = np.zeros((21, 21, 3))
    image[10, 8] = 1.0
    blurred = gaussian_blur(image, 1.5)
    assert blurred.sum(axis=(0, 1)) == pytest.approx([1.0, 1.0, 1.0])
    y, x = np.mgrid[0:21, 0:21]
    assert (x * blurred[..., 0]).sum() == pytest.approx(8.0)
    assert (y * blurred[..., 0]).sum() == pytest.approx(10.0)
    assert ((x - 8) ** 2 * blurred[..., 0]).sum() == pytest.approx(1.5**2, rel=0.01)
