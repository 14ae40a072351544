"""The main job on captures with known truth: near the truth, honest about it, and silent where it cannot tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from retrue.correspondences import Correspondences
from retrue.errors import InputError
from retrue.geometry.transform import direction_angle, rotation_angle, vector_from_rotation
from retrue.geometry.two_view import tangent_basis
from retrue.recalibration.options import KnownDistance, RecalibrateOptions
from retrue.recalibration.reasons import RivalUnbeaten
from retrue.recalibration.recalibrate import recalibrate
from retrue.recalibration.result import Accepted, Refused
from retrue.rig import Rig
from tests.recalibration.scenes import CAMERA, POSE, PROJECTOR, RIG, SIDE_WALL, SPHERE, WALL, Scene, bumped, capture

FAR = bumped(RIG, [10, -12, 8], [5, 15, -10], 1.7)
NEAR = bumped(RIG, [3, -4, 2], [4, -6, 5], 1.7)
SMALL = (0.4, 0.7, 0.4, 0.7)  # of the projector picture: both twins have all of it in front
SCENES = {
    "wall and sphere": Scene(spheres=[SPHERE]),
    "corner": Scene(planes=[WALL, SIDE_WALL]),
}


def errors_deg(rig: Rig) -> tuple[float, float]:
    found = rig.projector_from_camera
    return (
        float(np.degrees(rotation_angle(found.R @ POSE.R.T))),
        float(np.degrees(direction_angle(found.t, POSE.t))),
    )


def accepted(result: Accepted | Refused) -> Accepted:
    assert isinstance(result, Accepted), result.reason
    return result


@pytest.mark.parametrize("outliers", [0.0, 0.2, 0.4])
@pytest.mark.parametrize("scene", SCENES)
def test_one_capture_of_a_scene_with_relief_resolves_the_twin_from_any_prior(scene: str, outliers: float) -> None:
    for seed, old in enumerate([FAR, bumped(RIG, [0, 30, 0], [0, 0, 35])]):
        result = accepted(recalibrate(old, [capture(SCENES[scene], outliers=outliers, seed=seed)]))
        rotation, translation = errors_deg(result.rig)
        assert rotation < 0.03
        assert translation < 0.10
        assert "resolved by points" in result.reason
        assert np.linalg.norm(result.rig.projector_from_camera.t) == pytest.approx(
            np.linalg.norm(old.projector_from_camera.t)
        )


def test_a_bare_wall_is_resolved_by_the_old_direction_of_t() -> None:
    for seed in range(3):
        flat = RecalibrateOptions(flatness_sigma=1e-5)  # as these walls are
        result = accepted(recalibrate(NEAR, [capture(Scene(), area=SMALL, grid=(80, 60), seed=seed)], flat))
        rotation, translation = errors_deg(result.rig)
        assert rotation < 0.08
        assert translation < 0.25
        assert "the old pose" in result.reason
        assert [candidate.chosen for candidate in result.evidence.candidates].count(True) == 1


def test_a_bare_wall_that_fills_the_picture_is_resolved_by_what_lies_behind() -> None:
    for old in (NEAR, bumped(RIG, [0, -12, 5], [0, 0, 15])):
        result = accepted(recalibrate(old, [capture(Scene())]))
        rotation, translation = errors_deg(result.rig)
        assert rotation < 0.08
        assert translation < 0.25
        assert "resolved by points" in result.reason


def test_a_bare_wall_with_a_prior_between_the_twins_is_refused_and_shows_both() -> None:
    points = capture(Scene(), area=SMALL)
    first, second = (c.projector_from_camera for c in recalibrate(RIG, [points]).evidence.candidates[:2])
    between = Rig(CAMERA, PROJECTOR, type(POSE)(POSE.R, first.t + second.t), "m")
    result = recalibrate(between, [points])
    assert isinstance(result, Refused)
    assert isinstance(result.cause, RivalUnbeaten)
    assert min(rival.margin for rival in result.evidence.rivals) < 7
    assert result.evidence.sigma is not None
    sigma = result.evidence.sigma.rotation_deg, result.evidence.sigma.translation_deg
    errors = [
        errors_deg(replace(RIG, projector_from_camera=c.projector_from_camera)) for c in result.evidence.candidates
    ]
    assert any(rotation < 3 * sigma[0] and translation < 3 * sigma[1] for rotation, translation in errors)


def test_walls_at_two_places_resolve_the_twin_jointly() -> None:
    other = Scene(planes=[(np.array([-0.3, 0.3, 1.0]), 1.8)])
    result = accepted(recalibrate(bumped(RIG, [0, 30, 0], [25, 0, 30]), [capture(Scene()), capture(other, seed=1)]))
    rotation, translation = errors_deg(result.rig)
    assert rotation < 0.02
    assert translation < 0.05
    assert "resolved by points" in result.reason


def test_a_rectified_pair_and_a_projector_behind_the_camera_work() -> None:
    for t in ([0.3, 0.0, 0.0], [0.25, 0.05, -0.2]):
        rig = Rig(CAMERA, PROJECTOR, type(POSE)(np.eye(3), t), "m")
        points = capture(Scene(spheres=[SPHERE]), rig=rig)
        found = accepted(recalibrate(rig, [points])).rig.projector_from_camera
        assert np.degrees(rotation_angle(found.R)) < 0.03
        assert np.degrees(direction_angle(found.t, t)) < 0.10


def test_sigma_is_honest() -> None:
    """The normalised error squared has mean 5: neither boasting nor modest."""
    normalised = []
    for seed in range(60):
        result = accepted(recalibrate(FAR, [capture(Scene(spheres=[SPHERE]), grid=(26, 20), seed=seed)]))
        pose = result.rig.projector_from_camera
        direction = pose.t / np.linalg.norm(pose.t)
        error = np.r_[
            vector_from_rotation(pose.R @ POSE.R.T), tangent_basis(direction).T @ -(POSE.t / np.linalg.norm(POSE.t))
        ]
        covariance = np.array(result.evidence.details["covariance_statistical"])  # the lenses are exact here
        normalised.append(error @ np.linalg.solve(covariance, error))
    assert np.mean(normalised) == pytest.approx(5, abs=4 * np.sqrt(2 * 5 / 60))


def test_a_known_distance_gives_the_scale() -> None:
    points = capture(Scene())
    first, second = np.array([400.0, 300.0]), np.array([900.0, 600.0])
    normal, distance = WALL[0] / np.linalg.norm(WALL[0]), WALL[1]
    scene_points = []
    for pixel in (first, second):
        ray = np.array([*CAMERA.unproject(pixel), 1.0])
        scene_points.append(ray * distance / (normal @ ray))
    known = KnownDistance(first, second, float(np.linalg.norm(scene_points[0] - scene_points[1])))
    result = accepted(recalibrate(NEAR, [points], RecalibrateOptions(known_distance=known)))
    length = np.linalg.norm(result.rig.projector_from_camera.t)
    assert length == pytest.approx(np.linalg.norm(POSE.t), rel=2e-3)
    for stretch in (1.0, 3.0):  # a rig that holds keeps its pose, but not the length of t that is told to be another
        pose = replace(POSE, t=stretch * POSE.t)
        rig = replace(RIG, projector_from_camera=pose, evidence={"covariance": (1e-8 * np.eye(5)).tolist()})
        held = accepted(recalibrate(rig, [points], RecalibrateOptions(known_distance=known)))
        assert not held.unchanged
        np.testing.assert_array_equal(held.rig.projector_from_camera.R, POSE.R)
        assert np.linalg.norm(held.rig.projector_from_camera.t) == pytest.approx(np.linalg.norm(POSE.t), rel=2e-3)
        assert held.rig.evidence["scale_sigma"] == 0
    outside = KnownDistance(np.array([-500.0, 0.0]), second, 1.0)
    with pytest.raises(InputError, match="found none"):
        recalibrate(FAR, [points], RecalibrateOptions(known_distance=outside))


def junk(rng: np.random.Generator) -> Correspondences:
    return Correspondences(rng.uniform(0, 900, (2000, 2)), rng.uniform(0, 700, (2000, 2)))


def test_what_holds_no_pose_is_refused_with_a_reason() -> None:
    rng = np.random.default_rng(0)
    line = np.stack([np.linspace(100, 900, 50), np.linspace(100, 700, 50)], axis=1)
    cases = {
        "agree with one pose|do not determine it": junk(rng),
        "at least 12 correspondences, found 3": capture(Scene()).select(np.array([0, 100, 500])),
        "on one line": Correspondences(line, line),
        "at one place": Correspondences(np.full((50, 2), 300.0), np.full((50, 2), 200.0)),
        "found 0": Correspondences(np.empty((0, 2)), np.empty((0, 2))),
    }
    for reason, points in cases.items():
        result = recalibrate(RIG, [points])
        assert isinstance(result, Refused)
        assert any(part in result.reason for part in reason.split("|")), result.reason
    with pytest.raises(InputError):
        recalibrate(RIG, [])


def test_t_along_the_normal_of_the_only_plane_is_refused() -> None:
    facing = Scene(planes=[(POSE.R.T @ POSE.t, 0.3)])
    assert isinstance(recalibrate(RIG, [capture(facing)]), Refused)


def test_the_same_points_give_the_same_answer_whatever_was_asked_between() -> None:
    points, other = (capture(SCENES[scene], outliers=0.2) for scene in SCENES)
    first = accepted(recalibrate(FAR, [points]))
    recalibrate(NEAR, [other, points])
    second = accepted(recalibrate(FAR, [points]))
    assert first == second
    for mine, again in zip(first.evidence.candidates, second.evidence.candidates, strict=True):
        assert np.array_equal(mine.projector_from_camera.R, again.projector_from_camera.R)
        assert np.array_equal(mine.projector_from_camera.t, again.projector_from_camera.t)


def test_a_ball_without_any_plane_is_answered_within_its_sigma() -> None:
    ball = Scene(planes=[], spheres=[(np.array([0.0, 0.0, 1.3]), 0.35)])
    result = accepted(recalibrate(NEAR, [capture(ball)]))
    assert result.evidence.sigma is not None
    for error, sigma in zip(
        errors_deg(result.rig), (result.evidence.sigma.rotation_deg, result.evidence.sigma.translation_deg), strict=True
    ):
        assert error < 3 * sigma


def test_a_shifted_copy_of_two_fifths_is_set_aside_and_counted() -> None:
    points = capture(SCENES["corner"])
    copied = np.random.default_rng(0).random(len(points)) < 0.4
    shifted = Correspondences(points.camera_px, points.projector_px + np.where(copied, 60.0, 0.0)[:, None] * [1, 0.3])
    result = accepted(recalibrate(NEAR, [shifted]))
    rotation, translation = errors_deg(result.rig)
    assert rotation < 0.1
    assert translation < 0.3
    assert result.evidence.details["points_of_another_pose"] > 0.5 * copied.sum()


def test_a_rig_that_holds_and_is_known_better_is_kept() -> None:
    known = replace(RIG, evidence={"covariance": (np.eye(5) * np.radians(1e-3) ** 2).tolist()})
    result = accepted(recalibrate(known, [capture(SCENES["corner"])]))
    assert result.unchanged
    assert result.verdict == "unchanged"
    assert result.rig == known
    moved = accepted(recalibrate(replace(bumped(RIG, [0, 1, 0], [0, 0, 0]), evidence=known.evidence), [
        capture(SCENES["corner"])]))  # fmt: skip
    assert not moved.unchanged
    assert errors_deg(moved.rig)[0] < 0.1


def test_a_lens_that_is_a_tenth_off_is_called_changed_and_found() -> None:
    camera = replace(CAMERA, K=CAMERA.K * [[1.1, 1, 1], [1, 1.1, 1], [1, 1, 1]])
    points = capture(Scene(planes=[WALL, SIDE_WALL], spheres=[SPHERE]), rig=replace(RIG, camera=camera))
    lenses = recalibrate(RIG, [points]).evidence.lenses
    assert lenses is not None
    assert lenses.verdict == "changed"
    for found, true, sigma in zip(lenses.focal_change, (0.1, 0.0), lenses.focal_sigma, strict=True):
        assert abs(np.log1p(found) - np.log1p(true)) < 3 * sigma


def test_what_the_calibration_knows_of_the_lenses_stays_with_them() -> None:
    known = np.diag(np.arange(1.0, 9.0) * np.tile([1e-7, 1e-2, 1e-2, 1e-7], 2)).tolist()
    of_the_old_pose = (np.eye(5) * 1e-8).tolist()
    old = replace(FAR, evidence={"lens_covariance": known, "covariance": of_the_old_pose})
    found = accepted(recalibrate(old, [capture(SCENES["corner"])])).rig.evidence
    assert found["lens_covariance"] == known
    assert found["covariance"] != of_the_old_pose


def test_refitted_lenses_have_the_covariance_of_their_own_fit() -> None:
    camera = replace(CAMERA, K=CAMERA.K * [[1.1, 1, 1], [1, 1.1, 1], [1, 1, 1]])
    points = capture(Scene(planes=[WALL, SIDE_WALL], spheres=[SPHERE]), rig=replace(RIG, camera=camera))
    known = np.diag(np.tile([4e-6, 1.0, 1.0, 1e-6], 2))
    old = replace(RIG, evidence={"lens_covariance": known.tolist()})
    rig = accepted(recalibrate(old, [points], RecalibrateOptions(lens="refit"))).rig
    found = np.array(rig.evidence["lens_covariance"])
    assert found.shape == known.shape
    assert np.linalg.eigvalsh(found)[0] > 0
    assert found[0, 0] > 2 * known[0, 0]  # one picture knows a focal length less well than that calibration did
    assert abs(np.log(rig.camera.K[0, 0] / camera.K[0, 0])) < 5 * np.sqrt(found[0, 0])
