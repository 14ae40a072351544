"""What the studio draws over its live picture and beside it, as SVG; and its clouds in space."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from datetime import datetime
from html import escape

import numpy as np

from retrue.geometry.arrays import FloatArray
from retrue.reconstruction.cloud import Cloud
from retrue.report.space import Layer, rig_lines, space_page
from retrue.shown import figures
from retrue.studio.calibrating import Progress
from retrue.studio.drift_log import Reading
from retrue.studio.guide import CELLS
from retrue.studio.look import Look
from retrue.studio.state import Offer

MOST_DOTS = 600
MOST_POINTS = 300_000  # of a scan, as it is shown at once; the file holds all
SEEN, WISHED = "#00e5ff", "#ffb300"
COLORS = {"good": "#21a366", "drifted": "#e5484d", "unknown": "#8b8d98"}
PLOT = 320, 120  # units of the drift's drawing
LEFT, BELOW = 54, 16  # of it, for the words at its axes


def dots(look: Look) -> str:
    """A ring round the points that the decoder found, some of them where they are many."""
    points = look.points.camera_px
    step = max(1, -(-len(points) // MOST_DOTS))
    radius = max(look.picture.shape[1] / 320, 1.5)
    circles = "".join(f'<circle cx="{x + 0.5:.1f}" cy="{y + 0.5:.1f}" r="{radius:.1f}"/>' for x, y in points[::step])
    return f'<g fill="none" stroke="{SEEN}" stroke-width="{radius / 2:.1f}">{circles}</g>'


def outlines(progress: Progress, width: int) -> str:
    """The board as it is held, and dashed, as it should be."""
    thick = max(width / 250, 2.0)
    dashes = f'stroke-dasharray="{4 * thick:.0f} {2 * thick:.0f}"'
    wished = "" if progress.wish is None else _polygon(progress.wish, WISHED, f'class="wish" {dashes}')
    held = "" if progress.outline is None else _polygon(progress.outline, SEEN, 'class="board"')
    return f'<g fill="none" stroke-width="{thick:.1f}">{wished}{held}</g>'


def _polygon(corners: FloatArray, color: str, more: str) -> str:
    points = " ".join(f"{x + 0.5:.1f},{y + 0.5:.1f}" for x, y in corners)
    return f'<polygon points="{points}" stroke="{color}" {more}/>'


def raster(name: str, cells: Collection[int]) -> str:
    """Where the board was in a device's picture."""
    columns, rows = CELLS
    share = round(100 * len(cells) / (columns * rows))
    squares = "".join(
        f'<rect x="{cell % columns + 0.06:.2f}" y="{cell // columns + 0.06:.2f}" width=".88" height=".88" '
        f'fill="{COLORS["good"]}" fill-opacity="{1 if cell in cells else 0.15}"/>'
        for cell in range(columns * rows)
    )
    words = f"{name}: the board was in {share} % of its picture"
    return f'<svg viewBox="0 0 {columns} {rows}" role="img" aria-label="{words}" style="width:100%">{squares}</svg>'


def drift_plot(readings: Sequence[Reading], unit: str) -> str:
    """Drift over time with its sigma; a reading that did not tell is a mark at the foot."""
    width, height = PLOT
    told = [(reading.at, reading.drift, reading.sigma or 0.0) for reading in readings if reading.drift is not None]
    start = readings[0].at if readings else 0.0
    span = max(readings[-1].at - start, 1.0) if readings else 1.0
    top = 1.1 * max((drift + sigma for _, drift, sigma in told), default=1.0) or 1.0

    def x(at: float) -> float:
        return LEFT + (width - LEFT - 6) * (at - start) / span

    def y(drift: float) -> float:
        return height - BELOW - (height - BELOW - 8) * min(max(drift / top, 0.0), 1.0)

    band = [(x(at), y(drift + sigma)) for at, drift, sigma in told]
    band += [(x(at), y(drift - sigma)) for at, drift, sigma in reversed(told)]
    marks = "".join(
        f'<circle cx="{x(reading.at):.1f}" cy="{y(reading.drift or 0.0):.1f}" r="2.2" '
        f'fill="{COLORS[reading.verdict]}"/>'
        for reading in readings
    )
    line = " ".join(f"{x(at):.1f},{y(drift):.1f}" for at, drift, _ in told)
    hull = " ".join(f"{a:.1f},{b:.1f}" for a, b in band)
    words = (
        f'<text x="{LEFT - 4}" y="{y(0):.0f}" text-anchor="end">0</text>'
        f'<text x="{LEFT - 4}" y="{y(top) + 8:.0f}" text-anchor="end">{figures(top)} {escape(unit)}</text>'
    )
    if readings:
        first, last = (datetime.fromtimestamp(moment.at) for moment in (readings[0], readings[-1]))
        words += (
            f'<text x="{LEFT}" y="{height - 2}">{first:%d %b %H:%M:%S}</text>'
            f'<text x="{width - 6}" y="{height - 2}" text-anchor="end">{last:%d %b %H:%M:%S}</text>'
        )
    return (
        f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="drift over time, {len(readings)} readings" '
        f'style="width:100%" font-size="9" fill="currentColor">'
        f'<path d="M{LEFT} 4V{y(0):.1f}H{width - 6}" fill="none" stroke="currentColor" stroke-opacity=".4"/>'
        f'<polygon points="{hull}" fill="{SEEN}" fill-opacity=".18"/>'
        f'<polyline points="{line}" fill="none" stroke="currentColor" stroke-width="1"/>{marks}{words}</svg>'
    )


def in_space(offer: Offer | None, cloud: Cloud | None) -> str:
    """A page: the last scan, or while a rig is offered, the capture with the old rig and with the new, by a slider."""
    layers = [Layer("scan", cloud)] if cloud is not None else []
    if offer is not None:
        layers = [Layer("before", offer.before, when="before"), Layer("after", offer.after, when="after")]
    if not any(len(layer.model.points) for layer in layers):
        return ""
    points: FloatArray = np.concatenate([layer.model.points for layer in layers])
    lines = rig_lines(offer.result.rig, float(np.median(points[:, 2]))) if offer is not None else ()
    return space_page(layers, lines, "scan", most=MOST_POINTS, heading=False)
