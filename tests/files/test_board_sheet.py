"""Boards to print: found by the detector, true to size, in both formats alike."""

from __future__ import annotations

import re
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from retrue.calibration.board import parse_board
from retrue.calibration.detection import find_board
from retrue.cli.main import main
from retrue.errors import InputError
from retrue.files.board_sheet import lay_out_board, write_board
from retrue.files.sheet import POINTS_PER_MM, Circle, Rectangle, Sheet

BOARDS = [
    ("chessboard:9x6:20mm", "A4"),
    ("charuco:10x7:1in:18mm:DICT_5X5_100", "A3"),
    ("charuco:8x6:2.5cm:1.8cm:DICT_4X4_50", "A4"),
    ("circles:8x6:20mm", "A4"),
    ("asymmetric-circles:4x9:15mm", "A4"),
]
PIXELS_PER_MM = 5


def painted(sheet: Sheet) -> np.ndarray:
    """Grey, five pixels a millimetre; the sheet's corner is the corner of the first pixel."""
    width, height = (round(side * PIXELS_PER_MM) for side in sheet.size)
    page = np.full((height, width), 255, np.uint8)
    for shape in sheet.shapes:
        if isinstance(shape, Rectangle):
            left, top, right, bottom = (
                round(side * PIXELS_PER_MM)
                for side in (shape.x, shape.y, shape.x + shape.width, shape.y + shape.height)
            )
            page[top:bottom, left:right] = 0
        elif isinstance(shape, Circle):
            centre = [round(16 * (side * PIXELS_PER_MM - 0.5)) for side in (shape.x, shape.y)]
            cv2.circle(page, centre, round(16 * shape.radius * PIXELS_PER_MM), 0, -1, cv2.LINE_AA, 4)
    return page


@pytest.mark.parametrize(("spec", "paper"), [board for board in BOARDS if "1in" not in board[0]])
def test_the_printed_board_is_found_and_true_to_size(spec: str, paper: str):
    board = parse_board(spec)
    found = find_board(painted(lay_out_board(board, spec, paper).sheet), board)
    millimetres = {"mm": 1.0, "cm": 10.0}[board.unit]
    span_px = np.linalg.norm(found.pixels[-1] - found.pixels[0]) / PIXELS_PER_MM
    span_mm = np.linalg.norm(found.board_xy[-1] - found.board_xy[0]) * millimetres
    assert span_px == pytest.approx(span_mm, abs=0.05)
    assert len(found.board_xy) == len(board.points)


@pytest.mark.parametrize(("spec", "paper"), BOARDS)
def test_pdf_and_svg_say_the_same(spec: str, paper: str, tmp_path: Path):
    sheet = lay_out_board(parse_board(spec.replace("18mm", "0.7in")), spec, paper).sheet
    write_board(tmp_path / "b.svg", sheet)
    write_board(tmp_path / "b.pdf", sheet)
    text = (tmp_path / "b.svg").read_text()
    assert f'width="{sheet.size[0]:g}mm" height="{sheet.size[1]:g}mm"' in text
    assert spec in text
    number = r"(-?[\d.]+)"
    drawn = re.findall(rf'<rect x="{number}" y="{number}" width="{number}" height="{number}"/>', text)
    content = (tmp_path / "b.pdf").read_bytes()
    commands = zlib.decompress(content.partition(b"stream\n")[2].partition(b"\nendstream")[0]).decode()
    printed = re.findall(rf"^{number} {number} {number} {number} re f$", commands, re.MULTILINE)
    assert len(drawn) == len(printed) > 0
    for (x, y, width, height), (px, py, pw, ph) in zip(drawn, printed, strict=True):
        assert float(x) == pytest.approx(float(px), abs=1e-3)
        assert float(y) + float(height) == pytest.approx(sheet.size[1] - float(py), abs=1e-3)
        assert (width, height) == (pw, ph)
    assert text.count("<circle") == commands.count(" m ")
    scale = float(commands.split()[0])
    assert scale == pytest.approx(POINTS_PER_MM, abs=1e-8)
    box = [float(side) for side in re.search(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", content).groups()]  # type: ignore[union-attr]
    assert box == pytest.approx([side * POINTS_PER_MM for side in sheet.size], abs=1e-3)
    start = int(content.rpartition(b"startxref\n")[2].split()[0])
    assert content[start : start + 4] == b"xref"
    for entry in re.findall(rb"^(\d{10}) 00000 n", content, re.MULTILINE):
        assert re.match(rb"\d 0 obj", content[int(entry) :])


def test_the_ruler_is_100_mm_long():
    sheet = lay_out_board(parse_board("chessboard:9x6:20mm"), "x", "A4").sheet
    assert (
        sum(isinstance(shape, Rectangle) and shape.width == 100.0 and shape.height < 1 for shape in sheet.shapes) == 1
    )


def test_what_cannot_be_printed_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    with pytest.raises(InputError, match=r"is 500 x 400 mm and does not fit A4, which is 210 x 297 mm with"):
        lay_out_board(parse_board("chessboard:9x7:50mm"), "chessboard:9x7:50mm", "A4")
    with pytest.raises(InputError, match=r"DICT_4X4_50 has 50 markers, this board needs 77"):
        lay_out_board(parse_board("charuco:14x11:10mm:7mm:DICT_4X4_50"), "x", "A3")
    with pytest.raises(InputError, match="paper: expected A4, A3"):
        lay_out_board(parse_board("chessboard:9x6:20mm"), "x", "B5")
    assert main(["board", "chessboard:9x6:20mm", "--out", str(tmp_path / "b.png")]) == 2
    assert "expected a name that ends in .pdf or .svg" in capsys.readouterr().err
    assert main(["board", "chessboard:9x6:20mm", "--out", str(tmp_path / "b.pdf"), "--json"]) == 0
    assert '"size_mm": [200.0, 140.0]' in capsys.readouterr().out
