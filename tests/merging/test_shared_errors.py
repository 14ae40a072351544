"""How sure poses are of surfaces whose points err together, against noise that is drawn."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from retrue.merging.graph import shared_errors
from retrue.merging.pairs import Counterparts, normal_equations

SIDE, DRAWS = 40, 60


def draw(reach, random, bad=0.0):
    """Counterparts a cell apart on a bumpy sheet, their distances noise of 1 that is alike over so many cells."""
    x, y = np.meshgrid(np.arange(SIDE) - SIDE / 2.0, np.arange(SIDE) - SIDE / 2.0)
    slopes = 0.8 * np.cos(x / 12), 0.8 * np.sin(y / 12 + x / 20)
    normals = np.stack([-slopes[0], -slopes[1], np.ones_like(x)], axis=-1).reshape(-1, 3)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    noise = random.normal(size=(2 * SIDE, 2 * SIDE))
    noise = gaussian_filter(noise, reach) * (2 * reach * np.pi**0.5 if reach else 1.0)
    distance = noise[:SIDE, :SIDE].ravel() + random.choice([-5, 5], SIDE**2) * (random.random(SIDE**2) < bad)
    places = np.column_stack([x.ravel(), y.ravel(), np.full(SIDE**2, 100.0)])
    return Counterparts(places, normals, distance, np.ones(SIDE**2), np.arange(SIDE**2))


@pytest.mark.parametrize(("reach", "bad"), [(0.0, 0.0), (0.0, 0.1), (1.0, 0.0), (2.0, 0.0)])
def test_gradients_and_poses_are_as_sure_as_they_say(reach, bad):
    random = np.random.default_rng(3)
    draws = [draw(reach, random, bad) for _ in range(DRAWS)]
    of_gradients, of_poses = shared_errors(draws, 1.0, 1.0)
    wanted, missed = [], []
    for found in draws:
        design = np.column_stack([np.cross(found.places, found.normals), found.normals])
        H, gradient, _ = normal_equations(found, 1.0)
        wanted.append(gradient @ np.linalg.solve(H, gradient) / 6 / of_gradients)
        move = np.zeros(6)
        for _ in range(20):
            here, g, _ = normal_equations(replace(found, distance=found.distance + design @ move), 1.0)
            move -= np.linalg.solve(here, g)
        missed.append(move @ H @ move / 6 / of_poses)
    assert np.mean(wanted) == pytest.approx(1, abs=0.2)
    assert np.mean(missed) == pytest.approx(1, abs=0.2)


def test_what_errs_together_counts_as_one():
    random = np.random.default_rng(4)
    alone, together = (shared_errors([draw(reach, random) for _ in range(10)], 1.0, 1.0)[1] for reach in (0.0, 2.0))
    assert alone == pytest.approx(1, abs=0.2)
    assert together == pytest.approx(4 * np.pi * 2.0**2, rel=0.25)
