"""verify: good, drifted or unknown, about every axis, without crying wolf."""

import numpy as np
import pytest

from retrue.errors import InputError
from retrue.recalibration.verify import verify
from tests.recalibration.scenes import RIG, SPHERE, Scene, bumped, capture

WITH_SPHERE = Scene(spheres=[SPHERE])


def test_a_rig_that_holds_is_good() -> None:
    for seed in range(20):
        found = verify(RIG, [capture(WITH_SPHERE, seed=seed)])
        assert found.verdict == "good", found.reason
        assert found.epipolar_rms_px == pytest.approx(0.1, rel=0.3)


@pytest.mark.parametrize("outliers", [0.0, 0.2])
def test_half_a_degree_about_any_axis_is_found(outliers: float) -> None:
    rng = np.random.default_rng(0)
    points = capture(WITH_SPHERE, outliers=outliers)
    for axis in np.concatenate([np.eye(3), rng.normal(size=(7, 3))]):
        axis = 0.5 * axis / np.linalg.norm(axis)
        found = verify(bumped(RIG, axis, [0, 0, 0]), [points])
        assert found.verdict == "drifted", (axis, found.reason)
        assert found.drift is not None
        assert found.drift.rotation_deg == pytest.approx(0.5, abs=0.05)


def test_a_bare_wall_still_shows_a_drift() -> None:
    points = capture(Scene())
    assert verify(RIG, [points]).verdict == "good"
    assert verify(bumped(RIG, [0, 1, 0], [0, 0, 0]), [points]).verdict == "drifted"


def test_what_cannot_tell_is_unknown() -> None:
    few = capture(Scene()).select(np.arange(5))
    patch = capture(Scene(), area=(0.48, 0.52, 0.48, 0.52), grid=(10, 10))
    for points in (few, patch):
        found = verify(RIG, [points])
        assert found.verdict == "unknown", found.reason
    with pytest.raises(InputError):
        verify(RIG, [])
