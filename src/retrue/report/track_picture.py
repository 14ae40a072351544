"""Where a watched rig was over time, axis by axis, and how warm it was, as a PNG; needs the extra `.[plot]`."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Any, Protocol

import numpy as np

from retrue.geometry.arrays import FloatArray
from retrue.recalibration.axes import NAMES
from retrue.report.pictures import blank_figure, png_bytes

MOST_FRAMES = 5000  # drawn; more only blacken the picture
ROTATIONS = 3  # of the axes; the others are of the direction of t


class RecordLike(Protocol):
    """What `watch.record` reads: N frames on five axes, degrees."""

    @property
    def times(self) -> Sequence[datetime]: ...
    @property
    def frames_deg(self) -> FloatArray: ...
    @property
    def track_deg(self) -> FloatArray: ...
    @property
    def sigma_deg(self) -> FloatArray: ...
    @property
    def bumps(self) -> Sequence[int]: ...
    @property
    def changes(self) -> Sequence[tuple[datetime, str]]: ...
    @property
    def temperatures(self) -> FloatArray: ...


def track_picture(record: RecordLike) -> bytes:
    """Frames as dots, the track as a line with its sigma; red where the rig was bumped, dashed where a new rig stands.

    Below them the temperature, where there is one.
    """
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

    warm = bool(np.isfinite(record.temperatures).any())
    heights = [3, 3, 1.6][: 2 + warm]
    figure = blank_figure(9.0, 1.3 * sum(heights) + 0.6)
    axes: Any = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights)
    rows = slice(None, None, max(1, -(-len(record.times) // MOST_FRAMES)))
    times = record.times[rows]
    for axis, columns, label in (
        (axes[0], range(ROTATIONS), "rotation, deg"),
        (axes[1], range(ROTATIONS, len(NAMES)), "direction of t, deg"),
    ):
        for column in columns:
            track, sigma = record.track_deg[rows, column], record.sigma_deg[rows, column]
            name = NAMES[column].removeprefix("rotation ").removeprefix("direction of t ")
            (line,) = axis.plot(times, track, linewidth=1.2, label=name)
            axis.plot(times, record.frames_deg[rows, column], ".", markersize=2, alpha=0.4, color=line.get_color())
            axis.fill_between(times, track - sigma, track + sigma, alpha=0.25, linewidth=0, color=line.get_color())
        axis.set_ylabel(label)
        axis.legend(fontsize=8, loc="upper left")
    if warm:
        axes[2].plot(times, record.temperatures[rows], color="C3", linewidth=1.2)
        axes[2].set_ylabel("temperature")
    for axis in axes:
        for first in record.bumps:
            axis.axvline(record.times[first], color="C3", linewidth=0.8)
        for time, _ in record.changes:
            axis.axvline(time, color="0.5", linewidth=0.8, linestyle="--")
        axis.grid(alpha=0.3)
    locator = AutoDateLocator()
    axes[-1].xaxis.set_major_locator(locator)
    axes[-1].xaxis.set_major_formatter(ConciseDateFormatter(locator))
    axes[-1].set_xlabel("time, UTC")
    return png_bytes(figure)
