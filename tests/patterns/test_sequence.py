"""Roles of frames, and the layouts of common tools."""

from __future__ import annotations

import numpy as np
import pytest

from retrue.errors import InputError
from retrue.patterns.gray_code import GrayCode
from retrue.patterns.layouts import LAYOUTS, as_captured, gray_frames, layout_sequence, sequence_of, sine_frames
from retrue.patterns.sequence import Frame, FrameSequence


@pytest.mark.parametrize(
    "pattern", [GrayCode((128, 96)), GrayCode((100, 70), step=3), GrayCode((128, 96), offset=(0, 16))], ids=str
)
def test_a_gray_code_is_the_sequence_that_it_is(pattern: GrayCode) -> None:
    for mine, its in zip(sequence_of(pattern).render(), pattern.render(), strict=True):
        assert np.array_equal(mine, its)
    assert sequence_of(pattern).names == [
        name if name in ("white", "black") else renumbered(name, pattern) for name in pattern.names
    ]


def renumbered(name: str, pattern: GrayCode) -> str:
    axis, _, bit, kind = name.split()
    return f"{axis} bit {pattern.bits[axis == 'row'] - 1 - int(bit)} {kind}"


@pytest.mark.parametrize(
    ("name", "size", "count"),
    [
        ("procam-calibration", (1024, 768), 42),
        ("opencv", (1280, 800), 44),
        ("3dunderworld", (1024, 768), 42),
        ("scan3d-capture", (1280, 800), 42),
        ("sltk", (1280, 800), 44),
        ("structuredlight", (1920, 1080), 11),
        ("structuredlight-phase", (1920, 1080), 3),
        ("slstudio-gray", (1824, 1140), 18),
        ("slstudio-2x3", (1824, 1140), 12),
        ("slstudio-nstep", (1824, 1140), 24),
        ("slstudio-3", (1824, 1140), 3),
        ("slstudio-4", (1824, 1140), 4),
    ],
)
def test_layouts_have_the_pictures_of_their_tools(name: str, size: tuple[int, int], count: int) -> None:
    assert layout_sequence(name, size).picture_count == count


def test_every_layout_is_tested() -> None:
    mark = next(mark for mark in test_layouts_have_the_pictures_of_their_tools.pytestmark if mark.name == "parametrize")
    assert {case[0] for case in mark.args[1]} == set(LAYOUTS)


def test_slstudio_leaves_the_lowest_bits_out() -> None:
    names = layout_sequence("slstudio-gray", (1824, 1140)).names
    assert names[:3] == ["white", "black", "column bit 10 pattern"]
    assert names[11] == "column bit 1 pattern"
    assert names[-1] == "row bit 5 pattern"


def test_scan3d_centres_its_code() -> None:
    frames = layout_sequence("scan3d-capture", (1280, 800)).frames
    assert {frame.offset_px for frame in frames if frame.axis == "column"} == {-384}
    assert {frame.offset_px for frame in frames if frame.axis == "row"} == {-112}
    assert frames[2].bit == 10
    assert min(frame.bit for frame in frames if frame.axis == "column") == 1


def test_a_capture_of_columns_alone_is_taken() -> None:
    both = layout_sequence("slstudio-2x3", (1824, 1140))
    assert as_captured(both, 6).axes == (0,)
    assert as_captured(both, 12) is both
    assert as_captured(both, 7) is both
    assert as_captured(layout_sequence("slstudio-gray", (1824, 1140)), 12).names[:2] == ["white", "black"]


def test_a_sine_is_brightest_at_its_shift() -> None:
    line = Frame("phase", "column", period_px=60.0, shift=0.25, offset_px=3).brightness(np.arange(60.0))
    assert int(line.argmax()) == 18
    inverse = Frame("phase", "column", period_px=60.0, shift=0.25, offset_px=3, inverse=True)
    assert np.allclose(inverse.brightness(np.arange(60.0)), 1 - line)


BITS = gray_frames("column", range(7)[::-1], inverses=False)


@pytest.mark.parametrize(
    ("frames", "says"),
    [
        ([Frame("white")], "found none"),
        (BITS[1:], "tell 64 pixels apart"),
        ([*BITS, BITS[2]], "shown twice"),
        ([*BITS[:3], *BITS[4:]], "no column bit 3"),
        (sine_frames("column", 128.0, 3)[:2], "three or more shifts"),
        (sine_frames("column", 64.0, 3), "tell 64 pixels apart"),
        (gray_frames("column", range(8)[::-1], inverses=False, offset_px=200), "write -200"),
    ],
)
def test_frames_that_tell_no_coordinate_are_refused(frames: list[Frame], says: str) -> None:
    with pytest.raises(InputError, match=says):
        FrameSequence((128, 96), tuple(frames))


@pytest.mark.parametrize(
    "wrong",
    [
        {"code": "stripes"},
        {"code": "gray", "axis": "diagonal", "bit": 1},
        {"code": "gray", "axis": "row"},
        {"code": "gray", "axis": "row", "bit": 20},
        {"code": "phase", "axis": "row", "period_px": 1.0, "shift": 0.0},
        {"code": "phase", "axis": "row", "period_px": float("nan"), "shift": 0.0},
        {"code": "phase", "axis": "row", "period_px": 100.0},
        {"code": "gray", "axis": "row", "bit": 1, "step_px": 0},
    ],
)
def test_a_frame_that_is_none_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(InputError):
        Frame(**wrong)  # type: ignore[arg-type]
