"""Sequences come back from JSON as they were, and by the name of a layout; what is wrong is named."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import retrue
from retrue.patterns.phase_shift import make_phase_shift

HEAD = {"format": "retrue-pattern", "version": 1, "kind": "sequence", "projector_size": [128, 96]}
SINES = [{"axis": "column", "code": "phase", "period_px": 128, "shift": k / 3} for k in range(3)]


def written(tmp_path: Path, **keys: object) -> Path:
    path = tmp_path / "pattern.json"
    path.write_text(json.dumps({**HEAD, **keys}))
    return path


@pytest.mark.parametrize("turns", ["gray", "cue", "coprime"])
def test_a_sequence_comes_back(tmp_path: Path, turns: str) -> None:
    pattern = make_phase_shift((1024, 768), turns=turns)  # type: ignore[arg-type]
    retrue.write_pattern(tmp_path / "p.json", pattern)
    assert retrue.read_pattern(tmp_path / "p.json") == pattern


def test_a_layout_stands_for_its_frames(tmp_path: Path) -> None:
    pattern = retrue.read_pattern(written(tmp_path, layout="sltk", axes=["column"]))
    assert pattern == retrue.layout_sequence("sltk", (128, 96), ["column"])


def test_step_and_offset_may_stand_beside_the_frames(tmp_path: Path) -> None:
    frames = [{"axis": "row", "code": "gray", "bit": bit} for bit in range(6)]
    pattern = retrue.read_pattern(written(tmp_path, frames=frames, step_px=2, offset_px=-16))
    assert isinstance(pattern, retrue.FrameSequence)
    assert {(frame.step_px, frame.offset_px) for frame in pattern.frames} == {(2, -16)}


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ({}, '"frames" is missing'),
        ({"layout": "unknown"}, "layout: expected one of"),
        ({"frames": [*SINES, {"code": "stripes"}]}, r"frames\[3\]: code: expected one of"),
        ({"frames": SINES[:2]}, "three or more shifts"),
        ({"frames": SINES, "files": ["a.png"]}, "files: expected a name for each"),
    ],
)
def test_what_is_no_sequence_is_named(tmp_path: Path, keys: dict[str, object], says: str) -> None:
    with pytest.raises(retrue.FileError, match=says):
        retrue.read_pattern(written(tmp_path, **keys))
