"""The section that shows what was decoded, and how well it fits.

How far the two rays of each point miss each other: over the photograph, as arrows, and counted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from retrue.capture import Capture
from retrue.geometry.arrays import FloatArray, IntArray
from retrue.geometry.transform import skew
from retrue.reconstruction.reconstruct import epipolar_residuals
from retrue.report.figures import every, numbers, picture_layout, polyline, with_color_bar
from retrue.report.page import Chart, Section, Tabs
from retrue.rig import Rig
from retrue.shown import figures

MOST_CAPTURES = 6  # drawn; all are counted
COLORS = ("var(--after)", "var(--before)")
MOST_OVER_PHOTOGRAPH = 4000  # drawn in a picture; more only hide it
MOST_ARROWS = 500
PALE = 0.45  # opacity of a photograph behind points: its own colors must not be taken for theirs
ARROW_SHARE = 0.02  # of the picture's width: how long a typical residual is drawn
LONGEST_ARROW = 0.2  # of the picture's width
BINS = 48
SMALLEST_PX = 1e-4
COLOR_LIMITS_PX = (0.01, 10.0)  # the same on every page, so that a color means the same everywhere
RESIDUAL_COLORS = ((0.0, "#2166ac"), (0.33, "#67b7d1"), (0.55, "#f6e08a"), (0.72, "#ef8a47"), (1.0, "#b2182b"))


def residual_section(rigs: Mapping[str, Rig], captures: Sequence[Capture]) -> Section:
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


def residuals_of(rig: Rig, captures: Sequence[Capture]) -> FloatArray:
    """Of all points of all captures, in pixels."""
    return np.concatenate([epipolar_residuals(rig, capture.points) for capture in captures])


def median_residual(rig: Rig, captures: Sequence[Capture]) -> float:
    """The median of their sizes; NaN of nothing."""
    residuals = residuals_of(rig, captures)
    size = np.abs(residuals[np.isfinite(residuals)])
    return float(np.median(size)) if len(size) else float("nan")


def point_picture(rig: Rig, capture: Capture) -> Chart:
    """The photograph with every decoded point (thinned), colored by its residual; one scale for all pages."""
    residual = np.abs(epipolar_residuals(rig, capture.points))
    rows = every(len(residual), MOST_OVER_PHOTOGRAPH)
    x, y = capture.points.camera_px[rows].T
    low, high = (math.log10(limit) for limit in COLOR_LIMITS_PX)
    ticks = _decades(*COLOR_LIMITS_PX)
    shown = f"{len(x):,} of {len(residual):,}" if len(x) < len(residual) else f"{len(residual):,}"
    trace = {
        "type": "scatter",
        "mode": "markers",
        "x": numbers(x),
        "y": numbers(y),
        "customdata": numbers(residual[rows], 3),
        "hovertemplate": "pixel %{x:.1f}, %{y:.1f}<br>residual %{customdata} px<extra></extra>",
        "marker": {
            "size": 6 if len(x) < 2500 else 4,
            "color": numbers(np.log10(np.maximum(residual[rows], SMALLEST_PX)), 3),
            "coloraxis": "coloraxis",
            "line": {"width": 0},
        },
    }
    layout = picture_layout(rig.camera.size, capture.photograph, PALE)
    marks = numbers(np.log10(ticks)), [f"{tick:g}" for tick in ticks]
    layout = with_color_bar(layout, RESIDUAL_COLORS, (low, high), marks, "residual, px")
    return Chart(
        {"data": [trace], "layout": layout},
        f"Photograph with {shown} decoded points colored by residual",
        f"{shown} decoded points. Drag to zoom, double-click to go back.",
        _aspect(rig),
        92,
    )


def arrow_picture(rig: Rig, capture: Capture) -> Chart:
    """The residuals as arrows across the epipolar lines, lengthened by a round factor that is said."""
    residual = epipolar_residuals(rig, capture.points)
    finite = np.flatnonzero(np.isfinite(residual))
    rows = finite[every(len(finite), MOST_ARROWS)]
    factor = round_factor(np.abs(residual[finite]), ARROW_SHARE * rig.camera.size[0])
    rows = rows[factor * np.abs(residual[rows]) < LONGEST_ARROW * rig.camera.size[0]]
    start = capture.points.camera_px[rows]
    across = _across(rig, capture, rows) * residual[rows, None]
    line = polyline(np.stack([start, start + factor * across], axis=1))
    trace = {
        "type": "scatter",
        "mode": "lines+markers",
        "x": numbers(line[:, 0]),
        "y": numbers(line[:, 1]),
        "hoverinfo": "skip",
        "line": {"color": "var(--mark)", "width": 1.5},
        "marker": {
            "symbol": "arrow",
            "angleref": "previous",
            "size": [0, 6, 0] * len(rows),
            "color": "var(--mark)",
            "line": {"width": 0},
        },
    }
    return Chart(
        {"data": [trace], "layout": picture_layout(rig.camera.size, capture.photograph, PALE)},
        "Residuals as arrows over the photograph",
        f"Arrows are {figures(factor)} times as long as the residuals, and point across the epipolar lines"
        " (strays beyond a fifth of the width are left out). Chance points everywhere; neighbours that agree point at"
        " the lens model or at something that moved.",
        _aspect(rig),
        36,
    )


def residual_histogram(residuals: Mapping[str, tuple[FloatArray, str]]) -> Chart:
    """How many points miss by how much, on a scale of powers of ten; of each (name: (residuals, color))."""
    low, high = _limits([values for values, _ in residuals.values()])
    edges, ticks = np.geomspace(low, high, BINS + 1), _decades(low, high)
    middles = np.sqrt(edges[1:] * edges[:-1])
    traces: list[dict[str, Any]] = []
    for name, (values, color) in residuals.items():
        size = np.clip(np.abs(values[np.isfinite(values)]), low, high)
        traces.append(
            {
                "type": "bar",
                "name": name,
                "x": numbers(np.log10(middles)),
                "y": np.histogram(size, edges)[0].tolist(),
                "customdata": numbers(middles, 2),
                "marker": {"color": color, "line": {"width": 0}},
                "opacity": 0.85,
                "hovertemplate": "%{y} points near %{customdata} px<extra>" + name + "</extra>",
            }
        )
    layout = {
        "barmode": "overlay",
        "bargap": 0,
        "dragmode": False,
        "showlegend": True,
        "xaxis": {
            "title": {"text": "distance of the two rays, px"},
            "tickvals": numbers(np.log10(ticks)),
            "ticktext": [f"{tick:g}" for tick in ticks],
            "showgrid": False,
        },
        "yaxis": {"title": {"text": "points"}},
    }
    medians = ", ".join(
        f"{name.lower()} {figures(float(np.nanmedian(np.abs(values))))} px" for name, (values, _) in residuals.items()
    )
    return Chart(
        {"data": traces, "layout": layout},
        "Histogram of residuals",
        f"All points are counted, those beyond the ends at the ends. Median: {medians}.",
        0.2,
        110,
    )


def _limits(residuals: list[FloatArray]) -> tuple[float, float]:
    """A scale that holds nearly all of them, at least a decade long."""
    sizes = [np.abs(values[np.isfinite(values)]) for values in residuals]
    sizes = [size for size in sizes if len(size)]
    if not sizes:
        return 0.01, 1.0
    low = max(min(float(np.quantile(size, 0.01)) for size in sizes), SMALLEST_PX)
    return low, max(max(float(np.quantile(size, 0.995)) for size in sizes), 10 * low)


def _across(rig: Rig, capture: Capture, rows: IntArray) -> FloatArray:
    """Unit vectors (N, 2) in the camera's picture across each point's epipolar line, towards that line."""
    pose = rig.projector_from_camera
    E = skew(pose.t) @ pose.R
    projector_rays = rig.projector.unproject(capture.points.projector_px[rows])
    normal = projector_rays @ E[:2, :2] + E[2, :2]
    jacobian = rig.camera.ray_jacobian(rig.camera.unproject(capture.points.camera_px[rows]))
    moved = -np.einsum("nij,nj->ni", jacobian, normal)
    return moved / np.linalg.norm(moved, axis=1, keepdims=True)


def round_factor(size: FloatArray, length: float) -> float:
    """1, 2 or 5 times a power of ten, so that a typical residual becomes about as long as `length`."""
    typical = float(np.median(size)) if len(size) else 1.0
    wanted = length / max(typical, SMALLEST_PX)
    decade = 10.0 ** math.floor(math.log10(wanted))
    return max(step * decade for step in (1, 2, 5) if step * decade <= wanted)


def _decades(low: float, high: float) -> list[float]:
    return [10.0**power for power in range(math.ceil(math.log10(low)), math.floor(math.log10(high)) + 1)]


def _aspect(rig: Rig) -> float:
    width, height = rig.camera.size
    return height / width
