"""What passes for planes and is none, and points that are more exact than the lenses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.any_rig import draw, pose_error
from retrue.correspondences import Correspondences
from retrue.geometry.camera import Camera
from retrue.geometry.transform import direction_angle, rotation_angle
from retrue.recalibration import reasons
from retrue.recalibration.candidates import split_planes, with_planes
from retrue.recalibration.fit import Support
from retrue.recalibration.judge import judge
from retrue.recalibration.lens_evidence import untold_misfit
from retrue.recalibration.measured import MISFIT_PX, Measured
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.rays import rays_of_captures
from retrue.recalibration.recalibrate import recalibrate
from retrue.recalibration.result import Accepted, Refused
from retrue.recalibration.swapped import exchanged
from retrue.rig import Rig
from tests.recalibration.scenes import BALL, CAMERA, POSE, RIG, SIDE_WALL, SPHERE, WALL, Scene, bumped, capture

OLD = bumped(RIG, [2, 5, -1], [0, 4, 0])


def off_deg(result: Accepted) -> tuple[float, float]:
    pose = result.evidence.pose
    assert pose is not None
    return float(np.degrees(rotation_angle(pose.R @ POSE.R.T))), float(np.degrees(direction_angle(pose.t, POSE.t)))


@pytest.mark.parametrize("noise", [0.02, 0.1])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_ball_is_no_bowed_plane(noise: float, seed: int) -> None:
    result = recalibrate(OLD, [capture(BALL, noise=noise, seed=seed)])
    assert isinstance(result, Accepted), result.reason
    assert result.evidence.sigma is not None
    rotation, translation = off_deg(result)
    assert rotation < max(0.2, 4 * result.evidence.sigma.rotation_deg)
    assert translation < max(0.2, 4 * result.evidence.sigma.translation_deg)


@pytest.mark.parametrize("shift", [(1.5, -1.0), (-2.0, 1.0), (0.5, 2.0)])
def test_a_corner_is_one_pose_though_its_points_are_more_exact_than_the_lens(shift: tuple[float, float]) -> None:
    K = CAMERA.K.copy()
    K[:2, 2] += shift  # of a principal point that is known to a pixel
    seen = capture(
        Scene(planes=[WALL, SIDE_WALL]),
        rig=Rig(Camera(CAMERA.size, K, CAMERA.distortion), RIG.projector, POSE),
        noise=0.01,
    )
    result = recalibrate(OLD, [seen])
    assert isinstance(result, Accepted), result.reason
    assert result.evidence.sigma is not None
    rotation, translation = off_deg(result)
    assert rotation < 4 * result.evidence.sigma.rotation_deg
    assert translation < 4 * result.evidence.sigma.translation_deg


def test_a_capture_that_has_nothing_in_common_with_the_others_is_named() -> None:
    moved = bumped(RIG, [0, 12, 5], [0, 20, 0])
    scene = Scene(spheres=[SPHERE])
    captures = [capture(scene), capture(scene, seed=1), capture(scene, rig=moved, seed=2)]
    result = recalibrate(RIG, captures)
    assert isinstance(result, Refused)
    assert isinstance(result.cause, reasons.CapturesDiffer), result.reason
    assert result.cause.capture == 3


def test_no_point_in_common_is_said_so() -> None:
    assert "number 2 has no point in common with the others" in str(reasons.CapturesDiffer(2, np.inf))
    assert "number 2 is 12 sigma off the others" in str(reasons.CapturesDiffer(2, 12.3))


def test_exchanged_devices_are_named_where_a_part_fits_better_as_it_is() -> None:
    """Exchanged, all points agree, but more loudly: their noise was that of the other device."""
    square = Camera((1280, 960), [[1500, 0, 640], [0, 1500, 480], [0, 0, 1]])
    rig = Rig(square, square, POSE, "m")
    seen = capture(Scene(planes=[WALL, SIDE_WALL], spheres=[SPHERE]), rig=rig, noise=0.2)
    backwards: Correspondences = exchanged(replace(seen, projector_sigma_px=np.full(len(seen), 0.1)))
    result = recalibrate(rig, [backwards])
    assert isinstance(result, Refused)
    assert isinstance(result.cause, reasons.DevicesExchanged), result.reason


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_a_plane_is_found_where_wrong_neighbours_make_the_noise_so_large_that_another_seems_of_it(seed: int) -> None:
    """Five times as large: a second one, two pixels off, fills the band about the first; the others are anywhere."""
    rng, pixel = np.random.default_rng(seed), 1 / 700
    x = rng.uniform(-0.4, 0.4, (400, 2))
    y = x @ np.array([[1.02, -0.02], [0.01, 0.98]]) + [0.1, -0.02] + rng.normal(0, 0.1 * pixel, x.shape)
    y[100:180, 0] += rng.uniform(1.5, 2.5, 80) * pixel
    y[180:] = rng.uniform(-0.4, 0.4, (220, 2))
    _, plane_index = split_planes(x, y, 0.5 * pixel, min_points=12, max_planes=4, rng=rng)
    assert np.array_equal(np.flatnonzero(plane_index == 0), np.arange(100))


@pytest.mark.parametrize("seed", [4, 5, 6])
def test_devices_are_not_exchanged_where_nothing_explains_the_points_that_way_either(seed: int) -> None:
    """Bricks: each match is any number of periods off."""
    square = Camera((1280, 960), [[1500, 0, 640], [0, 1500, 480], [0, 0, 1]])
    rig, rng = Rig(square, square, POSE, "m"), np.random.default_rng(seed)
    seen = capture(Scene(planes=[WALL]), rig=rig, noise=0.2, seed=seed)
    bricks = seen.projector_px + rng.integers(-3, 4, (len(seen), 2)) * [90.0, 70.0]
    there = square.contains(bricks)
    result = recalibrate(rig, [replace(seen.select(np.flatnonzero(there)), projector_px=bricks[there])])
    assert isinstance(result, Refused)
    assert isinstance(result.cause, reasons.PointsDisagree), result.reason


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_plane_is_as_loud_as_the_coarser_device_makes_it(seed: int) -> None:
    """A pixel of the camera is six of the projector, and half of the matches are wrong."""
    coarse = Camera((640, 480), [[400, 0, 319.5], [0, 400, 239.5], [0, 0, 1]])
    fine = Camera((1024, 768), [[2400, 0, 511.5], [0, 2400, 383.5], [0, 0, 1]])
    rig, options = Rig(coarse, fine, POSE, "m"), RecalibrateOptions()
    seen = capture(Scene(planes=[WALL]), rig=rig, noise=0.45, outliers=0.48, seed=seed, grid=(26, 20))
    rng = np.random.default_rng(0)
    rays, homographies = with_planes(rays_of_captures(rig, [seen], options.max_points, rng), rig, options, rng)
    assert len(homographies) == 1
    assert np.count_nonzero(rays.points.plane_index == 0) > 0.95 * 0.52 * len(seen)


@pytest.mark.parametrize("longer", [-0.15, -0.1, 0.1])
def test_another_lens_is_told_from_a_slow_error(longer: float) -> None:
    """Through it a ball leaves what looks like an error that neighbours share."""
    K = CAMERA.K.copy()
    K[[0, 1], [0, 1]] *= 1 + longer
    told = replace(bumped(RIG, [1, 2, 0], [0, 2, 0]), camera=Camera(CAMERA.size, K, CAMERA.distortion))
    result = recalibrate(told, [capture(BALL, noise=0.05, area=(0.1, 0.9, 0.1, 0.9))])
    assert isinstance(result, Refused)
    assert isinstance(result.cause, reasons.LensChanged), result.reason
    assert result.cause.what == "focal length"


def test_what_few_blocks_do_not_tell_of_a_lens_is_believed() -> None:
    options, rng = RecalibrateOptions(), np.random.default_rng(0)
    shares: list[float] = []
    for area in ((0.02, 0.98, 0.02, 0.98), (0.45, 0.55, 0.45, 0.55)):
        rays = rays_of_captures(RIG, [capture(Scene(), area=area)], options.max_points, rng)
        n = len(rays)
        blocks = np.stack([np.arange(n) % 36, np.arange(n) % 36]) if not shares else np.zeros((2, n), dtype=np.int64)
        measured = Measured(
            RIG,
            np.zeros((n, 2)),
            np.zeros((n, 2)),
            Support(rays.points, blocks),
            np.zeros((n, 3)),
            1e-4,
            np.empty((n, 0), dtype=np.int64),
        )
        shares.append(untold_misfit(measured) / MISFIT_PX)
    assert shares[0] == pytest.approx(np.sqrt(36 / (36 + 36 - 13)))
    assert shares[1] == 1.0


def pillar(device: str, focal: float, seed: int) -> Correspondences:
    """A round pillar that stands askew, through lenses of which one has another focal length."""
    rng = np.random.default_rng(seed)
    angle, height = rng.uniform(-1.2, 1.2, 1500), rng.uniform(-0.8, 0.8, 1500)
    along, across = np.array([-0.3, 0.95, 0.0]), np.array([0.95, 0.3, 0.0])
    points = 0.6 * np.sin(angle)[:, None] * across + height[:, None] * along
    points += [0, 0, 2] - 0.6 * np.cos(angle)[:, None] * np.array([0, 0, 1])
    lenses = {"camera": RIG.camera, "projector": RIG.projector}
    K = lenses[device].K.copy()
    K[:2, :2] *= focal
    lenses[device] = replace(lenses[device], K=K)
    camera_px = lenses["camera"].project(points)
    projector_px = lenses["projector"].project(points @ POSE.R.T + POSE.t)
    pixels = zip((camera_px, projector_px), lenses.values(), strict=True)
    seen = np.all([((px >= 0) & (px < lens.size)).all(axis=1) for px, lens in pixels], axis=0)
    return Correspondences(camera_px[seen] + rng.normal(0, 0.1, (np.count_nonzero(seen), 2)), projector_px[seen])


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize(("device", "focal"), [("camera", 1.05), ("projector", 0.96), ("projector", 1.05)])
def test_strips_of_a_pillar_that_pass_for_planes_do_not_hide_another_lens(device: str, focal: float, seed: int) -> None:
    result = recalibrate(OLD, [pillar(device, focal, seed)])
    assert isinstance(result, Refused)
    assert isinstance(result.cause, reasons.LensChanged)


@pytest.mark.parametrize("seed", [0, 1])
def test_strips_of_a_pillar_blame_no_lens_that_holds(seed: int) -> None:
    result = recalibrate(OLD, [pillar("camera", 1.0, seed)])
    assert isinstance(result, Accepted), result.reason
    assert result.evidence.sigma is not None
    rotation, translation = off_deg(result)
    assert rotation < max(0.2, 4 * result.evidence.sigma.rotation_deg)
    assert translation < max(0.2, 4 * result.evidence.sigma.translation_deg)


@pytest.mark.parametrize(("noise", "grid", "seeds"), [(0.5, (20, 16), [22, 42, 43]), (1.0, (40, 30), [5, 12, 15, 20])])
def test_noise_makes_no_wall_curved(noise: float, grid: tuple[int, int], seeds: list[int]) -> None:
    """Of 60 small walls each, some of those where a pose without the plane was quieter across its lines by chance."""
    slanted = Scene(planes=[(np.array([0.3, 0.1, 1.0]), 1.5)])
    for seed in seeds:
        wall = capture(slanted, noise=0.0, seed=seed, grid=grid, area=(0.4, 0.6, 0.4, 0.6))
        missed = noise * np.random.default_rng(seed).normal(size=wall.camera_px.shape)
        points = replace(wall, camera_px=wall.camera_px + missed)
        answer = judge(bumped(RIG, [1, 1, 1], [1, 1, 1]), [points], RecalibrateOptions()).answer
        assert len(answer.pose.planes) == 1


@pytest.mark.parametrize("seed", [314, 315, 1742])
def test_curved_scenes_and_codes_off_by_a_shift_blame_no_lens(seed: int) -> None:
    case = draw(seed)  # saddle and ball, a third of each shifted; a surface that bends both ways
    result = recalibrate(case.rig, [case.points])
    assert isinstance(result, Accepted), result.reason
    assert result.evidence.lens == "unchecked"
    assert result.evidence.pose is not None
    assert result.evidence.sigma is not None
    pose, sigma = result.evidence.pose, result.evidence.sigma
    rotation, translation = np.split(np.degrees(pose_error(pose.R, pose.t, case)), [3])
    assert np.linalg.norm(rotation) < max(0.2, 4 * sigma.rotation_deg)
    assert np.linalg.norm(translation) < max(0.2, 4 * sigma.translation_deg)
