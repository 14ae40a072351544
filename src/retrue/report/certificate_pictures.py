"""What a certificate shows: residuals in the photograph, how they spread, and where the artefact stood."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from retrue.acceptance.accept import Position
from retrue.geometry.arrays import FloatArray, Image
from retrue.shown import figures

if TYPE_CHECKING:
    from PIL.Image import Image as PilImage

SIDE = 620  # pixels of the longer side of a picture
MARGIN = 0.18  # of the artefact's size, about it
BLUE, WHITE, RED = (np.array(color, dtype=np.float64) for color in ((33, 90, 180), (245, 245, 245), (190, 38, 38)))
BARS = 31
INK, FAINT, BAR = "#1c2733", "#5b6b7a", "#7f9bb3"
POINT = 2.8346  # points of print a millimetre
DOT = 2.6  # points of print, radius of a position


def part(name: str) -> Any:
    """A part of reportlab by its name in there; untyped, for what types it has contradict its manual."""
    from importlib import import_module

    module, _, member = name.rpartition(".")
    return getattr(import_module(f"reportlab.{module}"), member)


def residual_picture(position: Position, photograph: Image | None) -> tuple[PilImage, float]:
    """The photograph about the artefact, its points coloured by distance; and what the full colours stand for."""
    from PIL import Image as Pil
    from PIL import ImageDraw

    low, high = position.camera_px.min(axis=0), position.camera_px.max(axis=0)
    rim = MARGIN * float((high - low).max()) + 4
    low, high = low - rim, high + rim
    enlarged = SIDE / float((high - low).max())
    size = tuple(np.maximum((high - low) * enlarged, 1).round().astype(int).tolist())
    canvas = Pil.new("RGB", size, (214, 220, 226))
    if photograph is not None:
        grey = photograph.mean(axis=2) if photograph.ndim == 3 else photograph.astype(np.float64)
        scaled = (grey / max(float(np.quantile(grey, 0.995)), 1.0) * 200).clip(0, 235).astype(np.uint8)
        box = tuple((np.concatenate([low, high]) + 0.5).tolist())
        canvas = (
            Pil.fromarray(scaled).transform(size, Pil.Transform.EXTENT, box, Pil.Resampling.BILINEAR).convert("RGB")
        )
    scale = float(np.quantile(np.abs(position.residuals), 0.99)) or 1.0
    draw = ImageDraw.Draw(canvas)
    spacing = float(np.sqrt(float((high - low - 2 * rim).prod()) / len(position.residuals))) * enlarged
    radius = float(np.clip(0.42 * spacing, 1.2, 6.0))
    for (x, y), color in zip((position.camera_px - low) * enlarged, _colors(position.residuals / scale), strict=True):
        draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=tuple(color.tolist()))
    return canvas, scale


def histogram(position: Position, unit: str) -> Any:
    """How the distances spread, over the same range as they have."""
    Drawing: Any = part("graphics.shapes.Drawing")
    Line: Any = part("graphics.shapes.Line")
    Rect: Any = part("graphics.shapes.Rect")
    String: Any = part("graphics.shapes.String")
    HexColor: Any = part("lib.colors.HexColor")

    width, height, foot = 78 * POINT, 50 * POINT, 26.0
    low, high = float(position.residuals.min()), float(position.residuals.max())
    high = high if high > low else low + 1.0
    counts, _ = np.histogram(position.residuals, BARS, (low, high))
    drawing = Drawing(width, height)
    step = width / BARS
    for number, count in enumerate(counts.tolist()):
        tall = (height - foot - 6) * count / max(int(counts.max()), 1)
        drawing.add(Rect(number * step + 0.4, foot, step - 0.8, tall, fillColor=HexColor(BAR), strokeColor=None))
    drawing.add(Line(0, foot, width, foot, strokeColor=HexColor(INK), strokeWidth=0.6))
    for share, anchor in ((0.0, "start"), (0.5, "middle"), (1.0, "end")):
        text = figures(low + share * (high - low)) if share != 0.5 else f"distance in {unit}"
        label = String(share * width, foot - 11, text, fontName="Helvetica", fontSize=7.5, textAnchor=anchor)
        label.fillColor = HexColor(FAINT)
        drawing.add(label)
    return drawing


def volume_plan(positions: Sequence[Position], unit: str) -> Any:
    """From above and from the side: a dot and a number for each position, and how far the camera is to the left."""
    Circle: Any = part("graphics.shapes.Circle")
    Drawing: Any = part("graphics.shapes.Drawing")
    Line: Any = part("graphics.shapes.Line")
    Polygon: Any = part("graphics.shapes.Polygon")
    Rect: Any = part("graphics.shapes.Rect")
    String: Any = part("graphics.shapes.String")
    HexColor: Any = part("lib.colors.HexColor")

    width, height, gap, foot, camera = 166 * POINT, 46 * POINT, 10 * POINT, 16.0, 20.0
    each = (width - gap) / 2
    drawing = Drawing(width, height)
    centres = np.array([position.centre for position in positions])
    low, high = centres.min(axis=0), centres.max(axis=0)
    extent = np.maximum(high - low, 0.02 * float(high[2]))
    room = np.array([height - foot, height - foot, each - camera]) - 10 * DOT
    scale = float((room / extent).min())

    def text(x: float, y: float, words: str, color: str = FAINT, anchor: str = "start") -> None:
        label: Any = String(x, y, words, fontName="Helvetica", fontSize=7.5, textAnchor=anchor)
        label.fillColor = HexColor(color)
        drawing.add(label)

    for view, (axis, name) in enumerate(((0, "from above"), (1, "from the side"))):
        left, middle = view * (each + gap), (height + foot) / 2
        frame = (left + camera, foot, each - camera, height - foot)
        drawing.add(Rect(*frame, fillColor=None, strokeColor=HexColor("#d5dde4"), strokeWidth=0.5))
        eye = [left, middle - 5, left, middle + 5, left + 8, middle]
        drawing.add(Polygon(eye, fillColor=HexColor(INK), strokeColor=None))
        drawing.add(Line(left + 8, middle, left + camera, middle, strokeColor=HexColor(FAINT), strokeDashArray=[2, 2]))
        away = (centres - (low + high) / 2) * scale
        dots = np.stack([left + (each + camera) / 2 + away[:, 2], middle - away[:, axis]], axis=1)
        for x, y in dots:
            drawing.add(Circle(x, y, DOT, fillColor=HexColor("#2f6690"), strokeColor=None))
        for number, (x, y) in enumerate(_beside_dots(dots), start=1):
            text(x, y - 2.6, str(number), INK, "middle")
        near, far = (figures(float(bound[2]), 4) for bound in (low, high))
        text(left, 4, f"{name}; {near} to {far} {unit} from the camera, at the left")
    return drawing


def _beside_dots(dots: FloatArray) -> FloatArray:
    """(N, 2) a place for a number beside each dot: the one farthest from the other dots, and from numbers before."""
    angles = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ring = 3.2 * DOT * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    places = np.empty((0, 2))
    for dot in dots:
        taken = np.concatenate([dots[(dots != dot).any(axis=1)], places])
        around = dot + ring
        free = np.linalg.norm(around[:, None] - taken, axis=2).min(axis=1, initial=4 * DOT)
        places = np.concatenate([places, around[[int(free.argmax())]]])
    return places


def _colors(shares: FloatArray) -> NDArray[np.uint8]:
    """Blue at -1, white at 0, red at 1."""
    amount = np.clip(np.abs(shares), 0, 1)[:, None]
    end = np.where((shares < 0)[:, None], BLUE, RED)
    return ((1 - amount) * WHITE + amount * end).round().astype(np.uint8)
