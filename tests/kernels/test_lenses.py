"""The kernel says what it says uncompiled; the rays are the camera's, and they turn as finite differences say."""

import numpy as np
import pytest

from retrue.geometry.camera import Camera
from retrue.kernels import lenses
from retrue.recalibration.lens import changed_device, lens_numbers
from tests.kernels.plain import plain

LENS = [-0.2, 0.1, 1e-3, -2e-3, 0.05, 0.1, 0.02, 0.01, 1e-3, -1e-3, 2e-3, 1e-3]


@pytest.mark.parametrize("coefficients", [0, 5, 8, 12])
def test_rays_of_changed_lenses_and_how_they_turn(coefficients: int) -> None:
    device = Camera((1280, 960), [[1500, 2, 640], [0, 1490, 480], [0, 0, 1]], LENS[:coefficients])
    change = np.array([0.03, 4.0, -3.0, 0.02])
    pixels = np.random.default_rng(0).uniform([0, 0], [1280, 960], (30, 2))
    own, moved, found = lens_numbers(device, np.zeros(4)), lens_numbers(device, change), []
    for kernel in (lenses, plain("lenses")):
        rays, turns, sigma = device.unproject(pixels), np.zeros((30, 2, 4)), np.ones(30)
        kernel.in_pixels(*own, rays, sigma)
        kernel.move_rays(*moved, pixels, rays, sigma)
        kernel.turns_of_rays(*moved, rays, turns)
        found.append((rays, turns, sigma))
    for compiled, uncompiled in zip(*found, strict=True):
        np.testing.assert_array_equal(compiled, uncompiled)
    rays, turns, sigma = found[0]
    before = np.linalg.det(device.ray_jacobian(device.unproject(pixels)))
    np.testing.assert_allclose(sigma**2, before / np.linalg.det(changed_device(device, change).ray_jacobian(rays)))
    np.testing.assert_allclose(rays, changed_device(device, change).unproject(pixels), atol=1e-13)
    for k, step in enumerate(np.diag([1e-5, 1e-2, 1e-2, 1e-5])):
        ahead, back = (changed_device(device, change + sign * step).unproject(pixels) for sign in (1, -1))
        np.testing.assert_allclose(turns[:, :, k], (ahead - back) / (2 * step[k]), atol=1e-8)


def test_a_pixel_that_no_ray_maps_to_goes_far() -> None:
    device = Camera((100, 100), [[100, 0, 50], [0, 100, 50], [0, 0, 1]], [-1.0, 0, 0, 0, 0])
    rays = np.zeros((1, 2))
    lenses.move_rays(*lens_numbers(device, np.zeros(4)), np.array([[150.0, 50.0]]), rays, np.ones(1))
    np.testing.assert_array_equal(rays, [[1e3, 1e3]])


def test_rays_that_a_lens_distorts_and_back() -> None:
    lens, rng = np.array(LENS), np.random.default_rng(1)
    rays, distorted, back = np.zeros((3, 2, 40, 2))
    rays[:] = rng.uniform(-0.5, 0.5, (40, 2))
    for index, kernel in enumerate((lenses, plain("lenses"))):
        kernel.distort(lens, rays[index], distorted[index])
        distorted[index, :2] = [[np.nan, 0.0], [40.0, 30.0]]  # of the second, the model knows no ray
        with np.errstate(all="ignore"):
            kernel.undistort(lens, distorted[index], np.empty((40, 2)), back[index])
    np.testing.assert_array_equal(distorted[0], distorted[1])
    np.testing.assert_array_equal(back[0], back[1])
    assert np.isnan(back[0, :2]).all()
    np.testing.assert_allclose(back[0, 2:], rays[0, 2:], atol=1e-13)
    x, y = rays[0, 2:].T
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = LENS
    r2 = x * x + y * y
    radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
    expected = [
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + s1 * r2 + s2 * r2**2,
        y * radial + 2 * p2 * x * y + p1 * (r2 + 2 * y * y) + s3 * r2 + s4 * r2**2,
    ]
    np.testing.assert_allclose(distorted[0, 2:].T, expected, rtol=1e-13)


@pytest.mark.parametrize("coefficients", [0, 5, 12])
def test_pixels_of_points(coefficients: int) -> None:
    device = Camera((1280, 960), [[1500, 2, 640], [0, 1490, 480], [0, 0, 1]], LENS[:coefficients])
    points, found = np.random.default_rng(4).uniform([-0.5, -0.4, 0.8], [0.5, 0.4, 1.5], (30, 3)), []
    points[:3, 2] = [0.0, -1.0, np.nan]
    lens = np.append(device.distortion, np.zeros(12 - len(device.distortion)))
    for kernel in (lenses, plain("lenses")):
        pixels = np.zeros((30, 2))
        kernel.project(device.K, lens, coefficients > 0, points, pixels)
        found.append(pixels)
    np.testing.assert_array_equal(found[0], found[1])
    assert np.isnan(found[0][:3]).all()
    expected = device.pixels_from_rays(points[3:, :2] / points[3:, 2:])
    np.testing.assert_allclose(found[0][3:], expected, rtol=1e-14)
    np.testing.assert_array_equal(device.project(points), found[0])
