"""How sure points are: against noise that is drawn, and rigs that are moved."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from retrue.correspondences import Correspondences
from retrue.errors import InputError
from retrue.reconstruction.options import ReconstructOptions
from retrue.reconstruction.reconstruct import reconstruct
from retrue.reconstruction.sensitivity import moved_rig
from retrue.rig import Rig
from retrue.rig_evidence import RIG_NUMBERS, rig_covariance, unstated
from tests.reconstruction.scenes import RIG, scene

STEP = np.array([1e-5] * 5 + [1e-4] + [1e-5, 1e-2, 1e-2, 1e-4] * 2)

KEEP = ReconstructOptions(outlier_sigmas=1e6, keep_strays=True)


def seen(points, rng=None, camera=0.0, projector=0.0, **columns):
    def noise(size):
        return 0.0 if rng is None else rng.normal(size=(len(points), 2)) * np.asarray(size).reshape(-1, 1)

    camera_px = RIG.camera.project(points)
    projector_px = RIG.projector.project(RIG.projector_from_camera.apply(points))
    return Correspondences(camera_px + noise(camera), projector_px + noise(projector), **columns)


def with_evidence(**evidence):
    return Rig(RIG.camera, RIG.projector, RIG.projector_from_camera, RIG.unit, evidence)


def along(X, truth):
    ray = truth / np.linalg.norm(truth, axis=1, keepdims=True)
    return ((X - truth) * ray).sum(axis=1)


@pytest.mark.parametrize("number", range(RIG_NUMBERS))
def test_common_shifts_are_what_a_wrong_rig_does(number):
    X = scene(16)[0]
    points = seen(X)
    variance = np.zeros((RIG_NUMBERS, RIG_NUMBERS))
    variance[number, number] = STEP[number] ** 2
    cloud = reconstruct(with_evidence(rig_covariance=variance.tolist()), points)
    change = np.zeros(RIG_NUMBERS)
    change[number] = STEP[number]
    moved = reconstruct(moved_rig(RIG, change), points).points - reconstruct(RIG, points).points
    (shift,) = np.moveaxis(cloud.common_shifts(), 2, 0)
    shift *= np.sign(np.sum(shift * moved))
    np.testing.assert_allclose(shift, moved, atol=2e-3 * np.abs(moved).max())
    np.testing.assert_allclose(cloud.covariance("common"), shift[:, :, None] * shift[:, None], atol=1e-12)


def test_own_errors_are_those_of_drawn_noise():
    X = scene(16)[0]
    stated = {"camera_sigma_px": np.full(len(X), 1.0), "projector_sigma_px": np.full(len(X), 2.0)}
    clouds = [reconstruct(RIG, seen(X, np.random.default_rng(k), 0.05, 0.1, **stated)) for k in range(200)]
    off = np.stack([cloud.points - X for cloud in clouds])
    drawn = np.einsum("kni,knj->ij", off, off) / off[..., 0].size
    expected = np.mean([cloud.covariance("own").mean(axis=0) for cloud in clouds], axis=0)
    np.testing.assert_allclose(drawn, expected, atol=0.05 * np.abs(expected).max())
    inside = np.mean([np.abs(along(cloud.points, X)) < cloud.sigma for cloud in clouds])
    assert inside == pytest.approx(0.683, abs=0.01)


@pytest.mark.parametrize("noise", [0.02, 0.2])
def test_sigma_needs_no_word_of_the_decoder(noise):
    X = scene(4)[0]
    clouds = [reconstruct(RIG, seen(X, np.random.default_rng(seed), noise, noise)) for seed in range(5)]
    off = np.stack([np.abs(along(cloud.points, X)) for cloud in clouds])
    sigma = np.stack([cloud.sigma for cloud in clouds])
    np.testing.assert_allclose([np.mean(off < k * sigma) for k in (1, 2, 3)], [0.683, 0.954, 0.997], atol=0.02)


def test_a_decoder_that_states_half_of_its_noise_is_corrected():
    X, _, cells, _ = scene(3)
    rng = np.random.default_rng(4)
    true = np.where(rng.random(len(X)) < 0.5, 0.03, 0.09)
    cloud = reconstruct(RIG, seen(X, rng, 0.0, true, projector_sigma_px=true / 2, cells=cells))
    rows = cKDTree(RIG.camera.project(X)).query(cloud.camera_px)[1]
    off = np.abs(along(cloud.points, X[rows]))
    for size in (0.03, 0.09):
        own = true[rows] == size
        inside = [np.mean(off[own] < k * cloud.sigma[own]) for k in (1, 2, 3)]
        np.testing.assert_allclose(inside, [0.683, 0.954, 0.997], atol=0.04)


def test_doubt_of_single_points_is_not_made_less_of_where_noise_is_overstated():
    X, _, cells, _ = scene(3)
    rng = np.random.default_rng(5)
    doubted = rng.random(len(X)) < 0.05
    exact = seen(X, cells=cells, projector_sigma_px=np.where(doubted, 0.5, 0.1))
    off = rng.normal(0, 0.05, exact.projector_px.shape)
    off[doubted, 0] += rng.normal(0, 0.5, doubted.sum())  # along the lines, where no residual shows it
    cloud = reconstruct(RIG, replace(exact, projector_px=exact.projector_px + off), KEEP)
    assert len(cloud) == len(X)
    z = along(cloud.points, X) / cloud.sigma
    for which, margin in ((doubted, 0.06), (~doubted, 0.02)):
        found = [np.mean(np.abs(z[which]) < k) for k in (1, 2, 3)]
        assert found == pytest.approx([0.683, 0.954, 0.997], abs=margin)


def test_of_two_coordinates_that_a_decoder_tells_apart_each_errs_by_its_own_sigma():
    X, rng = scene(4)[0], np.random.default_rng(6)
    x, y = 0.05, 0.2
    exact = seen(X)
    stated = {
        "projector_sigma_px": np.full(len(X), np.sqrt((x**2 + y**2) / 2)),
        "projector_sigma_ratio": np.full(len(X), x / y),
    }
    points = Correspondences(exact.camera_px, exact.projector_px + rng.normal(size=(len(X), 2)) * [x, y], **stated)
    cloud = reconstruct(RIG, points)
    truth = X[cKDTree(points.camera_px).query(cloud.camera_px)[1]]
    off = np.abs(along(cloud.points, truth))
    assert np.mean(off < cloud.sigma) == pytest.approx(0.683, abs=0.03)
    assert np.array_equal(cloud.select(np.arange(0, len(cloud), 7)).covariance("own"), cloud.covariance("own")[::7])
    alike = reconstruct(
        RIG, Correspondences(exact.camera_px, points.projector_px, **stated | {"projector_sigma_ratio": None})
    )
    assert np.mean(off < alike.sigma) > 0.8  # one sigma for both is too large along the epipolar lines


def test_one_coordinate_rests_on_what_its_decoder_states():
    X = scene(4)[0]
    rng = np.random.default_rng(5)
    points = seen(X, rng, 0.0, 0.1, projector_sigma_px=np.full(len(X), 0.1))
    columns = np.stack([points.projector_px[:, 0], np.full(len(X), np.nan)], axis=1)
    one = Correspondences(points.camera_px, columns, projector_sigma_px=points.projector_sigma_px)
    cloud = reconstruct(RIG, one)
    truth = X[cKDTree(points.camera_px).query(cloud.camera_px)[1]]
    assert len(cloud) > 2000
    assert np.mean(np.abs(along(cloud.points, truth)) < cloud.sigma) == pytest.approx(0.683, abs=0.03)
    silent = reconstruct(RIG, Correspondences(points.camera_px, columns))
    assert silent.sigma is None
    with pytest.raises(InputError, match="no record of how sure"):
        silent.covariance()


def test_errors_add_up_and_follow_the_points():
    X = scene(8)[0]
    evidence = {"covariance": (1e-8 * np.eye(5)).tolist(), "scale_sigma": 1e-3}
    cloud = reconstruct(with_evidence(**evidence), seen(X, np.random.default_rng(1), 0.1, 0.1))
    own, common, both = (cloud.covariance(errors) for errors in ("own", "common", "all"))
    np.testing.assert_allclose(own + common, both)
    few = cloud.select(np.arange(0, len(cloud), 7))
    np.testing.assert_allclose(few.covariance(), both[::7])
    assert np.array_equal(few.sigma, cloud.sigma[::7])
    with pytest.raises(InputError, match="errors: expected"):
        cloud.covariance("others")


def test_what_a_rig_does_not_say_is_named():
    assert unstated(RIG) == ("pose", "lenses", "scale")
    assert unstated(with_evidence(scale_sigma=0.01)) == ("pose", "lenses")
    assert not rig_covariance(RIG).any()


@pytest.mark.parametrize(
    "evidence",
    [
        {"covariance": [[1.0]]},
        {"covariance": (-np.eye(5)).tolist()},
        {"lens_covariance": "none"},
        {"rig_covariance": np.full((14, 14), np.nan).tolist()},
        {"scale_sigma": "a lot"},
    ],
)
def test_what_is_no_covariance_is_refused(evidence):
    with pytest.raises(InputError, match="rig evidence"):
        rig_covariance(with_evidence(**evidence))
