"""The certificate of an acceptance test, PDF, as a metrology laboratory issues one."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from retrue.acceptance.accept import SHORTEST_BAR, SMALLEST_BALL, SMALLEST_PLANE, SYMBOLS, Acceptance, Value
from retrue.errors import FileError, InputError
from retrue.geometry.arrays import Image
from retrue.report.certificate_pictures import histogram, part, residual_picture, volume_plan
from retrue.shown import figures, figures_beside

NAMES = {
    "form": "Probing error, form",
    "size": "Probing error, size",
    "spacing": "Sphere spacing error",
    "flatness": "Flatness measurement error",
}
WORDS = {
    "passed": ("CONFORMS", "#1b7f4b"),
    "failed": ("DOES NOT CONFORM", "#b3261e"),
    "undecided": ("NOT DECIDED", "#a15c00"),
    "measured": ("MEASURED, NO LIMITS GIVEN", "#33475b"),
}
INK, FAINT, RULE = "#1c2733", "#5b6b7a", "#b8c4ce"
PROCEDURE = (
    "The artefact was measured in the positions listed above and found in each cloud of points by its shape. PF "
    "is the range of the points' distances from the Gaussian sphere (free diameter), PS its diameter less the "
    "calibrated one, SD the distance of the centres of two Gaussian spheres less the calibrated one, F the range "
    "of the distances from the Gaussian plane. PF and F leave out {outliers:g} &#8240; of the points. Points of "
    "a ball count within {cap:g}&#176; of the line to the camera."
)
UNCERTAINTY = (
    "U is the expanded uncertainty, coverage factor k = 2 (about 95 %). It combines the calibration of the "
    "artefact, where it was stated, with the noise of the points, which was taken from what they leave about a "
    "smooth field over the artefact; where neighbours share their noise, that is counted. Errors of the rig "
    "itself are what is tested, and are no part of U. Conformity is decided after ISO 14253-1: a value conforms "
    "where |value| + U is within the limit, and does not where |value| - U is beyond it."
)


@dataclass(frozen=True, slots=True)
class Particulars:
    """What a certificate says beside the values.

    Attributes
    ----------
    number, made, place, operator : of the certificate; empty ones are left to be filled in by hand.
    devices : serial numbers by name.
    command : as it was typed.
    versions : of what computed it.
    hashes : SHA-256 of every file that went in, by name.
    """

    number: str
    made: str
    place: str
    operator: str
    devices: Mapping[str, str]
    command: str
    versions: Mapping[str, str]
    hashes: Mapping[str, str]


def require_certificate(path: str | Path) -> None:
    """Find out before the work that no certificate can be written there."""
    if Path(path).suffix.lower() != ".pdf":
        raise FileError(path, f"expected a certificate that ends in .pdf, found {Path(path).suffix or 'no ending'}")
    if find_spec("reportlab") is None:
        raise InputError('certificate: expected the library reportlab, found none; pip install ".[certificate]"')


def certificate_pdf(answer: Acceptance, particulars: Particulars, photographs: Mapping[str, Image | None]) -> bytes:
    """The bytes of the file; `photographs` by the names of the positions.

    Raises `InputError` for an answer that is refused: there is nothing to certify.
    """
    if answer.verdict == "refused":
        raise InputError(f"certificate: nothing was measured: {answer.reason}")
    A4: Any = part("lib.pagesizes.A4")
    mm: Any = part("lib.units.mm")
    PageBreak: Any = part("platypus.PageBreak")
    SimpleDocTemplate: Any = part("platypus.SimpleDocTemplate")

    story: list[Any] = [
        *_front(answer, particulars),
        PageBreak(),
        *_results(answer),
        *_pictures(answer, photographs),
        *_sources(particulars),
    ]
    stream = io.BytesIO()
    document: Any = SimpleDocTemplate(
        stream, pagesize=A4, leftMargin=22 * mm - 6, rightMargin=22 * mm - 6, topMargin=30 * mm, bottomMargin=24 * mm,
        title=f"Acceptance test {particulars.number}", author=particulars.place or "retrue",
        subject=str(answer.artefact),
    )  # fmt: skip
    document.build(story, canvasmaker=_numbered(particulars.number))
    return stream.getvalue()


def _front(answer: Acceptance, particulars: Particulars) -> list[Any]:
    """The first page: what was tested, with what, and what came of it."""
    mm: Any = part("lib.units.mm")
    Spacer: Any = part("platypus.Spacer")

    word, color = WORDS[answer.verdict]
    wanted = answer.artefact.positions
    rows = [
        ("Object", "Camera-projector rig, structured light"),
        *((name.capitalize(), value) for name, value in particulars.devices.items()),
        ("Artefact", _artefact_words(answer)),
        ("Procedure", "after VDI/VDE 2634 part 2"),
        ("Positions", f"{len(answer.positions)} (the guideline asks for {wanted})"),
        ("Measuring volume", _volume_words(answer)),
        ("Place", particulars.place),
        ("Date", particulars.made),
    ]
    remarks = [_paragraph(text, "small") for text in _remarks(answer)]
    return [
        _paragraph("Certificate of acceptance test", "title"),
        _paragraph(f"No. {_escaped(particulars.number)}", "number"),
        Spacer(0, 5 * mm),
        _table([(_paragraph(name, "label"), _paragraph(_escaped(value), "body")) for name, value in rows], (38, 128)),
        Spacer(0, 6 * mm),
        _banner(word, answer.reason, color),
        Spacer(0, 6 * mm),
        _paragraph(f"Largest values over all positions, in {_escaped(answer.unit)}", "heading"),
        _values_table([("", value) for value in answer.worst().values()], named=True),
        Spacer(0, 3 * mm),
        *remarks,
        Spacer(0, 14 * mm),
        _table(
            [("", "", ""), (_paragraph(f"Measured by {_escaped(particulars.operator)}", "small"), "",
                            _paragraph("Approved by", "small"))],
            (76, 14, 76), lines=[(0, 0), (2, 0)], plain=True,
        ),
    ]  # fmt: skip


def _results(answer: Acceptance) -> list[Any]:
    mm: Any = part("lib.units.mm")
    Spacer: Any = part("platypus.Spacer")

    rows = [(position.name, value) for position in answer.positions for value in position.values]
    refused = [position for position in answer.positions if position.cause is not None]
    options = answer.options
    return [
        _paragraph("Results of each position", "heading"),
        _values_table(rows, named=False),
        *(_paragraph(f"{_escaped(each.name)}: not measured, {_escaped(str(each.cause))}", "small") for each in refused),
        Spacer(0, 4 * mm),
        _paragraph("Procedure", "heading"),
        _paragraph(PROCEDURE.format(outliers=options.outliers_permille, cap=options.cap_deg), "body"),
        _paragraph("Uncertainty and decision", "heading"),
        _paragraph(UNCERTAINTY, "body"),
    ]


def _pictures(answer: Acceptance, photographs: Mapping[str, Image | None]) -> list[Any]:
    """Where the artefact stood, and what the points of each position leave."""
    mm: Any = part("lib.units.mm")
    Picture: Any = part("platypus.Image")
    KeepTogether: Any = part("platypus.KeepTogether")
    Spacer: Any = part("platypus.Spacer")

    measured = [position for position in answer.positions if position.cause is None]
    parts: list[Any] = [
        KeepTogether([_paragraph("Positions in the measuring volume", "heading"), volume_plan(measured, answer.unit)])
    ]
    for position in measured:
        picture, scale = residual_picture(position, photographs.get(position.name))
        content = io.BytesIO()
        picture.save(content, "PNG")
        width, height = picture.size
        across = min(78 * mm, 50 * mm * width / height)
        caption = (
            f"{len(position.residuals):,} points. Left: each point in the picture, blue {figures(-scale)} "
            f"{answer.unit}, white 0, red {figures(scale)} {answer.unit}, positive towards the camera. Right: how "
            "the distances spread."
        )
        pair = _table(
            [(Picture(content, across, across * height / width), histogram(position, answer.unit))],
            (84, 82),
            plain=True,
        )
        heading = _paragraph(f"Distances from the fitted element: {_escaped(position.name)}", "heading")
        parts.append(KeepTogether([heading, pair, _paragraph(_escaped(caption), "small"), Spacer(0, 3 * mm)]))
    return parts


def _sources(particulars: Particulars) -> list[Any]:
    KeepTogether: Any = part("platypus.KeepTogether")

    hashes = [
        (_paragraph(_escaped(name), "mono"), _paragraph(value, "mono")) for name, value in particulars.hashes.items()
    ]
    versions = ", ".join(f"{name} {version}" for name, version in particulars.versions.items())
    return [
        KeepTogether([_paragraph("What went in (SHA-256)", "heading"), _table(hashes, (54, 112))]),
        KeepTogether([_paragraph("Computed by", "heading"), _paragraph(_escaped(versions), "small"),
                      _paragraph(_escaped(particulars.command), "mono")]),
    ]  # fmt: skip


def _artefact_words(answer: Acceptance) -> str:
    artefact, unit = answer.artefact, answer.unit
    if artefact.diameter is None:
        return "plane"
    lengths = [("ball" if artefact.kind == "sphere" else "ball bar, balls", artefact.diameter)]
    lengths += [] if artefact.distance is None else [("centres", artefact.distance)]
    words = [
        f"{name} {length.value:.6g} {unit}"
        + (f" (U = {figures(length.expanded, 2)} {unit})" if length.expanded else "")
        for name, length in lengths
    ]
    return ", ".join(words)


def _volume_words(answer: Acceptance) -> str:
    diagonal = answer.options.diagonal
    return "not stated" if diagonal is None else f"diagonal {figures(diagonal, 4)} {answer.unit}"


def _remarks(answer: Acceptance) -> list[str]:
    found: list[str] = []
    if len(answer.positions) < answer.artefact.positions:
        found.append(
            f"Fewer positions than the guideline's {answer.artefact.positions}: this is an interim check, not an "
            "acceptance test after the guideline."
        )
    if answer.options.diagonal is None:
        found.append(
            "The measuring volume was not stated, so that the artefact's proportions were not checked: the "
            f"guideline is quoted as wanting balls of {SMALLEST_BALL:g}, bars of {SHORTEST_BAR:g} and planes of "
            f"{SMALLEST_PLANE:g} of its diagonal, or more."
        )
    lengths = [length for length in (answer.artefact.diameter, answer.artefact.distance) if length is not None]
    if any(not length.expanded for length in lengths):
        found.append("The uncertainty of the artefact's calibration was not stated and is taken as nothing.")
    return found


def _values_table(rows: Sequence[tuple[str, Value]], *, named: bool) -> Any:
    """One value a row; `named`: with the name of the quantity instead of the position's."""
    head = ["Quantity" if named else "Position", "", "value", "U (k = 2)", "limit", "decision"]
    cells: list[Sequence[Any]] = [
        [_paragraph(text, "number label" if 1 < at < 5 else "label") for at, text in enumerate(head)]
    ]
    for position, value in rows:
        color = WORDS[value.decision][1]
        first = NAMES[value.quantity] if named else position
        symbol = f"{SYMBOLS[value.quantity]} {value.part}".strip()
        limit = "&#8211;" if value.limit is None else figures(value.limit)
        numbers = [figures_beside(value.value, value.expanded), figures(value.expanded), limit]
        cells.append(
            [
                _paragraph(_escaped(first), "body"),
                _paragraph(symbol, "body"),
                *(_paragraph(number, "number cell") for number in numbers),
                _paragraph(f'<font color="{color}"><b>{value.decision}</b></font>', "body"),
            ]
        )
    return _table(cells, (54, 24, 22, 22, 20, 24), head=True)


def _banner(word: str, sentence: str, color: str) -> Any:
    HexColor: Any = part("lib.colors.HexColor")
    mm: Any = part("lib.units.mm")
    Table: Any = part("platypus.Table")

    text = [
        _paragraph(f'<font color="{color}"><b>{word}</b></font>', "verdict"),
        _paragraph(_escaped(sentence), "body"),
    ]
    table: Any = Table([[text]], colWidths=[166 * mm])
    table.setStyle(
        [
            ("BOX", (0, 0), (-1, -1), 0.8, HexColor(color)),
            ("LINEBEFORE", (0, 0), (0, -1), 5, HexColor(color)),
            ("LEFTPADDING", (0, 0), (-1, -1), 12),
            ("TOPPADDING", (0, 0), (-1, -1), 7),
            ("BOTTOMPADDING", (0, 0), (-1, -1), 9),
        ]
    )
    return table


def _table(
    rows: Sequence[Sequence[Any]],
    widths_mm: Sequence[float],
    *,
    head: bool = False,
    plain: bool = False,
    lines: Sequence[tuple[int, int]] = (),
) -> Any:
    """A table with a thin rule below each row; `plain`: without, but below the cells of `lines`."""
    HexColor: Any = part("lib.colors.HexColor")
    mm: Any = part("lib.units.mm")
    Table: Any = part("platypus.Table")

    table: Any = Table([list(row) for row in rows], colWidths=[width * mm for width in widths_mm], repeatRows=int(head))
    style: list[Any] = [
        ("VALIGN", (0, 0), (-1, -1), "MIDDLE"),
        ("LEFTPADDING", (0, 0), (-1, -1), 0),
        ("TOPPADDING", (0, 0), (-1, -1), 2.2),
        ("BOTTOMPADDING", (0, 0), (-1, -1), 2.8),
    ]
    if not plain:
        style.append(("LINEBELOW", (0, 0), (-1, -1), 0.35, HexColor(RULE)))
    if head:
        style.append(("LINEBELOW", (0, 0), (-1, 0), 0.9, HexColor(INK)))
    style += [("LINEBELOW", cell, cell, 0.6, HexColor(INK)) for cell in lines]
    table.setStyle(style)
    return table


def _paragraph(text: str, kind: str) -> Any:
    HexColor: Any = part("lib.colors.HexColor")
    ParagraphStyle: Any = part("lib.styles.ParagraphStyle")
    Paragraph: Any = part("platypus.Paragraph")

    size, font, color, more = {
        "title": (21, "Helvetica-Bold", INK, {}),
        "number": (11, "Helvetica", FAINT, {"spaceBefore": 5}),
        "heading": (11, "Helvetica-Bold", INK, {"spaceBefore": 9, "spaceAfter": 4, "keepWithNext": 1}),
        "verdict": (15, "Helvetica-Bold", INK, {"spaceAfter": 4}),
        "body": (9, "Helvetica", INK, {}),
        "number cell": (9, "Helvetica", INK, {"alignment": 2, "rightIndent": 8}),
        "number label": (8.2, "Helvetica-Bold", FAINT, {"alignment": 2, "rightIndent": 8}),
        "label": (8.2, "Helvetica-Bold", FAINT, {}),
        "small": (8, "Helvetica", FAINT, {"spaceAfter": 2}),
        "mono": (6.9, "Courier", INK, {"wordWrap": "CJK"}),
    }[kind]
    style: Any = ParagraphStyle(
        kind, fontName=font, fontSize=size, leading=1.32 * size, textColor=HexColor(color), **more
    )
    return Paragraph(text, style)


def _escaped(text: str) -> str:
    from xml.sax.saxutils import escape

    return escape(text.encode("latin-1", "replace").decode("latin-1"))  # what the fonts of every reader hold


def _numbered(number: str) -> type[Any]:
    """A canvas that knows how many pages there are, and says so at the foot of each."""
    HexColor: Any = part("lib.colors.HexColor")
    mm: Any = part("lib.units.mm")
    Canvas: Any = part("pdfgen.canvas.Canvas")

    class Numbered(Canvas):
        def __init__(self, *arguments: Any, **named: Any) -> None:
            super().__init__(*arguments, **named)
            self.pages: list[dict[str, Any]] = []

        def showPage(self) -> None:
            self.pages.append(dict(self.__dict__))
            self._startPage()

        def save(self) -> None:
            for index, page in enumerate(self.pages, start=1):
                self.__dict__.update(page)
                self._furniture(index, len(self.pages))
                super().showPage()
            super().save()

        def _furniture(self, page: int, pages: int) -> None:
            width, height = self._pagesize
            self.setStrokeColor(HexColor(INK))
            self.setLineWidth(1.4)
            self.line(22 * mm, height - 22 * mm, width - 22 * mm, height - 22 * mm)
            self.setFillColor(HexColor(INK))
            self.setFont("Helvetica-Bold", 12)
            self.drawString(22 * mm, height - 19 * mm, "retrue")
            self.setFont("Helvetica", 8)
            self.setFillColor(HexColor(FAINT))
            self.drawRightString(width - 22 * mm, height - 19 * mm, "3D measurement by structured light")
            self.setStrokeColor(HexColor(RULE))
            self.setLineWidth(0.4)
            self.line(22 * mm, 18 * mm, width - 22 * mm, 18 * mm)
            self.drawString(22 * mm, 13.5 * mm, f"Certificate {number}. To be copied as a whole only.")
            self.drawRightString(width - 22 * mm, 13.5 * mm, f"Page {page} of {pages}")

    return Numbered
