"""The error of a plane on a bent field, from the slopes of its neighbours."""

import numpy as np
import pytest

from retrue.decoding.gray.bend import plane_bias

CELL = 4


@pytest.mark.parametrize("along", [0, 1])
@pytest.mark.parametrize("bent", [(0.01, 0.0, 0.0), (0.0, -0.02, 0.0), (0.01, 0.004, 0.006)])
def test_it_is_exact_for_a_field_of_degree_two(along, bent):
    # n = xx/2 x^2 + yy/2 y^2 + xy x y, x along the axis of comparison
    xx, yy, xy = bent
    rows, columns = np.indices((20, 24)) * float(CELL)
    x, y = (rows, columns) if along == 0 else (columns, rows)
    slopes = tuple(slope.astype(np.float32) for slope in (xx * x + xy * y, yy * y + xy * x))
    size = (20, 24)
    moments = {"x": 0.0, "y": 0.0, "xx": 25.0, "yy": 30.0, "xy": 2.0}
    moments = {name: np.full(size, value, np.float32) for name, value in moments.items()}
    bias, doubt = plane_bias(slopes, moments, np.full(size, 0.01, np.float32), np.ones(size, np.uint8), CELL, along)
    inner = bias[6:-6, 6:-6]
    assert inner == pytest.approx(np.full(inner.shape, 0.5 * xx * 25 + 0.5 * yy * 30 + xy * 2), rel=1e-4)
    assert not doubt[6:-6, 6:-6].any()


def test_where_no_neighbour_tells_nothing_is_taken_out():
    size = (12, 12)
    slopes = (np.random.default_rng(0).normal(size=size).astype(np.float32),) * 2
    moments = {name: np.full(size, 9.0 if len(name) == 2 else 0.0, np.float32) for name in ("x", "y", "xx", "yy", "xy")}
    sigma = np.full(size, 1e-6, np.float32)
    assert not np.any(plane_bias(slopes, moments, sigma, np.zeros(size, np.uint8), CELL, 1))


@pytest.mark.parametrize("sigma", [1e-6, 0.1])
def test_of_a_flat_surface_nothing_is_taken_out(sigma):
    # noise of slopes alone; and a bend that is less than the plane's own sigma
    size = (40, 48)
    rng = np.random.default_rng(1)
    bend = 0.0 if sigma < 0.01 else 1e-3
    columns = np.indices(size)[1] * float(CELL)
    slopes = tuple((bend * columns + rng.normal(0, 1e-3, size)).astype(np.float32) for _ in range(2))
    moments = {
        name: np.full(size, 25.0 if len(name) == 2 else 0.0, np.float32) for name in ("x", "y", "xx", "yy", "xy")
    }
    sigmas, whole = np.full(size, sigma, np.float32), np.ones(size, np.uint8)
    taken_out, doubt = plane_bias(slopes, moments, sigmas, whole, CELL, 1)
    assert not taken_out.any()
    assert np.median(doubt) == pytest.approx(25 * bend, abs=2e-3)  # what it may err by all the same widens sigma
