"""The artefact is found by itself, and what is said of it is true within what is said of that."""

import numpy as np
import pytest

from retrue.acceptance.accept import ArtefactNotFound, FewPoints, TooSmall, accept
from retrue.acceptance.artefact import parse_artefact
from retrue.acceptance.fits import fit_sphere
from retrue.acceptance.options import AcceptOptions
from retrue.acceptance.search import feet_on_sphere, find_plane, within_cap
from retrue.errors import InputError
from retrue.geometry.sphere import sphere_through
from retrue.geometry.transform import RigidTransform
from retrue.reconstruction.cloud import Cloud
from retrue.simulation.surfaces import Wall
from tests.acceptance.simulated import RIG, ball, measured, noisy, seen, wrong_rig

BAR = parse_artefact("spheres:45mm:120mm")
CENTRES = np.array([[-60.0, 5, 640], [58.0, -10, 662]])
LENGTH = float(np.linalg.norm(CENTRES[1] - CENTRES[0]))


@pytest.fixture(scope="module")
def bar():
    return seen([ball(*centre, 45) for centre in CENTRES], 4)[0]


@pytest.fixture(scope="module")
def near_bar(bar):
    """Without most of the wall behind, for what is measured many times."""
    x, y = bar.camera_px.T
    return bar.select((abs(x - 320) < 150) & (abs(y - 240) < 60))


def values(answer):
    return {(value.quantity, value.part): value for value in answer.positions[0].values}


def test_a_perfect_rig_measures_a_bar_to_nothing(bar):
    artefact = parse_artefact(f"spheres:45mm:{LENGTH:.9f}mm")
    found = values(accept([measured(RIG, bar)], artefact))
    assert sorted(found) == [
        ("form", "ball 1"),
        ("form", "ball 2"),
        ("size", "ball 1"),
        ("size", "ball 2"),
        ("spacing", ""),
    ]
    assert all(abs(value.value) < 1e-6 and value.expanded < 1e-6 for value in found.values())


def test_a_rig_with_a_longer_baseline_measures_all_as_much_longer(bar):
    from dataclasses import replace

    pose = RIG.projector_from_camera
    longer = replace(RIG, projector_from_camera=RigidTransform(pose.R, pose.t * 1.01))
    artefact = parse_artefact(f"spheres:45mm:{LENGTH:.9f}mm")
    found = values(accept([measured(longer, bar)], artefact))
    assert found["spacing", ""].value == pytest.approx(0.01 * LENGTH, rel=1e-5)
    assert found["size", "ball 1"].value == pytest.approx(0.45, rel=1e-4)


def test_values_lie_within_their_uncertainty_in_nineteen_of_twenty(near_bar):
    random = np.random.default_rng(5)
    off = []
    for _ in range(25):
        rig = wrong_rig(random)
        exact = accept([measured(rig, near_bar)], BAR)
        answer = accept([measured(rig, noisy(near_bar, random))], BAR)
        for value, truth in zip(answer.positions[0].values, exact.positions[0].values, strict=True):
            if value.quantity != "form":  # which noise is a part of
                off.append((value.value - truth.value) / value.expanded)
    off = np.array(off)
    assert len(off) == 75
    assert (np.abs(off) <= 1).mean() > 0.88  # of 95 %, less two standard errors of 75
    assert 0.35 < np.sqrt(np.mean(off**2)) < 0.65  # half of U is one sigma


def test_noise_along_the_rays_makes_no_ball_smaller():
    random, centre, radius = np.random.default_rng(3), np.array([20.0, 10.0, 650.0]), 22.0
    tilt, turn = np.radians(random.uniform(0, 60, 200)), random.uniform(0, 2 * np.pi, 200)
    normals = np.column_stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), -np.cos(tilt)])
    X = centre + radius * normals
    rays = X / np.linalg.norm(X, axis=1, keepdims=True)
    sigma = 0.4
    noise = sigma**2 * (rays[:, :, None] * rays[:, None])
    plain, fitted = [], []
    for _ in range(100):
        moved = X + random.normal(0, sigma, 200)[:, None] * rays
        plain.append(sphere_through(moved).radius - radius)
        fitted.append(fit_sphere(moved, noise, 0.0).parameters[3] - radius)
    doubt = np.std(fitted, ddof=1) / np.sqrt(100)
    assert np.mean(plain) < -3 * doubt
    assert abs(np.mean(fitted)) < 3 * doubt


def test_noise_across_a_ball_is_that_of_each_points_covariance():
    random, centre = np.random.default_rng(4), np.array([20.0, 10.0, 650.0])
    normals = random.normal(size=(300, 3)) * [1, 1, 0.3] - [0, 0, 2]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    longest = np.array([np.sin(0.15), 0.0, np.cos(0.15)])  # between the camera's ray and the projector's
    noise = np.tile(np.outer(longest, longest) + 0.01 * np.eye(3), (300, 1, 1))
    X = centre + 22.0 * normals + 1e-3 * random.multivariate_normal(np.zeros(3), noise[0], 300)
    ratio = fit_sphere(X, noise, 0.0).noise / np.sqrt((normals @ longest) ** 2 + 0.01)
    assert ratio.std() < 1e-3 * ratio.mean()


def test_a_cap_is_cut_where_noise_chooses_no_points():
    random, centre, radius = np.random.default_rng(6), np.array([0.0, 0.0, 600.0]), 20.0
    tilt, turn = np.radians(random.uniform(55, 65, 40_000)), random.uniform(0, 2 * np.pi, 40_000)
    normals = np.column_stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), -np.cos(tilt)])
    ray, across = np.array([0.12, 0.0, 1.0]), np.diag([0.04, 0.04, 0.0])
    noise = np.tile(0.2 * np.outer(ray, ray) + across, (len(tilt), 1, 1))
    X = centre + radius * normals + random.multivariate_normal(np.zeros(3), noise[0], len(tilt))
    feet = feet_on_sphere(X, noise, centre, radius)
    away, sideways = np.linalg.norm(X - centre, axis=1) - radius, np.linalg.norm(X[:, :2], axis=1)
    fair, by_rays = (
        away[chosen].mean() / (away[chosen].std() / np.sqrt(chosen.sum()))
        for chosen in (within_cap(feet, centre, 60.0), sideways < radius * np.sin(np.radians(60.0)))
    )
    assert abs(fair) < 4
    assert by_rays < -8


def test_form_is_repeated_within_its_uncertainty(near_bar):
    random = np.random.default_rng(2)
    answers = [accept([measured(RIG, noisy(near_bar, random))], BAR) for _ in range(25)]
    forms = np.array([values(answer)["form", "ball 1"].value for answer in answers])
    stated = np.mean([values(answer)["form", "ball 1"].expanded for answer in answers]) / 2
    assert 0.6 < forms.std(ddof=1) / stated < 1.5


def test_a_plate_is_found_before_a_larger_wall_that_is_bent_behind_it():
    pose = RigidTransform.from_rotation_vector([0.2, -0.1, 0.0], [0.0, 0.0, 600.0])
    points, surface = seen([Wall(pose, (150.0, 110.0)), ball(0, 0, 2600, 3600)], 4)
    cloud = measured(RIG, noisy(points, np.random.default_rng(0), 0.05))
    rows = find_plane(cloud.points)
    assert (surface[rows] == 0).all()
    assert len(rows) > 0.75 * (surface == 0).sum()
    answer = accept([cloud], parse_artefact("plane"), AcceptOptions(max_flatness=10.0, diagonal=500))
    assert answer.verdict == "passed"
    assert 0.5 < answer.positions[0].values[0].value < 3.0


def test_decisions_count_the_uncertainty(bar):
    cloud = measured(RIG, noisy(bar, np.random.default_rng(1)))
    size = max(
        abs(value.value) + value.expanded for value in values(accept([cloud], BAR)).values() if value.quantity == "size"
    )
    assert accept([cloud], BAR, AcceptOptions(max_size=1.01 * size)).verdict == "passed"
    answer = accept([cloud], BAR, AcceptOptions(max_size=0.99 * size))
    assert answer.verdict == "undecided"
    assert answer.cause.name == "NoDecision"
    assert accept([cloud], BAR, AcceptOptions(max_form=1e-3)).verdict == "failed"


def test_calibration_counts_into_the_uncertainty(bar):
    artefact = parse_artefact(f"spheres:45mm:{LENGTH:.6f}mm+-0.3mm")
    found = values(accept([measured(RIG, bar)], artefact))
    assert found["spacing", ""].expanded == pytest.approx(0.3)


def test_what_is_too_small_too_thin_or_not_there_is_refused(bar):
    cloud = measured(RIG, bar)
    causes = [
        (accept([cloud], parse_artefact("sphere:20mm")), ArtefactNotFound),
        (accept([cloud], parse_artefact("spheres:45mm:200mm")), ArtefactNotFound),
        (accept([cloud], BAR, AcceptOptions(fewest_points=5000)), FewPoints),
        (accept([cloud], BAR, AcceptOptions(diagonal=401)), TooSmall),
        (accept([cloud], parse_artefact("sphere:45mm"), AcceptOptions(diagonal=2300)), TooSmall),
    ]
    for answer, cause in causes:
        assert answer.verdict == "refused"
        assert isinstance(answer.cause, cause)
        assert not answer.positions[0].values
    noise = Cloud(
        np.random.default_rng(0).normal(loc=(0, 0, 9), size=(500, 3)), cloud.colors[:500], cloud.camera_px[:500], "mm"
    )
    assert accept([noise], parse_artefact("sphere:1mm")).verdict == "refused"
    assert accept([noise.select(np.arange(2))], parse_artefact("plane")).verdict == "refused"


def test_points_too_far_apart_to_show_a_ball_are_told_from_a_ball_that_is_not_there(bar):
    """ "Is it in view?" sends people to look for what lies before their eyes."""
    cloud = measured(RIG, bar)
    thin = cloud.select(np.arange(0, len(cloud), 150))
    assert "as far apart as they are; take it nearer, or a denser pattern" in accept([thin], BAR).reason
    assert "is it in view" in accept([cloud], parse_artefact("spheres:45mm:200mm")).reason
    assert "is it in view" in accept([cloud.select(cloud.points[:, 2] > 750)], BAR).reason


def test_a_position_without_the_artefact_leaves_the_test_undecided(bar):
    cloud = measured(RIG, bar)
    empty = cloud.select(cloud.points[:, 2] > 750)
    answer = accept([cloud, empty], BAR, AcceptOptions(max_form=1.0), names=["here", "gone"])
    assert answer.verdict == "undecided"
    assert answer.positions[1].cause.name == "ArtefactNotFound"
    assert "nothing measured in 1 position" in answer.reason


def test_clouds_must_share_a_unit_of_known_length(bar):
    cloud = measured(RIG, bar)
    other = Cloud(cloud.points, cloud.colors, cloud.camera_px, "cubit")
    with pytest.raises(InputError, match="cubit"):
        accept([other], BAR)
    with pytest.raises(InputError, match="expected one unit of length, found cubit, mm"):
        accept([cloud, other], BAR)
    with pytest.raises(InputError, match="at least one position"):
        accept([], BAR)
