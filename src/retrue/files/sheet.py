"""A sheet of paper with black shapes on it, as PDF and as SVG, in millimetres."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace
from xml.sax.saxutils import escape

POINTS_PER_MM = 72 / 25.4
KAPPA = 0.5522847498  # of a quarter of a circle as a cubic Bezier curve


@dataclass(frozen=True, slots=True)
class Rectangle:
    """Its top left corner is (x, y), y downwards."""

    x: float
    y: float
    width: float
    height: float

    def moved(self, dx: float, dy: float) -> Rectangle:
        return replace(self, x=self.x + dx, y=self.y + dy)


@dataclass(frozen=True, slots=True)
class Circle:
    """About (x, y)."""

    x: float
    y: float
    radius: float

    def moved(self, dx: float, dy: float) -> Circle:
        return replace(self, x=self.x + dx, y=self.y + dy)


@dataclass(frozen=True, slots=True)
class Text:
    """Begins at (x, y), the foot of its letters."""

    x: float
    y: float
    size: float
    text: str

    def moved(self, dx: float, dy: float) -> Text:
        return replace(self, x=self.x + dx, y=self.y + dy)


Shape = Rectangle | Circle | Text


@dataclass(frozen=True, slots=True)
class Sheet:
    """(width, height) of the paper, and what is on it."""

    size: tuple[float, float]
    shapes: tuple[Shape, ...]
    title: str


def svg(sheet: Sheet) -> bytes:
    """The sheet as SVG: one unit is one millimetre."""
    width, height = sheet.size
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{_text(width)}mm" height="{_text(height)}mm" '
        f'viewBox="0 0 {_text(width)} {_text(height)}">',
        f"<title>{escape(sheet.title)}</title>",
        f'<rect width="{_text(width)}" height="{_text(height)}" fill="white"/>',
    ]
    for shape in sheet.shapes:
        x, y = _text(shape.x), _text(shape.y)
        match shape:
            case Rectangle():
                lines.append(f'<rect x="{x}" y="{y}" width="{_text(shape.width)}" height="{_text(shape.height)}"/>')
            case Circle():
                lines.append(f'<circle cx="{x}" cy="{y}" r="{_text(shape.radius)}"/>')
            case Text():
                style = f'font-family="Helvetica, sans-serif" font-size="{_text(shape.size)}"'
                lines.append(f'<text x="{x}" y="{y}" {style}>{escape(shape.text)}</text>')
    return "\n".join([*lines, "</svg>\n"]).encode()


def pdf(sheet: Sheet) -> bytes:
    """The sheet as PDF 1.4, one page; viewers are asked not to scale it when they print (ISO 32000-1, 12.2)."""
    width, height = sheet.size
    commands = [f"{_text(POINTS_PER_MM, 9)} 0 0 {_text(POINTS_PER_MM, 9)} 0 0 cm"]  # from here on in millimetres
    for shape in sheet.shapes:
        match shape:
            case Rectangle():
                corner = f"{_text(shape.x)} {_text(height - shape.y - shape.height)}"
                commands.append(f"{corner} {_text(shape.width)} {_text(shape.height)} re f")
            case Circle():
                commands.append(_circle(shape.x, height - shape.y, shape.radius))
            case Text():
                words = shape.text.replace("\\", "\\\\").replace("(", "\\(").replace(")", "\\)")
                at = f"{_text(shape.x)} {_text(height - shape.y)}"
                commands.append(f"BT /F {_text(shape.size)} Tf {at} Td ({words}) Tj ET")
    stream = zlib.compress("\n".join(commands).encode("latin-1", "replace"))
    box = f"[0 0 {_text(width * POINTS_PER_MM)} {_text(height * POINTS_PER_MM)}]"
    fonts = "/Resources << /Font << /F 5 0 R >> >>"
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox {box} /Contents 4 0 R {fonts} >>".encode(),
        f"<< /Length {len(stream)} /Filter /FlateDecode >>\nstream\n".encode() + stream + b"\nendstream",
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>",
    ]
    content = b"%PDF-1.4\n%\xe2\xe3\xcf\xd3\n"
    starts: list[int] = []
    for number, body in enumerate(objects, start=1):
        starts.append(len(content))
        content += f"{number} 0 obj\n".encode() + body + b"\nendobj\n"
    table = "".join(f"{start:010d} 00000 n \n" for start in starts)
    end = (
        f"xref\n0 {len(objects) + 1}\n0000000000 65535 f \n{table}trailer\n<< /Size {len(objects) + 1} /Root 1 0 R >>\n"
    )
    return content + f"{end}startxref\n{len(content)}\n%%EOF\n".encode()


def _circle(x: float, y: float, radius: float) -> str:
    """As four curves."""
    r, k = radius, KAPPA * radius
    quarters = [
        (x + r, y + k, x + k, y + r, x, y + r),
        (x - k, y + r, x - r, y + k, x - r, y),
        (x - r, y - k, x - k, y - r, x, y - r),
        (x + k, y - r, x + r, y - k, x + r, y),
    ]
    curves = " ".join(" ".join(map(_text, quarter)) + " c" for quarter in quarters)
    return f"{_text(x + r)} {_text(y)} m {curves} f"


def _text(number: float, digits: int = 4) -> str:
    return f"{number:.{digits}f}".rstrip("0").rstrip(".") or "0"
