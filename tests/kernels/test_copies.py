"""The kernel says what it says uncompiled, and what NumPy says."""

import numpy as np
import pytest

from retrue.kernels import copies
from tests.kernels.plain import plain

KERNELS = copies, plain("copies")


@pytest.mark.parametrize("strips", [2, 7, 64])
@pytest.mark.parametrize("reach", [0.02, 0.6, 30.0])
def test_those_shifted_as_most_are(strips: int, reach: float) -> None:
    rng, focals = np.random.default_rng(2), np.array([1.0, 4.0])
    seen = np.empty((2, 4, 100))
    for places, focal in zip(seen.reshape(4, 2, 100), np.tile(focals, 2), strict=True):
        places[:] = np.concatenate([rng.normal(size=(2, 50)), rng.integers(0, 4, (2, 50)) * reach], axis=1) * focal
        places[:, 3], places[0, 7], places[0, 12] = np.nan, np.inf, -np.inf
    every = 3
    for kernel in KERNELS:
        room = np.empty(strips + 2, dtype=np.int64), np.empty((4, 100))
        members, missed = np.zeros((2, 4, 100), dtype=np.uint8), np.empty((2, 4, 100, 2))
        counts = np.zeros((2, 4), dtype=np.int64)
        kernel.of_shifts(seen, reach, focals, 100 // every, *room, members, missed, counts)
        assert not members[:, :2].any()
        for (p, device), focal in zip(np.ndindex(2, 2), np.tile(focals, 2), strict=True):
            places = seen[p, 2 * device : 2 * device + 2]
            with np.errstate(invalid="ignore"):
                near = (np.abs(places[:, :, None] - places[:, None]) < reach * focal).all(axis=0)
            expected = near[every * int(np.argmax(near[::every].sum(axis=1)))]
            np.testing.assert_array_equal(members[p, 2 + device], expected)
            middle = np.median(places[:, expected], axis=1)
            moved = np.abs(middle).max() > reach * focal
            assert counts[p, 2 + device] == (expected.sum() if moved else 0)
            off = missed[p, 2 + device][expected]
            np.testing.assert_allclose(off, (places[:, expected].T - middle) / focal, atol=1e-12)
        lost = np.full((1, 4, 5), np.nan)
        few = members[:1, :, :5].copy(), missed[:1, :, :5].copy(), np.ones((1, 4), dtype=np.int64)
        kernel.of_shifts(lost, reach, focals, 1, *room, *few)
        assert not few[0][:, 2:].any()
        assert not few[2][:, 2:].any()


def bent_view() -> tuple[np.ndarray, ...]:
    """Rows of 30 points, their rays, a pose, planes of which one is bent, and by what share that is, at each row."""
    rng = np.random.default_rng(3)
    rows, x, y = rng.permutation(30)[:20], rng.uniform(-0.5, 0.5, (30, 2)), rng.uniform(-0.5, 0.5, (30, 2))
    angle = 0.3
    R = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    planes, t = np.array([[0.1, 0.2, 0.9], [-0.3, 0.1, 0.5]]), np.array([-0.9, 0.1, 0.2])
    bends = np.zeros((2, 14))
    bends[:, 2:4] = 1.0
    bends[1] = [0.1, -0.2, 0.5, 0.4, *rng.normal(0, 0.02, 10)]
    u, v = ((x[rows] - bends[1, :2]) / bends[1, 2:4]).T
    monomials = [u**0, u, v, u * u, u * v, v * v, u**3, u * u * v, u * v * v, v**3]
    return rows, x, y, R, t, planes, bends, np.stack([np.zeros(20), bends[1, 4:] @ monomials])


def test_what_devices_see_through_planes() -> None:
    rows, x, y, R, t, planes, bends, bent = bent_view()
    found = []
    for kernel in KERNELS:
        forth, back = np.empty((2, 2, 20, 3))
        kernel.through_planes(rows, x, y, R, t, planes, bends, forth, back)
        found.append((forth, back))
    np.testing.assert_array_equal(*found)
    for p, n in enumerate(planes):
        for k, row in enumerate(rows):
            H = R + (1 + bent[p, k]) * np.outer(t, n)
            np.testing.assert_allclose(found[0][0][p, k], H @ [*x[row], 1])
            np.testing.assert_allclose(H @ found[0][1][p, k], [*y[row], 1])


def test_the_step_that_puts_a_point_where_it_is() -> None:
    rows, x, y, _, _, planes, _, _ = bent_view()
    rng, found = np.random.default_rng(4), []
    pixels, seen = rng.uniform(0, 100, (2, 30, 2)), rng.uniform(0, 100, (2, 2, 20, 2))
    forth = np.concatenate([rng.uniform(-0.5, 0.5, (2, 20, 2)), rng.uniform(0.9, 1.1, (2, 20, 1))], axis=2)
    for kernel in KERNELS:
        of_each = np.empty((2, 13, 20)), np.empty((2, 4, 20))
        for one in of_each:  # where nobody asks for steps, there are none
            kernel.shifts(rows, x, y, *pixels, planes, forth, seen, one)
        np.testing.assert_array_equal(of_each[0][:, :4], of_each[1])
        found.append(of_each[0])
    np.testing.assert_array_equal(*found)
    for p, one in enumerate(found[0]):
        np.testing.assert_array_equal(one[:2].T, pixels[1, rows] - seen[0, p])
        np.testing.assert_array_equal(one[2:4].T, pixels[0, rows] - seen[1, p])
        np.testing.assert_array_equal(one[4:7].T, forth[p])
        gap = y[rows] - forth[p, :, :2] / forth[p, :, 2:]
        np.testing.assert_array_equal(one[12], np.abs(gap).max(axis=1))
        for axis in (0, 1):
            weight, length, angle = one[7 + axis], np.exp(one[9]), one[10 + axis]
            step = length[:, None] * np.roll(np.column_stack([np.cos(angle), np.sin(angle)]), axis, axis=1)
            moved = forth[p, :, :2] + weight[:, None] * step
            np.testing.assert_allclose(moved / forth[p, :, 2:], y[rows])
            assert (np.abs(angle) <= np.pi / 2).all()
            np.testing.assert_allclose(np.abs(weight), np.abs(x[rows] @ planes[p, :2] + planes[p, 2]))


def test_one_step_is_that_of_the_points_that_share_it() -> None:
    rng, noise = np.random.default_rng(5), 1e-3
    forth = np.column_stack([rng.uniform(-0.5, 0.5, (60, 2)), np.full(60, 1.0)])
    inverse_depth, step = rng.uniform(0.8, 1.2, 60), np.array([0.1, -0.05, 0.02])
    there = forth + inverse_depth[:, None] * step
    there[40:] = forth[40:] + inverse_depth[40:, None] * [0.0, 0.3, 0.0]  # fewer have another one
    y = there[:, :2] / there[:, 2:] + rng.normal(0, 1e-4, (60, 2))
    y[55:] = forth[55:, :2]  # or none
    n = np.array([[0.0, 0.0, 1.0]])
    seen, found = np.empty((1, 13, 60)), []
    copies.shifts(np.arange(60), forth[:, :2].copy(), y, y, y, n, forth[None], np.zeros((2, 1, 60, 2)), seen)
    seen[0, 7:9] *= inverse_depth  # as if the plane were turned
    seen[0, 9] -= np.log(inverse_depth)
    for kernel in KERNELS:
        members, missed = np.full((1, 4, 60), 7, dtype=np.uint8), np.full((1, 4, 60, 2), 7.0)
        counts, room = np.full((1, 4), 7), (np.empty(66, dtype=np.int64), np.empty((4, 60)))
        more = np.empty((3, 60), dtype=np.uint8), np.empty((60, 2))
        kernel.of_steps(y.T.copy(), seen, noise, 50, 6, *room, *more, members, missed, counts)
        np.testing.assert_array_equal(members[0, :2], np.tile(np.arange(60) < 40, (2, 1)))
        np.testing.assert_array_equal(counts, [[40, 40, 7, 7]])  # those of shifts are not touched
        assert (members[0, 2:] == 7).all()
        assert np.abs(missed[0, :2, :40]).max() < 5e-4
        found.append((members, missed))
        few = np.ascontiguousarray(seen[:, :, 38:43]), np.full((1, 4), 7)
        kernel.of_steps(y.T[:, 38:43].copy(), few[0], noise, 50, 6, *room, *more, members, missed, few[1])
        assert (few[1][0, :2] == 0).all()  # five are no copy
    for compiled, uncompiled in zip(*found, strict=True):
        np.testing.assert_array_equal(compiled, uncompiled)


def test_the_shift_that_most_agree_with() -> None:
    rng = np.random.default_rng(4)
    gradient, right = rng.normal(size=(2, 40)), np.array([3.0, -5.0])
    missed = right @ gradient + rng.normal(0, 0.01, 40)
    missed[::3], missed[7] = rng.normal(0, 5, 14), np.nan
    drawn = np.arange(1, 40, 3)
    pairs = np.array([(i, j) for k, i in enumerate(drawn) for j in drawn[k + 1 :] if 7 not in (i, j)])
    shifts = np.linalg.solve(gradient.T[pairs], missed[pairs][..., None])[..., 0]
    counts = (np.abs(missed - shifts @ gradient) < 0.05).sum(axis=1)
    for kernel in KERNELS:
        shift, parallel = np.empty(2), np.empty(2)
        assert kernel.shift_of_most(gradient, missed, drawn, 0.05, shift) == counts.max() > 20
        np.testing.assert_allclose(shift, shifts[np.argmax(counts)], rtol=1e-6)
        along = np.stack([np.zeros(40), gradient[1]])  # what nothing tells of is left as it is
        assert kernel.shift_of_most(along, -5 * gradient[1], drawn, 0.05, parallel) == 40
        np.testing.assert_allclose(parallel, [0, -5], atol=1e-6)
        assert kernel.shift_of_most(gradient, missed, drawn[:1], 0.05, shift) == -1  # one tells none
