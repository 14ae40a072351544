"""The shutter is told by content alone; frames are numbered by it, whatever their time of arrival says."""

from __future__ import annotations

import numpy as np
import pytest

from retrue.devices.frame_order import FITS, FrameOrder, Shows
from retrue.devices.probes import find_probes
from retrue.devices.recorder import Recorder
from retrue.devices.shutter import Shutter
from retrue.devices.shutter_fit import Change, fit_shutter
from tests.devices.rigs import GRAY, Witness, small_rig


@pytest.mark.parametrize("gamma", [1.0, 2.2])
def test_readout_exposure_and_gamma_are_those_of_the_camera(gamma):
    rig = small_rig(fps=28.3, readout=0.7, exposure_ms=15.0, bright_ms=15.0, gamma=gamma, drop=0.02, lag_frames=3)
    recorder = Recorder(Witness(rig), rig.projector)
    recorder.record(GRAY[:4])
    shutter = recorder.shutter
    assert shutter is not None
    period = 1 / 28.3
    assert shutter.period == pytest.approx(period, rel=1e-4)
    assert shutter.readout == pytest.approx(0.7 * period, abs=0.02 * period)
    assert shutter.exposure == pytest.approx(0.015, abs=0.02 * period)
    assert (shutter.start / period + 0.5) % 1 == pytest.approx(0.5, abs=0.02)  # frames begin at whole periods
    assert shutter.gamma == pytest.approx(gamma, abs=0.15)


def test_what_two_phases_do_not_tell_is_as_the_camera_says():
    """Changes of a screen at 60 Hz fall at two places of a frame at 30; here they leave only readout / exposure."""
    period, exposure = 1 / 30, 0.376 / 30
    rig = small_rig(readout=0.649, exposure_ms=1000 * exposure, bright_ms=12.5)
    recorder = Recorder(Witness(rig), rig.projector)
    recorder.record(GRAY[:4])
    assert recorder.shutter is not None
    assert recorder.shutter.exposure == pytest.approx(exposure, abs=0.01 * period)
    assert recorder.shutter.readout == pytest.approx(0.649 * period, abs=0.01 * period)


def test_what_no_shutter_explains_has_none():
    rig = small_rig()
    recorder = Recorder(Witness(rig), rig.projector)
    recorder.measure()
    assert recorder.references is not None
    probes = find_probes(recorder.references)
    random = np.random.default_rng(0)
    seen = [random.integers(0, 256, (4, *probes.black.shape)).astype(float) for _ in range(6)]
    changes = [Change(float(turn), True, [turn + 0.1 * step for step in range(4)], seen[turn]) for turn in range(6)]
    assert fit_shutter(changes, probes, 0.1) is None
    assert fit_shutter([], probes, 0.1) is None


def numbered(lost: set[int], arrivals: np.ndarray) -> tuple[list[int], list[int]]:
    """True numbers of frames of random pictures, and those that they are given."""
    rig = small_rig()
    recorder = Recorder(Witness(rig), rig.projector)
    recorder.measure()
    assert recorder.references is not None
    probes, shutter = find_probes(recorder.references), Shutter(0.0, 1.0, 0.94, 0.84)
    random, shows = np.random.default_rng(1), Shows()
    for at in np.arange(4.0, 40, 2):
        shows.add(float(at))
    shape = probes.index.shape
    looks = random.integers(0, 2, (len(shows.at), *shape)).astype(float)
    order = FrameOrder(shutter, probes, shows, 0.01, 10)
    numbers = [number for number in range(40) if number not in lost]
    for number in numbers:
        shares = shutter.shares(number, probes.middle, np.array(shows.at))
        light = np.einsum("bs,sbp->bp", shares, looks) + 0.01 * random.standard_normal(shape)
        picture = recorder.references.black.astype(float).reshape(-1, 3)
        picture[probes.index] = probes.black + light[..., None] * (probes.white - probes.black)
        order.add(picture.reshape(recorder.references.black.shape), float(arrivals[number]))
    placed = list(order.ended()[0].back())[::-1]
    assert all((one.off[probes.lit] <= FITS).all() for one in placed)
    return numbers, [one.number for one in placed]


@pytest.mark.parametrize("late", [0, 5])
def test_frames_are_numbered_by_what_is_in_them(late):
    random = np.random.default_rng(late)
    arrivals = np.maximum.accumulate(np.arange(40) + 1.3 + random.integers(0, late + 1, 40))
    true, found = numbered({9, 17, 18, 30}, arrivals)
    assert found[4:-1] == true[4:-1]  # before the first change, and after the last one, nothing tells
