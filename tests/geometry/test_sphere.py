"""One fit for every ball: against exact spheres, drawn noise, and points that tell none."""

import numpy as np
import pytest

from retrue.errors import DegenerateError
from retrue.geometry.sphere import sphere_through

CENTRE, RADIUS = np.array([120.0, -40.0, 900.0]), 25.0


def cap(count, rng, widest=0.9):
    """Points of the ball that the camera sees."""
    outwards = rng.normal(size=(count, 3))
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    towards = -CENTRE / np.linalg.norm(CENTRE)
    return outwards[outwards @ towards > np.cos(widest)]


def test_noise_moves_the_sphere_as_its_design_says():
    rng = np.random.default_rng(0)
    outwards = cap(4000, rng)
    sigma = np.where(rng.random(len(outwards)) < 0.5, 0.02, 0.1)
    found = []
    for _ in range(200):
        off = sigma * rng.standard_normal(len(outwards))
        found.append(sphere_through(CENTRE + (RADIUS + off)[:, None] * outwards, sigma))
    drawn = np.cov(np.array([[*ball.centre, ball.radius] for ball in found]).T)
    J = found[0].design / sigma[:, None]
    np.testing.assert_allclose(np.diag(drawn), np.diag(np.linalg.inv(J.T @ J)), rtol=0.35)
    assert np.mean([ball.radius for ball in found]) == pytest.approx(RADIUS, abs=4 * np.sqrt(drawn[3, 3] / 200))


def test_without_rounds_it_is_the_linear_answer_beside_it():
    rng = np.random.default_rng(1)
    outwards = cap(4000, rng)
    points = CENTRE + (RADIUS + 0.3 * rng.standard_normal(len(outwards)))[:, None] * outwards
    linear, settled = sphere_through(points, rounds=0), sphere_through(points)
    assert 0 < abs(linear.radius - settled.radius) < 0.05 * RADIUS
    assert (settled.residuals**2).sum() < (linear.residuals**2).sum()
    np.testing.assert_allclose(settled.design.T @ settled.residuals, 0, atol=1e-6)


@pytest.mark.parametrize(
    "points",
    [
        np.empty((0, 3)),
        np.eye(3),
        np.ones((9, 3)),
        np.random.default_rng(0).random((50, 3)) * [1, 1, 0],
        np.full((9, 3), np.nan),
    ],
)
def test_points_that_tell_no_sphere_are_refused(points):
    with pytest.raises(DegenerateError, match="expected four points or more"):
        sphere_through(points)
