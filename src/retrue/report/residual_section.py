"""The section that shows what was decoded, and how well it fits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from retrue.geometry.arrays import FloatArray
from retrue.reconstruction.reconstruct import epipolar_residuals
from retrue.report.page import Chart, Section, Tabs
from retrue.report.residual_charts import arrow_picture, point_picture, residual_histogram
from retrue.report.seen import SeenCapture
from retrue.rig import Rig

MOST_CAPTURES = 6  # drawn; all are counted
COLORS = ("var(--after)", "var(--before)")


def residual_section(rigs: Mapping[str, Rig], captures: Sequence[SeenCapture]) -> Section:
    """Points over the photographs colored by residual, arrows, and how many miss by how much.

    `rigs` by the name of their tab, the one that counts first; the others are drawn of a single capture only.
    """
    total = sum(len(capture.points) for capture in captures)
    if total == 0:
        return Section("What was decoded", "No correspondences.", ())
    values = {name: residuals_of(rig, captures) for name, rig in rigs.items()}
    first = next(iter(rigs))
    panels: list[tuple[str, Chart]] = []
    shown = [capture for capture in captures if len(capture.points)][:MOST_CAPTURES]
    if len(shown) == 1:
        panels += [(name, point_picture(rig, shown[0])) for name, rig in rigs.items()]
        panels.append(("Arrows", arrow_picture(rigs[first], shown[0])))
    else:
        panels += [(capture.name, point_picture(rigs[first], capture)) for capture in shown]
        panels += [(f"Arrows: {capture.name}", arrow_picture(rigs[first], capture)) for capture in shown]
    colored = {name: (values[name], color) for name, color in zip(rigs, COLORS, strict=False)}
    names = captures[0].name if len(captures) == 1 else f"{len(captures)} captures"
    return Section(
        "What was decoded",
        f"{total:,} correspondences in {names}. The two rays of a point should meet; its residual is by how many pixels"
        " they miss.",
        (Tabs(tuple(panels)), residual_histogram(colored)),
    )


def residuals_of(rig: Rig, captures: Sequence[SeenCapture]) -> FloatArray:
    """Of all points of all captures, in pixels."""
    return np.concatenate([epipolar_residuals(rig, capture.points) for capture in captures])


def median_residual(rig: Rig, captures: Sequence[SeenCapture]) -> float:
    """The median of their sizes; NaN of nothing."""
    residuals = residuals_of(rig, captures)
    size = np.abs(residuals[np.isfinite(residuals)])
    return float(np.median(size)) if len(size) else float("nan")
