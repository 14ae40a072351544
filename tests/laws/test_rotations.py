"""Rigid transforms form a group; rotations and angles keep their digits from the identity to half a turn."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from retrue.errors import InputError
from retrue.geometry.transform import (
    RigidTransform,
    direction_angle,
    nearest_rotation,
    rotation_angle,
    rotation_from_vector,
    skew,
    vector_from_rotation,
)

Floats = NDArray[np.float64]
RNG = np.random.default_rng(11)
AXES = [*np.eye(3), -np.eye(3)[2], *(v / np.linalg.norm(v) for v in RNG.normal(size=(12, 3)))]
SMALL = [1e-150, 1e-15, 1e-12, 1e-9, 1e-6, 1e-4, 1e-3, 0.03]
BELOW_PI = [np.pi - gap for gap in (1e-12, 1e-9, 1e-6, 1e-4, 1e-3, 0.03)]
ANGLES = [*SMALL, 0.5, 1.0, np.pi / 2, 2.0, 3.0, *BELOW_PI]
POINTS = RNG.normal(scale=1000, size=(7, 3))


def transforms(count: int = 40) -> list[RigidTransform]:
    """Any rotation, and translations as far as a rig's; the near-identity and near-half turns too."""
    turns = [RNG.choice(ANGLES) * AXES[RNG.integers(len(AXES))] for _ in range(count)]
    return [RigidTransform.from_rotation_vector(turn, RNG.normal(scale=500, size=3)) for turn in turns]


def off(a: RigidTransform, b: RigidTransform) -> float:
    """The larger of the differences of R and of t / 1000."""
    return max(np.abs(a.R - b.R).max(), np.abs(a.t - b.t).max() / 1000)


NOTHING = RigidTransform(np.eye(3), np.zeros(3))
TRIPLES = list(zip(transforms(), transforms(), transforms(), strict=True))


def test_transforms_are_a_group() -> None:
    for a, b, c in TRIPLES:
        assert off((a @ b) @ c, a @ (b @ c)) < 1e-14
        assert off(a @ NOTHING, a) == off(NOTHING @ a, a) == 0
        assert off(a @ a.inverse(), NOTHING) < 1e-14
        assert off(a.inverse() @ a, NOTHING) < 1e-14
        assert off(a.inverse().inverse(), a) < 1e-14
        assert off((a @ b).inverse(), b.inverse() @ a.inverse()) < 1e-14


def test_the_group_acts_on_points() -> None:
    for a, b, _ in TRIPLES:
        assert np.abs((a @ b).apply(POINTS) - a.apply(b.apply(POINTS))).max() < 1e-11
        assert np.abs(a.inverse().apply(a.apply(POINTS)) - POINTS).max() < 1e-11
        apart = np.linalg.norm(POINTS[:, None] - POINTS, axis=-1)
        moved = a.apply(POINTS)
        assert np.abs(np.linalg.norm(moved[:, None] - moved, axis=-1) - apart).max() < 1e-11
        assert np.abs(moved[0] - (a.R @ POINTS[0] + a.t)).max() < 1e-12 * 1000


@pytest.mark.parametrize("angle", [0.0, *ANGLES, np.pi, 4.0, 6.5, -2.0])
def test_rotation_from_vector_is_the_matrix_exponential(angle: float) -> None:
    for axis in AXES:
        R = rotation_from_vector(angle * axis)
        assert np.abs(R - expm(skew(angle * axis))).max() < 1e-13
        assert np.abs(R @ R.T - np.eye(3)).max() < 1e-14
        assert np.linalg.det(R) == pytest.approx(1, abs=1e-14)
        assert np.abs(R @ axis - axis).max() < 1e-14
        assert np.abs(R @ rotation_from_vector(-angle * axis) - np.eye(3)).max() < 1e-14


@pytest.mark.parametrize("angle", ANGLES)
def test_vector_from_rotation_keeps_its_digits(angle: float) -> None:
    for axis in AXES:
        found = vector_from_rotation(rotation_from_vector(angle * axis))
        assert np.abs(found - angle * axis).max() < 1e-14 * angle


@pytest.mark.parametrize("angle", [0.0, np.pi])
def test_vector_from_rotation_at_the_ends(angle: float) -> None:
    for axis in AXES:
        found = vector_from_rotation(rotation_from_vector(angle * axis))
        assert np.linalg.norm(found) == pytest.approx(angle, abs=1e-15)
        assert min(np.abs(found - angle * axis).max(), np.abs(found + angle * axis).max()) < 1e-14


@pytest.mark.parametrize("angle", ANGLES)
def test_rotation_angle_keeps_its_digits(angle: float) -> None:
    for axis in AXES:
        R = rotation_from_vector(angle * axis)
        assert rotation_angle(R) == pytest.approx(angle, rel=1e-14, abs=0)
        assert rotation_angle(R.T) == pytest.approx(angle, rel=1e-14, abs=0)
        assert np.pi - rotation_angle(R) == pytest.approx(np.pi - angle, abs=2e-15)


def test_rotation_angle_at_the_ends() -> None:
    assert rotation_angle(np.eye(3)) == 0
    assert rotation_angle(np.diag([1.0, -1.0, -1.0])) == np.pi


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("scales", [(1.0, 1.0), (1e-6, 1e9), (1e-200, 1e-200), (1e200, 1e200)])
def test_direction_angle_keeps_its_digits(angle: float, scales: tuple[float, float]) -> None:
    for axis in AXES:
        a = np.cross(axis, [0.3, -0.5, 0.8])
        a /= np.linalg.norm(a)
        b = np.cos(angle) * a + np.sin(angle) * np.cross(axis, a)  # a turned about the axis
        found = direction_angle(scales[0] * a, scales[1] * b)
        assert found == pytest.approx(angle, abs=1e-15)
        assert found == direction_angle(scales[1] * b, scales[0] * a)


@pytest.mark.parametrize("angle", SMALL)
def test_direction_angle_keeps_the_digits_of_small_angles(angle: float) -> None:
    assert direction_angle([2, 0, 0], [3 * np.cos(angle), 0, 3 * np.sin(angle)]) == pytest.approx(angle, rel=1e-14)
    nearly_back = direction_angle([2, 0, 0], [-3 * np.cos(angle), 0, 3 * np.sin(angle)])
    assert np.pi - nearly_back == pytest.approx(angle, rel=1e-14, abs=1e-15)


def test_direction_angle_of_nothing_is_nan() -> None:
    for a, b in (([0, 0, 0], [1, 0, 0]), ([1, 0, 0], [0, 0, 0]), ([np.nan, 0, 1], [1, 0, 0])):
        assert np.isnan(direction_angle(a, b))


def test_nearest_rotation_is_a_rotation_and_the_nearest() -> None:
    near = [rotation_from_vector(0.02 * axis) for axis in AXES]
    for matrix in RNG.normal(size=(60, 3, 3)):
        R = nearest_rotation(matrix)
        assert np.abs(R @ R.T - np.eye(3)).max() < 1e-14
        assert np.linalg.det(R) == pytest.approx(1, abs=1e-14)
        others = [*(R @ turn for turn in near), *(rotation_from_vector(3 * axis) for axis in AXES)]
        assert np.linalg.norm(matrix - R) < min(np.linalg.norm(matrix - other) for other in others)


def test_nearest_rotation_leaves_rotations_and_drops_stretch() -> None:
    for a, b, _ in TRIPLES:
        stretch = b.R @ np.diag([0.5, 1.0, 3.0]) @ b.R.T
        assert np.abs(nearest_rotation(a.R) - a.R).max() < 1e-14
        assert np.abs(nearest_rotation(a.R @ stretch) - a.R).max() < 1e-13


def test_rounding_is_removed_and_no_more() -> None:
    for a, _, _ in TRIPLES:
        mended = RigidTransform(a.R.round(5), a.t)
        assert np.abs(mended.R @ mended.R.T - np.eye(3)).max() < 1e-14
        assert np.abs(mended.R - a.R).max() < 2e-5
        for broken in (-a.R, a.R.round(5) * 1.001, a.R @ np.diag([1.0, 1.0, -1.0]), np.nan * a.R):
            with pytest.raises(InputError, match="rotation R"):
                RigidTransform(broken, a.t)


def test_skew_is_the_cross_product() -> None:
    for a, b in zip(POINTS, POINTS[::-1], strict=True):
        assert np.abs(skew(a) @ b - np.cross(a, b)).max() < 1e-9  # of 1e6
