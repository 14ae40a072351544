"""The section that shows how sure the points are: over the photograph, and of any point at any distance."""

from __future__ import annotations

import math

import numpy as np

from retrue.capture import Capture
from retrue.reconstruction.cloud import Cloud
from retrue.reconstruction.error_by_distance import error_by_distance
from retrue.report.figures import every, numbers, picture_layout, with_color_bar
from retrue.report.lengths import LengthUnit, shown_unit
from retrue.report.page import Block, Chart, Section, Table, Text
from retrue.rig import Rig
from retrue.rig_evidence import unstated
from retrue.shown import figures

MOST_POINTS = 4000  # drawn; more only hide the photograph
PALE = 0.45
COLORS = ((0.0, "#2c7bb6"), (0.33, "#8fd0c5"), (0.6, "#f6e08a"), (0.8, "#ef8a47"), (1.0, "#b2182b"))
SHOWN = (0.01, 0.99)  # quantiles at the ends of the scale


def sigma_section(cloud: Cloud, rig: Rig, capture: Capture) -> Section:
    """A map of sigma over the picture, and a table of what the rig makes of a pixel's noise by distance."""
    unit = shown_unit(cloud.unit)
    blocks: list[Block] = [_map(cloud, rig, capture, unit)]
    if len(capture.points.axes) == 2:
        blocks.append(_table(cloud, rig, unit))
    exact = unstated(rig)
    if exact:
        blocks.append(Text(f"Taken for exact, since the rig's file says nothing of them: {', '.join(exact)}."))
    lead = (
        "One standard deviation along the camera's ray: of each point by itself, and of what all points share because"
        " the rig is not exact. The first averages out over many points, the second never does."
    )
    return Section("How sure each point is", lead, tuple(blocks))


def _map(cloud: Cloud, rig: Rig, capture: Capture, unit: LengthUnit) -> Chart:
    assert cloud.sigma is not None
    known = np.flatnonzero(np.isfinite(cloud.sigma) & (cloud.sigma > 0))
    rows = known[every(len(known), MOST_POINTS)]
    size, (x, y) = unit.factor * cloud.sigma[rows], cloud.camera_px[rows].T
    low, high = np.log10(np.quantile(size, SHOWN)).tolist() if len(size) else (0.0, 1.0)
    trace = {
        "type": "scatter",
        "mode": "markers",
        "x": numbers(x),
        "y": numbers(y),
        "customdata": numbers(size, 3),
        "hovertemplate": "pixel %{x:.1f}, %{y:.1f}<br>sigma %{customdata} " + unit.name + "<extra></extra>",
        "marker": {
            "size": 6 if len(x) < 2500 else 4,
            "color": numbers(np.log10(size), 3),
            "coloraxis": "coloraxis",
            "line": {"width": 0},
        },
    }
    ticks = np.linspace(low, high, 4)
    marks = numbers(ticks), [figures(10**tick, 2) for tick in ticks.tolist()]
    layout = picture_layout(rig.camera.size, capture.photograph, PALE)
    layout = with_color_bar(layout, COLORS, (low, high), marks, f"sigma, {unit.name}")
    width, height = rig.camera.size
    return Chart(
        {"data": [trace], "layout": layout},
        "Photograph with points colored by their own sigma",
        f"{len(x):,} of {len(cloud):,} points. Drag to zoom, double-click to go back.",
        height / width,
        92,
    )


def _length(size: float, unit: LengthUnit) -> str:
    return unit.number(size) if math.isfinite(size) else "not seen"


def _table(cloud: Cloud, rig: Rig, unit: LengthUnit) -> Table:
    assert cloud.uncertainty is not None
    noise = np.hypot(cloud.uncertainty.camera_sigma_px, cloud.uncertainty.projector_sigma_px)
    typical = float(np.nanmedian(noise))
    near, far = (float(np.quantile(cloud.points[:, 2], share)) for share in (0.005, 0.995))
    distances: list[float] = np.geomspace(0.7 * near, 1.4 * far, 7).tolist()
    errors = error_by_distance(rig, distances, max(typical, 1e-6))
    rows = tuple(
        (unit.number(row.distance), *(_length(size, unit) for size in (row.own, row.common, row.along, row.aside)))
        for row in errors
    )
    return Table(
        (f"At, {unit.name}", "own", "shared", "both", "across"),
        rows,
        f"One sigma in {unit.name} of a point anywhere in view, for noise of {figures(typical)} px as in this capture:"
        " along the camera's ray its own, what it shares with all others, and both; across the ray both.",
    )
