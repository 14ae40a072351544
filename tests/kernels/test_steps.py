"""A step: equations, solution and pose are what NumPy makes of the same sums, compiled and plain."""

import numpy as np
import pytest

from retrue.geometry.transform import rotation_from_vector
from retrue.kernels import steps
from tests.kernels.plain import plain

BOTH = steps, plain("steps")


@pytest.mark.parametrize("lenses", [0, 8])
def test_blocks_are_put_where_their_unknowns_are(lenses: int) -> None:
    rng = np.random.default_rng(0)
    planes, bows = rng.normal(size=(2, 3)), rng.normal(size=(2, 3))
    width = 9 + lenses + 3
    full = rng.normal(size=(3, width, width))
    full = full @ full.transpose(0, 2, 1)
    size = 5 + 6 + lenses + 6
    expected, slope = np.zeros((size, size)), np.zeros(size)
    for k, block in enumerate(full):
        lens = [*range(11, 11 + lenses)]
        here = [*range(5), *([5, 6, 7] if k < 2 else []), *range(9, 9 + lenses)]
        there = [*range(5), *([5 + 3 * k, 6 + 3 * k, 7 + 3 * k] if k < 2 else []), *lens]
        if k < 2:
            here += [*range(9 + lenses, width)]
            there += [*range(11 + lenses + 3 * k, 14 + lenses + 3 * k)]
        expected[np.ix_(there, there)] += block[np.ix_(here, here)]
        slope[there] += block[here, 8]
    expected[range(5, 11), range(5, 11)] *= 1 + 1e-9
    expected[range(5, 11), range(5, 11)] += np.repeat(1 / (planes**2).sum(axis=1), 3)
    bowed = range(11 + lenses, size)
    expected[bowed, bowed] += 1
    slope[bowed] += bows.ravel()
    for kernel in BOTH:
        information, gradient = np.full((size, size), np.nan), np.full(size, np.nan)
        kernel.assemble(planes, bows, np.tril(full), information, gradient)
        np.testing.assert_allclose(information, expected, rtol=1e-12)
        np.testing.assert_allclose(gradient, slope, rtol=1e-12)


def test_equations_of_any_scale_are_solved() -> None:
    rng = np.random.default_rng(1)
    root = rng.normal(size=(7, 12)) * np.logspace(-4, 4, 7)[:, None]
    information, right = root @ root.T, rng.normal(size=(7, 2)) * np.logspace(-4, 4, 7)[:, None]
    for damping in (0.0, 0.1):
        found = np.empty((2, 7, 2))
        for kernel, solution in zip(BOTH, found, strict=True):
            assert kernel.solve(information, right, damping, np.empty((7, 9)), solution)
        np.testing.assert_array_equal(found[0], found[1])
        damped = information + damping * np.diag(np.diag(information))
        scale = np.sqrt(np.diag(damped))
        expected = np.linalg.solve(damped / np.outer(scale, scale), right / scale[:, None]) / scale[:, None]
        np.testing.assert_allclose(found[0], expected, rtol=1e-9)


@pytest.mark.parametrize("hopeless", [np.zeros((3, 3)), np.ones((3, 3)), np.full((3, 3), np.nan), -np.eye(3)])
def test_what_nothing_determines_is_not_solved(hopeless: np.ndarray) -> None:
    for kernel in BOTH:
        assert not kernel.solve(hopeless, np.ones((3, 1)), 0.0, np.empty((3, 4)), np.empty((3, 1)))


@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-3, 2.0])
def test_a_pose_is_turned_and_stays_one(size: float) -> None:
    rng = np.random.default_rng(2)
    R, step = np.linalg.qr(rng.normal(size=(3, 3)))[0], size * rng.normal(size=8)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    for kernel in BOTH:
        turned, t = np.empty((3, 3)), np.empty(3)
        kernel.turned(R, axes, step, turned, t)
        np.testing.assert_allclose(turned, rotation_from_vector(step[:3]) @ R, atol=1e-15)
        moved = axes[0] + step[3] * axes[1] + step[4] * axes[2]
        np.testing.assert_allclose(t, moved / np.linalg.norm(moved), atol=1e-15)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, 3.1, np.pi])
def test_differences_of_poses_are_rotation_vectors_and_angles_between_directions(angle: float) -> None:
    rng = np.random.default_rng(3)
    R, axis, t = rotation_from_vector(rng.normal(size=3)), unit(rng), unit(rng)
    found, axes = np.empty((2, 5)), np.empty((3, 3))
    steps.axes(unit(rng), axes)
    for kernel, step in zip(BOTH, found, strict=True):
        kernel.difference(R, t, rotation_from_vector(angle * axis) @ R, axes, step)
    np.testing.assert_allclose(found[0], found[1], rtol=1e-14)
    np.testing.assert_allclose(rotation_from_vector(found[0, :3]), rotation_from_vector(angle * axis), atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(found[0, :3]), angle, atol=1e-8)
    np.testing.assert_allclose(np.linalg.norm(found[0, 3:]), np.arccos(axes[0] @ t), rtol=1e-9)
    across = -(axes[1:] @ t)
    np.testing.assert_allclose(found[0, 3:] / np.linalg.norm(found[0, 3:]), across / np.linalg.norm(across), rtol=1e-9)


def test_planes_are_those_of_their_homographies() -> None:
    rng = np.random.default_rng(4)
    R, t, planes = rotation_from_vector(rng.normal(size=3)), unit(rng), rng.normal(size=(3, 3))
    homographies, found = R + t[:, None] * planes[:, None], np.empty((2, 3, 3))
    for kernel, one in zip(BOTH, found, strict=True):
        kernel.planes_of_pose(R, t, homographies * rng.uniform(-3, 3, (3, 1, 1)), one)
        np.testing.assert_allclose(one, planes, rtol=1e-9)


def unit(rng: np.random.Generator) -> np.ndarray:
    """A direction."""
    t = rng.normal(size=3)
    return np.asarray(t / np.linalg.norm(t))
