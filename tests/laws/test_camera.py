"""The lens model is OpenCV's, over random lenses of every length; its inverse inverts and its slope is its slope."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from retrue.geometry.camera import DISTORTION_LENGTHS, Camera

Floats = NDArray[np.float64]
LENGTHS = pytest.mark.parametrize("length", DISTORTION_LENGTHS)
MILD = np.array([0.3, 0.2, 0.01, 0.01, 0.2, 0.3, 0.2, 0.2, 0.02, 0.02, 0.02, 0.02])
"""Coefficients up to these leave the lens one-to-one within half a focal length of the axis."""
RAYS = 0.5 * np.array([[r * np.cos(a), r * np.sin(a)] for r in (0.0, 0.3, 0.7, 1.0) for a in np.arange(0.1, 6.2, 0.6)])


def cameras(length: int, strength: float = 1.0, count: int = 20) -> Iterator[Camera]:
    """Random lenses, every coefficient away from zero; unequal focal lengths, skew, an axis beside the centre."""
    rng = np.random.default_rng(length)
    for _ in range(count):
        fx, fy, skew, cx, cy = rng.uniform([800, 900, 1, 500, -60], [2000, 1900, 20, 700, 700])
        signs = rng.choice([-1.0, 1.0], length)
        coefficients = strength * MILD[:length] * signs * rng.uniform(0.3, 1, length)
        yield Camera((1280, 960), [[fx, skew, cx], [0, fy, cy], [0, 0, 1]], coefficients)


def opencv_distort(camera: Camera, rays: Floats) -> tuple[Floats, Floats]:
    """Distorted rays (N, 2) and their derivatives (N, 2, 2) by the ray. OpenCV knows no skew, hence K = I."""
    points = np.column_stack([rays, np.ones(len(rays))])
    distorted, jacobian = cv2.projectPoints(points, np.zeros(3), np.zeros(3), np.eye(3), camera.distortion)
    return distorted.reshape(-1, 2), jacobian.reshape(-1, 2, jacobian.shape[1])[:, :, 3:5]  # by tx and ty, at Z = 1


@LENGTHS
def test_distortion_is_opencvs(length: int) -> None:
    for camera in cameras(length):
        assert np.abs(camera.distort(RAYS) - opencv_distort(camera, RAYS)[0]).max() < 1e-14


@LENGTHS
def test_pixels_are_k_times_distorted_rays(length: int) -> None:
    for camera in cameras(length):
        homogeneous = np.column_stack([opencv_distort(camera, RAYS)[0], np.ones(len(RAYS))])
        pixels = (camera.K @ homogeneous.T).T[:, :2]
        assert np.abs(camera.pixels_from_rays(RAYS) - pixels).max() < 1e-10
        for depth in (1e-3, 1.0, 1e6):
            points = depth * np.column_stack([RAYS, np.ones(len(RAYS))])
            assert np.abs(camera.project(points) - pixels).max() < 1e-10
            assert np.isnan(camera.project(-points)).all()


@LENGTHS
def test_undistortion_is_opencvs_converged(length: int) -> None:
    converged = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 500, 1e-15)
    for camera in cameras(length):
        distorted = opencv_distort(camera, RAYS)[0]
        theirs = cv2.undistortPoints(distorted, np.eye(3), camera.distortion, criteria=converged)
        assert np.abs(camera.undistort(distorted) - theirs.reshape(-1, 2)).max() < 1e-12


@LENGTHS
def test_unproject_undoes_project(length: int) -> None:
    for camera in cameras(length):
        assert np.abs(camera.unproject(camera.pixels_from_rays(RAYS)) - RAYS).max() < 1e-13
        pixels = RAYS @ [[1000, 0], [0, 700]] + [640, 480]
        assert np.abs(camera.normalise(pixels) @ camera.K[:2, :2].T + camera.K[:2, 2] - pixels).max() < 1e-10


@LENGTHS
def test_jacobian_is_opencvs(length: int) -> None:
    for camera in cameras(length):
        theirs = camera.K[:2, :2] @ opencv_distort(camera, RAYS)[1]
        assert np.abs(camera.ray_jacobian(RAYS) / theirs.max() - theirs / theirs.max()).max() < 1e-13


@LENGTHS
def test_jacobian_is_the_slope_of_the_pixels(length: int) -> None:
    step = 1e-4
    for camera in cameras(length):
        for axis in range(2):
            aside = step * np.eye(2)[axis]
            # Four points, so that the error is of the order of step^4.
            slope = (
                8 * (camera.pixels_from_rays(RAYS + aside) - camera.pixels_from_rays(RAYS - aside))
                - (camera.pixels_from_rays(RAYS + 2 * aside) - camera.pixels_from_rays(RAYS - 2 * aside))
            ) / (12 * step)
            assert np.abs(camera.ray_jacobian(RAYS)[..., axis] - slope).max() < 1e-8 * camera.K[0, 0]


@pytest.mark.parametrize("length", DISTORTION_LENGTHS[1:])
@pytest.mark.parametrize("strength", [3.0, 10.0])
def test_wild_lenses_answer_truly_or_not_at_all(length: int, strength: float) -> None:
    answered = []
    for camera in cameras(length, strength):
        distorted = 4 * RAYS
        rays = camera.undistort(distorted)
        there = np.isfinite(rays).all(axis=1)
        assert (there == np.isfinite(rays).any(axis=1)).all()
        assert np.abs(opencv_distort(camera, rays[there])[0] - distorted[there]).max(initial=0) < 1e-9
        assert (np.linalg.det(camera.ray_jacobian(rays[there])) > 0).all()
        answered.append(there.mean())
    assert 0 < np.mean(answered) < 1


@pytest.mark.parametrize("k1", [-0.1, -0.3, -1.0])
def test_the_fold_of_a_barrel_is_where_calculus_says(k1: float) -> None:
    camera = Camera((640, 480), np.eye(3), [k1, 0, 0, 0])
    fold = np.sqrt(-1 / (3 * k1))  # where d (r + k1 r^3) / dr = 0
    edge = fold * 2 / 3
    direction = np.array([0.6, 0.8])
    inside = camera.undistort(direction * edge * np.array([0.5, 0.9, 0.999])[:, None])
    assert (np.linalg.norm(inside, axis=1) < fold).all()
    assert np.abs(camera.distort(inside) - direction * edge * np.array([0.5, 0.9, 0.999])[:, None]).max() < 1e-12
    assert np.isnan(camera.undistort(direction * edge * np.array([1.001, 1.5, 10])[:, None])).all()


def test_four_coefficients_are_five_with_a_zero() -> None:
    four, five = (Camera((9, 9), np.eye(3), c) for c in ([0.1, -0.2, 0.03, 0.04], [0.1, -0.2, 0.03, 0.04, 0]))
    assert np.array_equal(four.distort(RAYS), five.distort(RAYS))


@LENGTHS
def test_stacks_of_rays_are_rays(length: int) -> None:
    stack = RAYS.reshape(4, -1, 2)
    for camera in cameras(length, count=1):
        pixels = camera.pixels_from_rays(stack)
        for answer, flat in (
            (pixels, camera.pixels_from_rays(RAYS)),
            (camera.unproject(pixels), camera.unproject(camera.pixels_from_rays(RAYS))),
            (camera.ray_jacobian(stack), camera.ray_jacobian(RAYS)),
        ):
            assert np.array_equal(answer, flat.reshape(4, -1, *flat.shape[1:]))


@LENGTHS
def test_a_point_is_seen_where_its_pixel_is_in_the_picture(length: int) -> None:
    for camera in cameras(length):
        points = np.column_stack([RAYS, np.ones(len(RAYS))])
        inside = camera.contains(camera.project(points))
        assert inside.any()
        assert not inside.all()
        assert (camera.sees(7 * points.reshape(2, -1, 3)) == inside.reshape(2, -1)).all()
        assert not camera.sees(-points).any()
        assert bool(camera.sees(points[0])) == inside[0]
