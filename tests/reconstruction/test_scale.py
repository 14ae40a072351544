"""Scale from clicks, balls and bars; its sigma against noise that is drawn."""

from dataclasses import replace

import numpy as np
import pytest

from retrue.correspondences import Correspondences
from retrue.errors import DegenerateError, InputError
from retrue.reconstruction.reconstruct import reconstruct
from retrue.reconstruction.scale import scale_from_ball, scale_from_ball_bar, scale_from_points, scaled_rig
from tests.reconstruction.scenes import BALL, CAMERA, PROJECTOR, RIG, scene

CENTRE, RADIUS = np.array([250.0, 0.0, 1300.0]), 260.0
CLICK = CAMERA.project(CENTRE)


def cloud_of(seed, rig=RIG, noise=0.1):
    X, _, cells, thing = scene(3)
    rng = np.random.default_rng(seed)
    seen = PROJECTOR.project(RIG.projector_from_camera.apply(X)) + rng.normal(0, noise, (len(X), 2))
    stated = np.full(len(X), noise)
    return reconstruct(rig, Correspondences(CAMERA.project(X), seen, projector_sigma_px=stated, cells=cells)), X, thing


def test_a_ball_gives_the_scale_within_its_sigma():
    found = [scale_from_ball(cloud_of(seed)[0], CLICK, 2 * RADIUS) for seed in range(12)]
    off = np.array([(scale.factor - 1) / scale.sigma for scale in found])
    assert found[0].sigma < 2e-3
    assert np.abs(off).max() < 4
    assert np.sqrt(np.mean(off**2)) < 1.7


def test_two_clicks_give_the_scale_within_their_sigma():
    X, camera_px, _, _ = scene(1)
    first, second = (np.flatnonzero((np.rint(camera_px) == pixel).all(axis=1))[0] for pixel in ([30, 200], [120, 210]))
    length = float(np.linalg.norm(X[first] - X[second]))
    off = []
    for seed in range(12):
        scale = scale_from_points(cloud_of(seed)[0], camera_px[first], camera_px[second], length)
        off.append((scale.factor - 1) / scale.sigma)
    assert np.sqrt(np.mean(np.square(off))) < 1.7


def test_a_wrong_scale_is_mended_and_its_sigma_kept():
    rig = replace(RIG, projector_from_camera=replace(RIG.projector_from_camera, t=RIG.projector_from_camera.t * 0.5))
    cloud, _, _ = cloud_of(0, rig)
    scale = scale_from_ball(cloud, CLICK, 2 * RADIUS, sigma=0.52)
    assert scale.factor == pytest.approx(2, rel=5e-3)
    assert scale.sigma >= 1e-3
    mended = scaled_rig(rig, scale)
    np.testing.assert_allclose(mended.projector_from_camera.t, RIG.projector_from_camera.t, rtol=5e-3)
    assert mended.evidence["scale_sigma"] == scale.sigma
    again = reconstruct(
        mended,
        Correspondences(
            CAMERA.project([[0, 0, 1500.0]]),
            PROJECTOR.project(RIG.projector_from_camera.apply(np.array([[0, 0, 1500.0]]))),
        ),
    )
    common = np.sqrt(np.trace(again.covariance("common")[0]))
    assert common == pytest.approx(scale.sigma * np.linalg.norm(again.points[0]), rel=1e-3)


def test_what_cannot_tell_is_refused():
    cloud, _, _ = cloud_of(0)
    with pytest.raises(DegenerateError, match=r"nearly flat|expected 30"):
        scale_from_ball(cloud, [30, 220], 100.0)
    with pytest.raises(InputError, match="both on one"):
        scale_from_ball_bar(cloud, CLICK, CLICK + 5, 100.0)
    with pytest.raises(InputError, match="more than 0"):
        scale_from_points(cloud, [30, 200], [120, 200], 0.0)
    with pytest.raises(DegenerateError, match="px away"):
        scale_from_points(cloud, [3000, 200], [120, 200], 10.0)


def test_ball_is_made_of_the_points_on_it():
    cloud, _, thing = cloud_of(1)
    assert (thing == BALL).sum() > 200
    assert scale_from_ball(cloud, CLICK, 2 * RADIUS).how.startswith("a ball, ")


def test_a_click_beside_the_points_is_not_led_away_by_them():
    """The nearest points lie on one line there: they tell nothing of the slope across it."""
    cloud, _, _ = cloud_of(0)
    edge = cloud.camera_px[np.argmin(cloud.camera_px[:, 0])]
    with pytest.raises(InputError, match="one point nearest to both clicks"):
        scale_from_points(cloud, edge - [14, 0], edge - [7, 0], 100.0)
    inside = cloud.camera_px[np.argmax(cloud.camera_px[:, 0])]
    near, away = (scale_from_points(cloud, edge - [beside, 0], inside, 100.0).measured for beside in (0, 10))
    assert away == pytest.approx(near, rel=0.05)
