"""The covariances of lenses and pose that a calibration states: convention, definiteness, honesty."""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest
from scipy import sparse

from retrue import RecalibrateOptions
from retrue.calibration.bundle import Adjusted, NormalEquations, Problem
from retrue.calibration.calibrate import calibrate_views, start
from retrue.calibration.jacobians import linearise, residuals
from retrue.calibration.model_terms import fit_with_lens
from retrue.calibration.neighbours import variances
from retrue.calibration.observations import CornerObservations, observation_groups
from retrue.calibration.printed import printed_factors
from retrue.calibration.setup import Setup
from retrue.calibration.uncertainty import FLOOR, STATED, lens_covariance, pose_covariance, rig_covariance
from retrue.geometry.two_view import tangent_basis
from retrue.rig import Rig
from tests.calibration.test_calibrate import BOARD, SIZES, scene


@pytest.fixture(scope="module")
def fit(benchmark: ModuleType) -> Adjusted:
    _, views = scene(benchmark, 4)
    return fit_with_lens(start(views, SIZES, (None, None)), observation_groups(views), (False, False), ("k1",))


def moved(setup: Setup, column: int, step: float) -> Rig:
    change = np.zeros(setup.columns.shared)
    change[column] = step
    there = setup.moved(change)
    assert there is not None
    return Rig(*there.devices, there.second_from_first)


def test_they_are_the_covariance_of_the_fit_in_other_parameters(benchmark: ModuleType, fit: Adjusted) -> None:
    setup, shared = fit.setup, fit.setup.columns.shared
    steps = np.full(shared, 1e-6)
    by_lens, by_pose = np.zeros((8, shared)), np.zeros((5, shared))
    for column, step in enumerate(steps):
        there, back = moved(setup, column, step), moved(setup, column, -step)
        by_lens[:, column] = (benchmark.lens_parameters(there) - benchmark.lens_parameters(back)) / (2 * step)
        here = setup.second_from_first
        # In the basis at the fit, which both ends share.
        ends = [benchmark.pose_error(here, end.projector_from_camera) for end in (there, back)]
        by_pose[:, column] = (ends[1] - ends[0]) / (2 * step)
    lens = by_lens @ fit.covariance @ by_lens.T + np.diag(np.tile(FLOOR, 2) ** 2)
    root = np.sqrt(np.diag(lens))
    assert np.abs((lens_covariance(rig_covariance(fit, (False, False))) - lens) / np.outer(root, root)).max() < 1e-5
    pose = by_pose @ fit.covariance @ by_pose.T
    root = np.sqrt(np.diag(pose))
    assert np.abs((pose_covariance(rig_covariance(fit, (False, False))) - pose) / np.outer(root, root)).max() < 1e-5


def test_they_are_positive_definite_whatever_was_free(fit: Adjusted) -> None:
    nothing = replace(fit, covariance=np.zeros_like(fit.covariance))
    assert np.linalg.eigvalsh(lens_covariance(rig_covariance(nothing, (False, False))))[0] >= min(FLOOR) ** 2 * (
        1 - 1e-9
    )
    for fixed in ((False, False), (True, False), (True, True)):
        covariance = lens_covariance(rig_covariance(fit, fixed))
        assert np.array_equal(covariance, covariance.T)
        assert np.linalg.eigvalsh(covariance)[0] > 0
    held = lens_covariance(rig_covariance(fit, (True, False)))
    assert np.sqrt(np.diag(held))[:4] == pytest.approx(STATED, rel=1e-4)
    assert not held[:4, 4:].any()
    assert np.linalg.eigvalsh(pose_covariance(rig_covariance(fit, (False, False))))[0] > 0


def test_a_calibration_states_both_in_its_evidence(benchmark: ModuleType) -> None:
    truth, views = scene(benchmark, 5)
    evidence = calibrate_views(views, BOARD, SIZES).evidence
    lens, pose, sigma = np.array(evidence["lens_covariance"]), np.array(evidence["covariance"]), evidence["sigma"]
    assert lens.shape == (8, 8)
    assert np.linalg.eigvalsh(lens)[0] > 0
    assert np.sqrt(lens[5, 5] - FLOOR[1] ** 2) == pytest.approx(sigma["projector"]["cx"])
    assert pose.shape == (5, 5)
    assert np.degrees(np.sqrt(np.diag(pose)[:3])) == pytest.approx(
        [sigma["projector_from_camera"][name] for name in ("rx_deg", "ry_deg", "rz_deg")]
    )
    known = calibrate_views(views, BOARD, SIZES, known=(truth.camera, truth.projector)).evidence
    assert np.sqrt(np.diag(known["lens_covariance"])) == pytest.approx(np.tile(STATED, 2), rel=1e-4)


@pytest.mark.parametrize("noise", ["AS_IN_LIFE", "DECODER"])
def test_errors_are_as_large_as_they_say(benchmark: ModuleType, noise: str) -> None:
    lens, pose = benchmark.covariances(12, counts=(5,), noise=getattr(benchmark, noise))
    assert 4 < lens < 13
    assert 2 < pose < 8.5


def test_shared_noise_is_told_from_noise_of_its_own() -> None:
    rng = np.random.default_rng(2)
    x = np.linspace(0, 1, 200)
    kernels = [np.exp(-0.5 * ((x[:, None] - x) / 0.02) ** 2) for _ in range(4)]
    # Three unknowns of each view took up what they could.
    trend = np.linalg.qr(np.stack([np.ones_like(x), x, x * x], axis=-1))[0]
    taken = np.zeros((800, 12))
    for view in range(4):
        taken[200 * view : 200 * view + 200, 3 * view : 3 * view + 3] = trend
    smooth = np.concatenate([rng.multivariate_normal(np.zeros(200), K, method="svd") for K in kernels])
    noise = rng.normal(size=800)
    left = [error - taken @ (taken.T @ error) for error in (noise, noise + smooth)]
    assert variances(left[0], taken, kernels) == (1.0, 0.0)
    own, shared = variances(left[1], taken, kernels)
    assert own == pytest.approx(1, abs=0.2)
    assert shared == pytest.approx(1, abs=0.35)


def test_noise_that_repeats_is_told_from_noise_of_its_own() -> None:
    rng = np.random.default_rng(3)
    alike = sparse.csr_array(np.tile(np.eye(100), (6, 1)))
    taken = np.zeros((600, 18))
    trend = np.linalg.qr(np.stack([np.ones(100), np.arange(100), np.arange(100) ** 2], axis=-1))[0]
    for view in range(6):
        taken[100 * view : 100 * view + 100, 3 * view : 3 * view + 3] = trend
    noise, printed = rng.normal(size=600), 0.7 * (alike @ rng.normal(size=100))
    left = [error - taken @ (taken.T @ error) for error in (noise, noise + printed)]
    apart = [np.eye(100)] * 6
    assert variances(left[0], taken, apart, [alike])[2] == 0
    kernels = [np.exp(-0.5 * ((np.arange(100)[:, None] - np.arange(100)) / 2) ** 2)] * 6
    own, shared, repeated = variances(left[1], taken, kernels, [alike])
    assert own == pytest.approx(1, abs=0.15)
    assert shared == 0
    assert repeated == pytest.approx(0.49, abs=0.15)


def test_errors_of_print_move_the_fit_as_their_factors_say(benchmark: ModuleType) -> None:
    _, views = scene(benchmark, 3)
    views[1] = replace(  # counted from the other end
        views[1],
        pixels=tuple(own[::-1] for own in views[1].pixels),
        sigmas=tuple(own[::-1] for own in views[1].sigmas),
    )
    known = (False, False)
    groups = observation_groups(views)
    fit = fit_with_lens(start(views, SIZES, (None, None)), groups, known, ("k1",))
    rng = np.random.default_rng(6)
    off = rng.normal(scale=0.05, size=BOARD.points.shape)  # seen so often that it tells which view is turned
    corners = groups[0]
    assert isinstance(corners, CornerObservations)
    place = np.argmin(np.linalg.norm(corners.board_points[:, None, :2] - BOARD.points, axis=2), axis=1)
    seen = np.where((corners.view == 1)[:, None], -off[::-1][place], off[place])
    moved = replace(corners, board_points=corners.board_points + np.pad(seen, ((0, 0), (0, 1))))
    change = residuals(fit.setup, moved) - residuals(fit.setup, corners)
    apart = replace(corners, pixels=corners.pixels - 40 * change)
    linearised = tuple(linearise(fit.setup, group) for group in (apart, *groups[1:]))
    factors = printed_factors(fit.setup, (apart, *groups[1:]), linearised)
    _, order = np.unique(BOARD.points, axis=0, return_index=True)
    for axis in (0, 1):
        found = factors[0][axis][0] @ off[order].ravel()
        assert np.abs(found - change[:, axis]).max() < 2e-3 * np.abs(change).max()
    problem = Problem((apart, *groups[1:]), fit.active, False)
    (error, jacobian), *others = linearised
    equations = NormalEquations(fit.setup, problem, linearised, fit.scales)
    there = NormalEquations(fit.setup, problem, ((error + change, jacobian), *others), fit.scales)
    everything = np.ones_like(fit.active)
    expected = there.reduced(everything)[1] - equations.reduced(everything)[1]
    weighed = jacobian * (fit.scales[0] * corners.sigma[:, None])[:, :, None] ** -2
    gradients = [
        sum(weighed[own, axis].T @ (factors[0][axis][0][own] @ off[order].ravel()) for axis in (0, 1))[:, None]
        for own in (corners.view == view for view in range(3))
    ]
    size = np.sqrt(np.diag(equations.reduced(everything)[0]))
    assert (
        np.abs((equations.repeated(np.stack(gradients))[:, 0] - expected) / size).max()
        < 0.02 * np.abs(expected / size).max()
    )


def test_errors_of_print_do_not_average_out(benchmark: ModuleType) -> None:
    lens, pose = benchmark.covariances(4, (7,), noise=benchmark.PRINTED, every_term=False, upright=True)
    assert 1 < lens < 13
    assert 1 < pose < 8.5


def test_the_basis_of_the_direction_is_that_of_the_pose(fit: Adjusted) -> None:
    setup = fit.setup
    t = setup.second_from_first.t
    along = np.zeros_like(fit.covariance)
    translation = setup.columns.translation
    direction = t / np.linalg.norm(t)
    second = tangent_basis(direction)[:, 1]
    along[translation, translation] = np.outer(second, second) + np.outer(direction, direction)  # |t| does not show
    found = pose_covariance(rig_covariance(replace(fit, covariance=along), (False, False)))
    assert np.diag(found) == pytest.approx([0, 0, 0, 0, 1 / (t @ t)], abs=1e-18)


def test_a_lens_that_was_handed_in_is_known_as_one_that_states_nothing() -> None:
    options = RecalibrateOptions()
    assert (options.focal_sigma, *(options.principal_point_sigma_px,) * 2, options.k1_sigma) == STATED
