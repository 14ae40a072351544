"""Frames are counted by the camera's period: lost ones leave their number out, late ones do not."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from retrue.devices.frame_count import Counted, FrameCount
from retrue.devices.protocols import CameraFrame


def counted(periods: Sequence[float]) -> list[Counted]:
    times = iter(np.cumsum([0.0, *periods]) * 0.05 + 7)

    class Camera:
        def frame(self) -> CameraFrame:
            return CameraFrame(np.zeros((2, 2), np.uint8), float(next(times)))

    camera: Any = Camera()
    count = FrameCount(camera, 0.05)
    return [count.next() for _ in range(len(periods) + 1)]


@pytest.mark.parametrize(
    ("periods", "numbers"),
    [
        ([1, 1, 1], [0, 1, 2, 3]),
        ([1, 2, 1], [0, 1, 3, 4]),  # one is lost
        ([1, 1.6, 0.4, 1], [0, 1, 2, 3, 4]),  # one is late
        ([1.2, 0.8, 1.3, 0.7, 1], [0, 1, 2, 3, 4, 5]),
        ([1.02] * 60, list(range(61))),  # the period is not quite known
    ],
)
def test_lost_frames_are_counted_and_late_ones_are_not(periods: list[float], numbers: list[int]):
    frames = counted(periods)
    assert [frame.number for frame in frames] == numbers
    assert all(frame.in_step for frame in frames)


@pytest.mark.parametrize("periods", [[1, 1, 0.1], [1, 3], [1, 2, 1, 2], [1, 0.0, 1]])
def test_a_lag_that_may_have_changed_is_out_of_step(periods: list[float]):
    assert not all(frame.in_step for frame in counted(periods))
