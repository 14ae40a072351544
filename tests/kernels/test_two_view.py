"""The kernel says to the last bit what it says uncompiled, and adds up no more than it is asked to."""

import numpy as np
import pytest

from retrue.kernels import two_view
from tests.kernels.plain import plain

NOTHING = np.empty((2, 0))
NO_TURNS = np.empty((0, 2, 0)), np.empty((0, 2, 0))


def points(count: int) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(3)
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    planes = rng.normal([0, 0, 1], 0.3, (2, 3))
    rays, sigmas = rng.uniform(-0.4, 0.4, (2, count, 2)), rng.uniform(1e-4, 3e-4, (2, count))
    bends, bows = rng.normal(0, 1e-2, (count, 2)), rng.normal(size=(2, 2))
    return R, np.eye(3), planes, *rays, *sigmas, rng.integers(-1, 2, count), bends, bows


def test_compiled_and_plain_residuals_agree_to_the_last_bit() -> None:
    both = np.empty((2, 2, 40))
    for kernel, found in zip((two_view, plain("two_view")), both, strict=True):
        kernel.two_view(*points(40), found, NOTHING, np.empty((0, 2, 0)), *NO_TURNS, np.empty((0, 0, 0)))
    np.testing.assert_array_equal(both[0], both[1])
    assert np.isfinite(both[0, 0]).all()
    assert 0 < np.isnan(both[0, 1]).sum() < 40


def test_compiled_and_plain_sums_agree_to_the_last_bit() -> None:
    rng = np.random.default_rng(4)
    weights, columns = rng.uniform(-0.5, 1, (2, 40)), rng.normal(size=(3, 2, 40))
    blocks = np.zeros((2, 3, 13, 13))
    for kernel, found in zip((two_view, plain("two_view")), blocks, strict=True):
        kernel.two_view(*points(40), NOTHING, weights, columns, *NO_TURNS, found)
    np.testing.assert_array_equal(blocks[0], blocks[1])
    kept = np.where(weights[0] > 0, weights[0], 0)
    expected = np.tril(np.einsum("n,in,jn->ij", kept, columns[:, 0], columns[:, 0]))
    np.testing.assert_allclose(blocks[0, -1, 8:11, 8:11], expected, rtol=1e-12)
    assert not blocks[0, -1, 11:].any()  # a bow moves nothing across the line


def test_rows_are_made_where_the_pose_has_what_the_rays_show() -> None:
    R, axes, planes, x, y, sigma_x, sigma_y, index, bends, bows = points(40)
    weights, found = np.ones((2, 40)), np.empty((2, 2, 40, 2))
    for kernel, corrected in zip((two_view, plain("two_view")), found, strict=True):
        kernel.corrected_rays(*points(40), weights, corrected)
    np.testing.assert_array_equal(found[0], found[1])
    x3, y3 = (np.c_[rays, np.ones(40)] for rays in found[0])
    on = index >= 0
    disparity = (x3 * planes[index]).sum(axis=1) * (1 + (bends * bows[index]).sum(axis=1))
    seen = x3 @ R.T + disparity[:, None] * axes[0]
    np.testing.assert_allclose(y3[on], (seen / seen[:, 2:])[on], rtol=1e-12)
    # Off all planes they move along the gradient of y^T E x, by Sampson's correction.
    E = np.cross(axes[0], R.T).T
    X, Y = np.c_[x, np.ones(40)], np.c_[y, np.ones(40)]
    slopes = np.concatenate([(Y @ E)[:, :2], (X @ E.T)[:, :2]], axis=1)
    variances = np.repeat(np.c_[sigma_x, sigma_y] ** 2, 2, axis=1)
    gain = np.einsum("ni,ij,nj->n", Y, E, X) / (variances * slopes**2).sum(axis=1)
    moved = np.concatenate([x, y], axis=1) - gain[:, None] * variances * slopes
    np.testing.assert_allclose(np.concatenate([*found[0]], axis=1)[~on], moved[~on], atol=1e-12)


def test_turned_rays_and_bows_change_both_residuals_as_finite_differences_say() -> None:
    rng = np.random.default_rng(5)
    camera, projector = rng.normal(size=(2, 20, 2, 3))
    R, axes, planes, x, y, sigma_x, sigma_y, index, bends, bows = points(20)
    index[:] = np.arange(20) % 2
    bent = planes[index] * (1 + (bends * bows[index]).sum(axis=1))[:, None]
    h = np.einsum("nij,nj->ni", R + axes[0][:, None] * bent[:, None, :], np.column_stack([x, np.ones(20)]))
    y = h[:, :2] / h[:, 2:] + rng.normal(0, 1e-7, (20, 2))

    def residuals(step: np.ndarray) -> np.ndarray:
        found = np.empty((2, 20))
        rays = x + camera @ step[:3], np.ascontiguousarray(y + projector @ step[3:6])
        nothing = np.empty((0, 2, 0)), *NO_TURNS, np.empty((0, 0, 0))
        bowed = bends, bows + step[6:]
        two_view.two_view(R, axes, planes, *rays, sigma_x, sigma_y, index, *bowed, found, NOTHING, *nothing)
        return found

    both = residuals(np.zeros(8))
    steps = np.eye(8) * 1e-7
    expected = np.array([(residuals(step) - residuals(-step)) / 2e-7 for step in steps])
    for family in range(2):
        weights = np.zeros((2, 20))
        weights[family] = 1.0
        blocks = np.zeros((2, 3, 17, 17))
        for kernel, found in zip((two_view, plain("two_view")), blocks, strict=True):
            placed = R, axes, planes, x, y, sigma_x, sigma_y, index, bends, bows
            kernel.two_view(*placed, NOTHING, weights, both[None], camera, projector, found)
        np.testing.assert_array_equal(blocks[0], blocks[1])
        found = blocks[0].sum(axis=0)[9:, 9:]
        wanted = np.tril(expected[:, family] @ expected[:, family].T)
        np.testing.assert_allclose(found, wanted, atol=1e-4 * np.abs(wanted).max())


@pytest.mark.parametrize("planes", [0, 2])
def test_what_is_behind_is_what_the_depths_say(planes: int) -> None:
    R, axes, n, x, y, sigma_x, sigma_y, index, *_ = points(200)
    n, index = n[:planes], index if planes else np.zeros(200, dtype=np.int64)
    n = n * np.array([[3.0], [-1.0]])[:planes]
    found = np.empty((2, 200), dtype=np.uint8)
    for kernel, behind in zip((two_view, plain("two_view")), found, strict=True):
        kernel.behind(R, axes, n, x, y, sigma_x, sigma_y, index, 2.0, behind)
    np.testing.assert_array_equal(found[0], found[1])
    for k in range(200):
        v, ray = R @ [*x[k], 1], np.array([*y[k], 1])
        if planes and index[k] >= 0:
            disparity, least = n[index[k]] @ [*x[k], 1], 0.0
            if 1 + n[index[k]] @ R.T @ axes[0] <= 0:
                disparity = -1.0
        else:
            design, target = (axes[0] - ray * axes[0, 2])[:2], (ray * v[2] - v)[:2]
            disparity = design @ target / (design @ design)
            least = -4 * 2.0 * np.hypot(sigma_x[k], sigma_y[k]) / np.linalg.norm(design)
        assert bool(found[0, k]) == (disparity <= least or v[2] + disparity * axes[0, 2] <= 0)
    assert 10 < found[0].sum() < 190


def test_more_columns_than_a_row_holds_are_refused() -> None:
    with pytest.raises(ValueError, match="columns"):
        two_view.two_view(*points(4), NOTHING, np.ones((2, 4)), np.ones((33, 2, 4)), *NO_TURNS, np.zeros((3, 41, 41)))
