"""Where rays meet: the kernel says to the last bit what it says uncompiled, and meets both conditions of the best."""

import numpy as np
import pytest

from retrue.geometry.transform import RigidTransform, skew
from retrue.kernels import triangulation
from tests.kernels.plain import plain


@pytest.mark.parametrize("each", [False, True])
def test_compiled_and_plain_points_agree(each: bool) -> None:
    rng = np.random.default_rng(0)
    pose = RigidTransform.from_rotation_vector([0.05, -0.2, 0.02], [0.35, -0.04, 0.06])
    X = np.column_stack([rng.uniform(-0.4, 0.4, (50, 2)), rng.uniform(1.2, 2.0, 50)])
    X[:5, 2] *= -1
    Y = pose.apply(X)
    x, y = (np.ascontiguousarray(P[:, :2] / P[:, 2:]) + rng.normal(0, 1e-3, (50, 2)) for P in (X, Y))
    variances = rng.uniform(1, 2, (2, 50 if each else 1))
    found = np.empty((2, 50, 3))
    E = skew(pose.t) @ pose.R
    for kernel, points in zip((triangulation, plain("triangulation")), found, strict=True):
        kernel.triangulate(pose.R, pose.t, E, x, y, *variances, 1e-12, points)
    np.testing.assert_array_equal(found[0], found[1])
    assert np.isnan(found[0, :5]).all()
    points = found[0, 5:]
    assert np.abs(points - X[5:]).max() < 0.05
    # The corrections are parallel to the normals at the corrected rays, each by its variance.
    p, q = points[:, :2] / points[:, 2:], pose.apply(points)
    q = q[:, :2] / q[:, 2:]
    normal = np.column_stack([np.c_[q, np.ones(45)] @ E[:, :2], np.c_[p, np.ones(45)] @ E.T[:, :2]])
    corrections = np.column_stack([x[5:] - p, y[5:] - q])
    spread = np.repeat(np.broadcast_to(variances, (2, 50))[:, 5:].T, 2, axis=1)
    factor = (corrections * normal).sum(axis=1) / (spread * normal**2).sum(axis=1)
    assert np.abs(corrections - factor[:, None] * spread * normal).max() < 1e-7


def test_how_far_rays_miss_each_other_and_homographies() -> None:
    rng = np.random.default_rng(1)
    E, H = rng.normal(size=(3, 3)), np.eye(3) + rng.normal(0, 0.1, (2, 3, 3))
    x, y, (sx, sy) = *rng.uniform(-0.4, 0.4, (2, 30, 2)), rng.uniform(1, 2, (2, 30))
    plane = np.arange(30) % 3 - 1
    distances, missed = np.empty((2, 30)), np.empty((2, 30, 2))
    for index, kernel in enumerate((triangulation, plain("triangulation"))):
        kernel.sampson(E, x, y, sx, sy, distances[index])
        kernel.missed(H, plane, x, y, sx, sy, missed[index])
    np.testing.assert_array_equal(distances[0], distances[1])
    np.testing.assert_array_equal(missed[0], missed[1])
    x1, y1 = np.column_stack([x, np.ones(30)]), np.column_stack([y, np.ones(30)])
    slopes = np.column_stack([sx[:, None] * (y1 @ E)[:, :2], sy[:, None] * (x1 @ E.T)[:, :2]])
    np.testing.assert_allclose(distances[0], (y1 @ E * x1).sum(axis=1) / np.linalg.norm(slopes, axis=1), rtol=1e-9)
    for k in range(30):
        if plane[k] < 0:
            assert np.isnan(missed[0, k]).all()
            continue
        there = H[plane[k]] @ x1[k]
        moved = (H[plane[k]][:2] - np.outer(there[:2] / there[2], H[plane[k]][2]))[:, :2] / there[2]
        values, axes = np.linalg.eigh(sy[k] ** 2 * np.eye(2) + sx[k] ** 2 * moved @ moved.T)
        whitened = axes / np.sqrt(values) @ axes.T @ (y[k] - there[:2] / there[2])
        np.testing.assert_allclose(missed[0, k], whitened, rtol=1e-9)
