"""How a rig moved over time, as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Any

from retrue.report.pictures import blank_figure, png_bytes
from retrue.rig_difference import RigDifference


def drift_picture(times: Sequence[datetime], since_first: Sequence[RigDifference]) -> bytes:
    """Rotation and direction of t away from the first rig, each held until the next one took its place."""
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

    figure = blank_figure(8.0, 4.0)
    axis: Any = figure.subplots()
    for label, values in (
        ("rotation", [difference.rotation_deg for difference in since_first]),
        ("direction of t", [difference.translation_deg for difference in since_first]),
    ):
        axis.step(times, values, where="post", marker="o", label=label)
    locator = AutoDateLocator()
    axis.xaxis.set_major_locator(locator)
    axis.xaxis.set_major_formatter(ConciseDateFormatter(locator))
    axis.set_xlabel("time, UTC")
    axis.set_ylabel("drift since the first entry, deg")
    axis.set_ylim(bottom=0)
    axis.grid(alpha=0.3)
    axis.legend()
    return png_bytes(figure)
