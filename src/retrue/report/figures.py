"""What all drawings are made of: numbers that JSON can hold, pictures inside the page, words that nobody can abuse."""

from __future__ import annotations

import base64
import html
import io
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from retrue.geometry.arrays import FloatArray, Image

WIDEST_PICTURE = 1024  # pixels; a page shows no more
QUALITY = 82  # of its JPEG


def numbers(values: ArrayLike, digits: int = 5) -> list[float | None]:
    """(N,) rounded to so many significant digits, null where there is none.

    >>> numbers([1234.5678, 0.000123456, np.nan])
    [1234.6, 0.00012346, None]
    """
    return [float(f"{value:.{digits}g}") if np.isfinite(value) else None for value in np.asarray(values).tolist()]


def polyline(pieces: FloatArray) -> FloatArray:
    """Lines (N, points, D) as one (N (points + 1), D) with a NaN after each, where the pen is lifted."""
    gaps = np.full((len(pieces), 1, pieces.shape[2]), np.nan)
    return np.concatenate([pieces, gaps], axis=1).reshape(-1, pieces.shape[2])


def harmless(text: str) -> str:
    """Text for a drawing, which would take some tags for its own."""
    return html.escape(text, quote=False)


def every(count: int, most: int) -> slice:
    """So many rows, evenly spread, that no more than `most` remain."""
    return slice(None, None, max(1, -(-count // most)))


def embedded_picture(image: Image) -> str:
    """A photograph as a data URI: JPEG, no wider than a screen, 16 bits cut to 8."""
    from PIL import Image as Pictures

    eight = image if image.dtype == np.uint8 else (image >> 8).astype(np.uint8)
    picture = Pictures.fromarray(np.ascontiguousarray(eight[..., :3] if eight.ndim == 3 else eight))
    picture.thumbnail((WIDEST_PICTURE, WIDEST_PICTURE))
    stream = io.BytesIO()
    picture.save(stream, "JPEG", quality=QUALITY)
    return "data:image/jpeg;base64," + base64.b64encode(stream.getvalue()).decode()


def picture_layout(size: tuple[int, int], image: Image | None, opacity: float = 1.0) -> dict[str, Any]:
    """Axes in the pixels of a device, y downwards, the photograph behind them."""
    width, height = size
    axis = {"showgrid": False, "zeroline": False, "ticks": "", "constrain": "domain"}
    layout: dict[str, Any] = {
        "xaxis": {**axis, "range": [-0.5, width - 0.5]},
        "yaxis": {**axis, "range": [height - 0.5, -0.5], "scaleanchor": "x"},
        "margin": {"l": 40, "r": 8, "t": 8, "b": 28},
        "showlegend": False,
        "hovermode": "closest",
        "dragmode": "zoom",
        "shapes": [
            {"type": "rect", "x0": -0.5, "x1": width - 0.5, "y0": -0.5, "y1": height - 0.5}
            | {"line": {"color": "var(--line)", "width": 1}, "layer": "below"}
        ],
    }
    if image is not None:
        layout["images"] = [
            {"source": embedded_picture(image), "xref": "x", "yref": "y", "x": -0.5, "y": -0.5, "layer": "below"}
            | {"sizex": width, "sizey": height, "sizing": "stretch", "opacity": opacity}
        ]
    return layout


def with_color_bar(
    layout: dict[str, Any],
    colors: object,
    limits: tuple[float, float],
    ticks: tuple[list[float | None], list[str]],
    title: str,
) -> dict[str, Any]:
    """The layout with a scale of colors from limit to limit below it, and room for that; ticks at values, as texts."""
    low, high = limits
    values, texts = ticks
    bar = {"orientation": "h", "thickness": 8, "len": 0.6, "y": -0.05, "yanchor": "top"}
    bar |= {"tickvals": values, "ticktext": texts, "title": {"text": title, "side": "top"}}
    axis = {"colorscale": colors, "cmin": low, "cmax": high, "colorbar": bar}
    return {**layout, "coloraxis": axis, "margin": {**layout["margin"], "b": 84}}
