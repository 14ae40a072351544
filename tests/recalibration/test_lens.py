"""What lenses may change by: derivatives as differences have them, and priors that are refused when they are none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from retrue.errors import InputError
from retrue.geometry.camera import Camera
from retrue.kernels.lenses import turns_of_rays
from retrue.recalibration.lens import changed_device, lens_numbers, stated_prior, wide_prior
from tests.recalibration.scenes import CAMERA, RIG


def random_device(coefficients: int, rng: np.random.Generator) -> Camera:
    f = rng.uniform(900, 1800)
    distortion = rng.normal(0, [0.1, 0.05, 1e-3, 1e-3, 0.02, 0.05, 0.02, 0.01])[:coefficients]
    K = [[f, 0, rng.uniform(500, 700)], [0, f * rng.uniform(0.98, 1.02), rng.uniform(400, 560)], [0, 0, 1]]
    return Camera((1280, 960), K, distortion)


@pytest.mark.parametrize("coefficients", [0, 5, 8])
def test_rays_turn_with_each_lens_parameter_as_differences_say(coefficients: int) -> None:
    rng = np.random.default_rng(coefficients)
    for _ in range(5):
        device = random_device(coefficients, rng)
        pixels = rng.uniform([100, 100], [1180, 860], (30, 2))
        rays, found = device.unproject(pixels), np.empty((len(pixels), 2, 4))
        turns_of_rays(*lens_numbers(device, np.zeros(4)), rays, found)
        for k, step in enumerate(np.diag([1e-5, 1e-2, 1e-2, 1e-5])):
            up, down = (changed_device(device, change).unproject(pixels) for change in (step, -step))
            expected = (up - down) / (2 * step[k])
            np.testing.assert_allclose(found[:, :, k], expected, atol=2e-6 * max(1.0, np.abs(expected).max()))


def test_a_changed_device_has_what_was_changed_and_no_more() -> None:
    change = np.array([np.log(1.1), 3.0, -2.0, 0.05])
    found = changed_device(CAMERA, change)
    np.testing.assert_allclose(np.diag(found.K)[:2], 1.1 * np.diag(CAMERA.K)[:2])
    np.testing.assert_allclose(found.K[:2, 2], CAMERA.K[:2, 2] + [3, -2])
    np.testing.assert_allclose(found.distortion[1:], CAMERA.distortion[1:])
    assert found.distortion[0] == pytest.approx(CAMERA.distortion[0] + 0.05)
    assert found.size == CAMERA.size
    assert CAMERA.K[0, 0] == 1600


def test_the_rig_s_own_word_on_its_lenses_is_taken() -> None:
    covariance = np.diag(np.linspace(1, 8, 8))
    rig = replace(RIG, evidence={"lens_covariance": covariance.tolist()})
    prior = stated_prior(rig, 1e-3, 1.0, 1e-3)
    np.testing.assert_array_equal(prior.covariance, covariance)
    np.testing.assert_allclose(prior.precision @ covariance, np.eye(8), atol=1e-12)
    assert (np.linalg.eigvalsh(wide_prior(rig, prior).covariance - covariance) > 0).all()
    np.testing.assert_allclose(
        np.sqrt(np.diag(stated_prior(RIG, 1e-3, 2.0, 3e-3).covariance)), [1e-3, 2, 2, 3e-3, 1e-3, 2, 2, 3e-3]
    )


@pytest.mark.parametrize("wrong", [np.eye(5), -np.eye(8), np.full((8, 8), np.nan)])
def test_a_covariance_that_is_none_is_refused(wrong: np.ndarray) -> None:
    with pytest.raises(InputError, match="lens_covariance"):
        stated_prior(replace(RIG, evidence={"lens_covariance": wrong.tolist()}), 1e-3, 1.0, 1e-3)


def test_one_calibrated_lens_of_twenty_is_further_off_than_likely() -> None:
    prior = stated_prior(RIG, 0.002, 1.0, 0.001)
    drawn = np.random.default_rng(0).multivariate_normal(np.zeros(8), prior.covariance, 4000)
    assert np.mean([prior.likely(change) for change in drawn]) == pytest.approx(0.95, abs=0.01)
