"""Drawings of a calibration: where the board was, what of both pictures it covered, and how well each pose fits."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePath
from typing import Any

import numpy as np

from retrue.calibration.result import FittedView
from retrue.geometry.arrays import FloatArray
from retrue.report.figures import harmless, numbers, picture_layout, polyline
from retrue.report.page import Block, Chart
from retrue.report.residual_section import round_factor
from retrue.report.scene import board_scene
from retrue.report.space import Vector
from retrue.rig import Rig
from retrue.shown import figures

CORNER_ARROW_SHARE = 0.015  # of the picture's width: how long a typical residual is drawn
VIEW_COLORS = ("#4c94e0", "#df8440", "#3aa876", "#b96bd0", "#cf9d1c", "#dc625c", "#4bafbd", "#8f84e8")


def boards_in_space(views: Sequence[FittedView], rig: Rig | None) -> Block:
    """Every pose of the board before the devices, in the colours of the charts."""
    boards = [
        (name, _outline(view), _red_green_blue(view_color(index)))
        for index, (view, name) in enumerate(zip(views, view_names(views), strict=True))
    ]
    return board_scene(boards, rig)


def coverage_chart(views: Sequence[FittedView], device: int, size: tuple[int, int], name: str) -> Chart:
    """The corners in the picture of one device, colored by view, with lengthened residuals."""
    errors = np.concatenate([view.errors[device] for view in views])
    factor = round_factor(np.linalg.norm(errors, axis=1), CORNER_ARROW_SHARE * size[0])
    traces: list[dict[str, Any]] = []
    for index, (view, label) in enumerate(zip(views, view_names(views), strict=True)):
        start, error = view.pixels[device], view.errors[device]
        line = polyline(np.stack([start, start + factor * error], axis=1))
        traces.append(
            {
                "type": "scatter",
                "mode": "lines+markers",
                "name": harmless(label),
                "x": numbers(line[:, 0]),
                "y": numbers(line[:, 1]),
                "customdata": numbers(np.repeat(np.linalg.norm(error, axis=1), 3), 3),
                "hovertemplate": "misses by %{customdata} px<extra>" + harmless(label) + "</extra>",
                "line": {"color": view_color(index), "width": 1},
                "marker": {"color": view_color(index), "size": [5, 0, 0] * len(start), "line": {"width": 0}},
            }
        )
    layout = picture_layout(size, None)
    layout["showlegend"] = len(views) <= len(VIEW_COLORS)
    return Chart(
        {"data": traces, "layout": layout},
        f"Corners of the board in the {name}'s picture",
        f"Where the {name} has seen the board. Lines are residuals, {figures(factor)} times as long as they are.",
        size[1] / size[0],
        64,
    )


def residuals_per_view(views: Sequence[FittedView], devices: Sequence[str]) -> Chart:
    """RMS of each pose in each device."""
    names = [harmless(name) for name in view_names(views)]
    traces = [
        {
            "type": "bar",
            "name": name,
            "x": names,
            "y": numbers([float(np.sqrt((view.errors[device] ** 2).sum(axis=1).mean())) for view in views], 3),
            "marker": {"color": color, "line": {"width": 0}},
            "hovertemplate": "%{y} px<extra>%{x}</extra>",
        }
        for device, (name, color) in enumerate(zip(devices, ("var(--camera)", "var(--after)"), strict=True))
    ]
    layout = {
        "barmode": "group",
        "bargap": 0.5,
        "dragmode": False,
        "showlegend": True,
        "xaxis": {"type": "category"},
        "yaxis": {"title": {"text": "RMS of the corners, px"}, "rangemode": "tozero"},
    }
    return Chart(
        {"data": traces, "layout": layout},
        "Residuals of each pose",
        "One pose that stands out was moved during its capture, or bent.",
        0.2,
        110,
    )


def view_names(views: Sequence[FittedView]) -> list[str]:
    """The last part of each path, where these differ; else all of it."""
    short = [PurePath(view.name).name for view in views]
    return short if len(set(short)) == len(short) else [view.name for view in views]


def view_color(index: int) -> str:
    """Each pose has its own, as far as they reach."""
    return VIEW_COLORS[index % len(VIEW_COLORS)]


def _red_green_blue(color: str) -> Vector:
    red, green, blue = bytes.fromhex(color.removeprefix("#"))
    return red / 255, green / 255, blue / 255


def _outline(view: FittedView) -> FloatArray:
    """(4, 3) the rectangle that holds the corners, in the camera frame."""
    (x0, y0), (x1, y1) = view.board_xy.min(axis=0), view.board_xy.max(axis=0)
    return view.camera_from_board.apply([[x0, y0, 0.0], [x1, y0, 0.0], [x1, y1, 0.0], [x0, y1, 0.0]])
