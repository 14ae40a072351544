"""The section that shows the projector's light: as it was measured, and as each candidate predicts it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from retrue.capture import Capture
from retrue.geometry.arrays import FloatArray
from retrue.recalibration.predicted_light import in_the_cameras_curve, measured_light, predicted_light
from retrue.recalibration.result import Evidence
from retrue.report.evidence_tables import candidate_name
from retrue.report.figures import every, numbers, picture_layout, with_color_bar
from retrue.report.page import Chart, Section, Tabs
from retrue.rig import Rig
from retrue.shown import figures

FEWEST_POINTS = 30
MOST_POINTS = 4000
MOST_RIVALS = 2  # the strongest ones are what matters
SPREADS = (0.3, 1.5)  # of log light, least and most, to either side of the colors
TICKS = (0.25, 0.35, 0.5, 0.7, 0.8, 0.9, 1.0, 1.1, 1.25, 1.4, 2.0, 2.8, 4.0)
COLORS = ((0.0, "#10243f"), (0.5, "#4f8fbf"), (1.0, "#fdf3c4"))


def light_section(rig: Rig, captures: Sequence[Capture], evidence: Evidence) -> Section | None:
    """Of the capture with most light on planes; None where there is no rival, or too little light to compare.

    `rig` has the lenses; the candidates have the poses.
    """
    if len(evidence.candidates) < 2:
        return None
    lit = [_lit(rig, capture, evidence) for capture in captures]
    capture, measured = max(zip(captures, lit, strict=True), key=lambda one: int(np.isfinite(one[1]).sum()))
    rows = np.flatnonzero(np.isfinite(measured))
    if len(rows) < FEWEST_POINTS:
        return None
    rows = rows[every(len(rows), MOST_POINTS)]
    points = capture.points.select(rows)
    measured = measured[rows]
    spread = float(np.clip(2 * np.quantile(np.abs(measured), 0.95), *SPREADS))
    panels = [("Measured", _picture(rig, capture, points.camera_px, measured, spread, "as it was measured"))]
    misses: list[str] = []
    order = sorted(range(len(evidence.candidates)), key=lambda index: not evidence.candidates[index].chosen)
    for index in order[: 1 + MOST_RIVALS]:
        name = candidate_name(evidence.candidates, index)
        predicted = predicted_light(rig, evidence.candidates[index], points)
        if not np.isfinite(predicted).any():
            continue
        expected = in_the_cameras_curve(measured, predicted)
        what = f"as {name.lower()} predicts it"
        panels.append((name, _picture(rig, capture, points.camera_px, expected, spread, what)))
        misses.append(f"{name.lower()} {figures(float(np.nanmedian(np.abs(measured - expected))), 2)}")
    return Section(
        "In the projector's light",
        "Each projector pixel sends equal light, so how bright a plane is tells how it is turned to the projector. By"
        f" how much the prediction misses, median of log light: {', '.join(misses)}.",
        (Tabs(tuple(panels)),),
    )


def _lit(rig: Rig, capture: Capture, evidence: Evidence) -> FloatArray:
    """(N,) measured light of the points that the chosen candidate has on a plane, else NaN."""
    if capture.points.light is None:
        return np.full(len(capture.points), np.nan)
    chosen = next((one for one in evidence.candidates if one.chosen), evidence.candidates[0])
    on_plane = np.isfinite(predicted_light(rig, chosen, capture.points))
    return np.where(on_plane, measured_light(capture.points), np.nan)


def _picture(
    rig: Rig, capture: Capture, camera_px: FloatArray, log_light: FloatArray, spread: float, what: str
) -> Chart:
    """The points over the photograph's frame, colored by brightness; one scale for all tabs."""
    known = np.isfinite(log_light)
    trace = {
        "type": "scatter",
        "mode": "markers",
        "x": numbers(camera_px[known, 0]),
        "y": numbers(camera_px[known, 1]),
        "customdata": numbers(np.exp(log_light[known]), 3),
        "hovertemplate": "pixel %{x:.0f}, %{y:.0f}<br>%{customdata} times the usual<extra></extra>",
        "marker": {"size": 6, "color": numbers(log_light[known], 3), "coloraxis": "coloraxis", "line": {"width": 0}},
    }
    ticks = [tick for tick in TICKS if abs(math.log(tick)) <= spread]
    marks = numbers(np.log(ticks)), [f"{tick:g}" for tick in ticks]
    title = "brightness, times the usual of its colour"
    layout = with_color_bar(picture_layout(rig.camera.size, None), COLORS, (-spread, spread), marks, title)
    unlit = int(np.count_nonzero(~known))
    note = f" {unlit:,} points lie where it has no plane that the projector lights." if unlit else ""
    width, height = rig.camera.size
    return Chart(
        {"data": [trace], "layout": layout},
        f"The projector's light in {capture.name} {what}",
        f"The projector's light {what}, in {capture.name}.{note}",
        height / width,
        92,
    )
