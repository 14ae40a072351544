"""The shape of pixels: square where the boards let them be, found where they are not, untouched where nothing tells."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest

from retrue.calibration.calibrate import calibrate_views
from retrue.calibration.observations import View
from retrue.calibration.options import CalibrationOptions
from retrue.calibration.result import Calibrated
from retrue.calibration.square_pixels import UNSEEN
from retrue.geometry.camera import Camera
from retrue.rig import Rig
from tests.calibration.test_calibrate import BOARD, SIZES

DEVICES = ("camera", "projector")
ANY = CalibrationOptions(largest_error=1)


def squeezed(benchmark: ModuleType, count: int, seed: int, aspects: tuple[float, float]) -> tuple[Rig, list[View]]:
    """Views of a rig with these fy / fx."""
    rng = np.random.default_rng([41, seed])
    truth = benchmark.true_rig(rng)
    devices: list[Camera] = []
    for device, aspect in zip((truth.camera, truth.projector), aspects, strict=True):
        K = device.K.copy()
        K[1, 1] = aspect * K[0, 0]
        devices.append(Camera(device.size, K, device.distortion))
    truth = Rig(*devices, truth.projector_from_camera)
    bend = benchmark.bend_of(BOARD, benchmark.DECODER, rng)
    return truth, [
        benchmark.simulated_view(truth, BOARD, benchmark.DECODER, rng, f"pose {i}", bend=bend) for i in range(count)
    ]


def aspect(device: Camera) -> float:
    return float(device.K[1, 1] / device.K[0, 0])


@pytest.mark.parametrize("count", [2, 5])
def test_square_pixels_stay_square(benchmark: ModuleType, count: int) -> None:
    for seed in range(2):
        truth, views = squeezed(benchmark, count, seed, (1.0, 1.0))
        result = calibrate_views(views, BOARD, SIZES, ANY)
        assert isinstance(result, Calibrated)
        for name in DEVICES:
            found, lens = getattr(result.rig, name), result.evidence["distortion"][name]
            assert "aspect" not in lens["kept"]
            assert lens["chi_square_gain"]["aspect"] < np.log(1e5)
            assert abs(aspect(found) - 1) < 2 * UNSEEN
            # Both focal lengths are one: what is stated of their ratio is what is known beforehand, at most.
            sigma = result.evidence["sigma"][name]
            assert abs(sigma["fx"] - sigma["fy"]) < 2 * UNSEEN * found.K[0, 0]
        # The pose and the lenses, in the sigmas that became smaller.
        errors = (
            ("lens_covariance", benchmark.lens_parameters(result.rig) - benchmark.lens_parameters(truth)),
            ("covariance", benchmark.pose_error(result.rig.projector_from_camera, truth.projector_from_camera)),
        )
        for key, error in errors:
            assert error @ np.linalg.solve(np.array(result.evidence[key]), error) < 4 * len(error)


@pytest.mark.parametrize("aspects", [(1.005, 0.995), (0.8, 1.25)])
def test_pixels_that_are_not_square_are_found(benchmark: ModuleType, aspects: tuple[float, float]) -> None:
    truth, views = squeezed(benchmark, 5, 0, aspects)
    result = calibrate_views(views, BOARD, SIZES, ANY)
    assert isinstance(result, Calibrated)
    for name, true in zip(DEVICES, aspects, strict=True):
        assert "aspect" in result.evidence["distortion"][name]["kept"]
        assert aspect(getattr(result.rig, name)) == pytest.approx(true, abs=0.0015)
    assert benchmark.rig_errors(result.rig, truth)[0] < 0.3


def test_one_device_of_the_two(benchmark: ModuleType) -> None:
    truth, views = squeezed(benchmark, 5, 1, (1.0, 1.01))
    kept = [lens["kept"] for lens in calibrate_views(views, BOARD, SIZES, ANY).evidence["distortion"].values()]
    assert ["aspect" in names for names in kept] == [False, True]
    # A lens that was handed in stays as it is, whatever its pixels.
    result = calibrate_views(views, BOARD, SIZES, ANY, known=(None, truth.projector))
    assert isinstance(result, Calibrated)
    assert result.rig.projector is truth.projector
    assert result.evidence["distortion"]["projector"]["kept"] == []
    assert aspect(result.rig.camera) == pytest.approx(1, abs=2 * UNSEEN)
