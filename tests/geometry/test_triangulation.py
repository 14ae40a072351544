import numpy as np
import pytest
from scipy.optimize import minimize

from retrue.geometry.transform import RigidTransform
from retrue.geometry.triangulation import BLOCK, sampson_distances, triangulate, triangulate_linear

POSE = RigidTransform.from_rotation_vector([0.05, 0.4, -0.1], [-0.6, 0.05, 0.15])
SOLVERS = [triangulate, triangulate_linear]


def rays_of(points, pose=POSE):
    seen = pose.apply(points)
    return points[:, :2] / points[:, 2:], seen[:, :2] / seen[:, 2:]


def random_points(rng, count):
    return np.column_stack([rng.uniform(-0.5, 0.5, (count, 2)), rng.uniform(1, 2, count)])


@pytest.mark.parametrize("solve", SOLVERS)
def test_exact_rays_give_the_points_across_blocks(solve):
    points = random_points(np.random.default_rng(0), BLOCK + 3)
    assert np.abs(solve(POSE, *rays_of(points)) - points).max() < 1e-13


@pytest.mark.parametrize("solve", SOLVERS)
def test_no_points_give_no_points(solve):
    assert solve(POSE, np.empty((0, 2)), np.empty((0, 2))).shape == (0, 3)


@pytest.mark.parametrize("solve", SOLVERS)
def test_rectified_pair(solve):
    pose = RigidTransform(np.eye(3), [-0.2, 0.0, 0.0])
    points = random_points(np.random.default_rng(1), 50)
    assert np.abs(solve(pose, *rays_of(points, pose)) - points).max() < 1e-12


@pytest.mark.parametrize("solve", SOLVERS)
def test_parallel_rays_have_no_point(solve):
    direction = np.array([[0.1, 0.2, 1.0]])
    turned = direction @ POSE.R.T
    assert np.isnan(solve(POSE, direction[:, :2], turned[:, :2] / turned[:, 2:])).all()


@pytest.mark.parametrize("solve", SOLVERS)
@pytest.mark.parametrize(("depth", "forward"), [(-0.5, 1.0), (0.5, -1.0)], ids=["camera", "projector"])
def test_points_behind_one_device_have_no_point(solve, depth, forward):
    pose = RigidTransform(POSE.R, [-0.6, 0.0, forward])
    points = random_points(np.random.default_rng(8), 20) * [0.2, 0.2, 0] + [0, 0, depth]
    assert ((pose.apply(points)[:, 2] > 0) == (depth < 0)).all()
    assert np.isnan(solve(pose, *rays_of(points, pose))).all()


@pytest.mark.parametrize("solve", SOLVERS)
def test_coinciding_devices_see_no_depth(solve):
    pose = RigidTransform(POSE.R, np.zeros(3))
    assert np.isnan(solve(pose, *rays_of(random_points(np.random.default_rng(2), 20), pose))).all()


@pytest.mark.parametrize("solve", SOLVERS)
def test_nan_stays_where_it_is(solve):
    points = random_points(np.random.default_rng(3), 5)
    camera_rays, projector_rays = rays_of(points)
    camera_rays[2, 0] = np.nan
    found = solve(POSE, camera_rays, projector_rays)
    assert np.isnan(found[2]).all()
    assert np.isfinite(np.delete(found, 2, axis=0)).all()


def test_the_optimum_is_what_a_minimiser_finds():
    rng = np.random.default_rng(4)
    points = random_points(rng, 10)
    camera_rays, projector_rays = (ray + rng.normal(scale=5e-3, size=ray.shape) for ray in rays_of(points))
    sigmas = (1.0, 2.5)

    def cost(point, row):
        camera_ray, projector_ray = rays_of(point[None])
        return (
            np.sum((camera_ray - camera_rays[row]) ** 2) / sigmas[0] ** 2
            + np.sum((projector_ray - projector_rays[row]) ** 2) / sigmas[1] ** 2
        )

    found = triangulate(POSE, camera_rays, projector_rays, camera_sigma=sigmas[0], projector_sigma=sigmas[1])
    for row, point in enumerate(found):
        best = minimize(lambda p, row=row: 1e6 * cost(p, row), point, method="Nelder-Mead", options={"xatol": 1e-9})
        assert cost(point, row) <= best.fun / 1e6 * (1 + 1e-4)


def test_a_sigma_for_each_point_is_the_scalar_of_that_point():
    rng = np.random.default_rng(5)
    camera_rays, projector_rays = (
        ray + rng.normal(scale=1e-3, size=ray.shape) for ray in rays_of(random_points(rng, 4))
    )
    sigma = np.array([0.5, 1.0, 2.0, 4.0])
    together = triangulate(POSE, camera_rays, projector_rays, camera_sigma=sigma)
    for row in range(4):
        alone = triangulate(POSE, camera_rays[[row]], projector_rays[[row]], camera_sigma=sigma[row])
        assert np.array_equal(together[[row]], alone)


def test_unequal_noise_is_worth_knowing():
    rng = np.random.default_rng(6)
    points = random_points(rng, 20_000)
    camera_rays, projector_rays = rays_of(points)
    camera_rays = camera_rays + rng.normal(scale=1e-4, size=camera_rays.shape)
    projector_rays = projector_rays + rng.normal(scale=1e-3, size=projector_rays.shape)

    def error(found):
        return np.sqrt(np.mean((found - points) ** 2))

    optimal = error(triangulate(POSE, camera_rays, projector_rays, camera_sigma=1e-4, projector_sigma=1e-3))
    assert optimal < 0.999 * error(triangulate(POSE, camera_rays, projector_rays))
    assert optimal < 0.999 * error(triangulate_linear(POSE, camera_rays, projector_rays))


def test_sampson_distance_is_the_distance_to_rays_that_meet():
    rng = np.random.default_rng(7)
    camera_rays, projector_rays = (
        ray + rng.normal(scale=1e-4, size=ray.shape) for ray in rays_of(random_points(rng, 50))
    )
    found = triangulate(POSE, camera_rays, projector_rays, camera_sigma=0.5, projector_sigma=2.0)
    camera_met, projector_met = rays_of(found)
    moved = (
        np.sum((camera_met - camera_rays) ** 2, axis=1) / 0.25
        + np.sum((projector_met - projector_rays) ** 2, axis=1) / 4
    )
    distance = sampson_distances(POSE, camera_rays, projector_rays, camera_sigma=0.5, projector_sigma=2.0)
    assert np.allclose(np.abs(distance), np.sqrt(moved), rtol=1e-3)


def test_at_both_epipoles_there_is_no_sampson_distance():
    forward = RigidTransform(np.eye(3), [0.0, 0.0, 1.0])
    distances = sampson_distances(forward, [[0.0, 0.0], [0.1, 0.0]], [[0.0, 0.0], [0.1, 0.0]])
    assert np.isnan(distances[0])
    assert distances[1] == 0
