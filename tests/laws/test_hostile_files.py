"""Files from strangers: whatever is in them, a reader answers or raises a `RetrueError`, soon, in little memory."""

from __future__ import annotations

import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from retrue.errors import FileError, RetrueError
from retrue.files.history import MOST_DAMAGED, history_path, read_history

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "fuzz"))

from targets import TARGETS  # noqa: E402

EACH = pytest.mark.parametrize("name", sorted(TARGETS))
AWKWARD = [
    b"NaN",
    b"1e999",
    b"-1",
    b"9" * 400,
    b"null",
    b"[[[",
    b"{}",
    b'""',
    b"\\ud800",
    b"\n",
    b",",
    b"\0",
    b"\xff\xfe",
]


@st.composite
def damaged(draw: st.DrawFn, seeds: list[bytes]) -> bytes:
    """A good file with pieces replaced by awkward ones, by rubbish, or by other pieces of it."""
    content = draw(st.sampled_from(seeds))
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(content)))
        end = draw(st.integers(start, min(len(content), start + 40)))
        other = draw(st.integers(0, len(content)))
        piece = draw(st.sampled_from(AWKWARD) | st.binary(max_size=12) | st.just(content[other : other + 30]))
        content = content[:start] + piece + content[end:]
    return content


@EACH
def test_a_good_file_is_read(name, tmp_path):
    target = TARGETS[name]
    path = tmp_path / "good.json"
    path.write_bytes(target.seeds[0])
    target.read(path)


@EACH
def test_nothing_but_a_retrue_error(name):
    target = TARGETS[name]

    @settings(max_examples=150, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
    @given(damaged(list(target.seeds)))
    def check(content: bytes) -> None:
        target(content)

    check()


def test_coverage_guided(tmp_path):
    pytest.importorskip("atheris", reason="atheris is not installed")
    command = f"""
import os, sys
sys.path.insert(0, {str(ROOT / "fuzz")!r})
from fuzz import TARGETS, main
for name in TARGETS:
    child = os.fork()
    if not child:
        main(name, ["-runs=300", "-artifact_prefix={tmp_path}/"])
    if os.waitpid(child, 0)[1]:
        sys.exit("found in " + name)
"""
    environment = os.environ | {"PYTHONWARNINGS": ""}
    done = subprocess.run([sys.executable, "-c", command], capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr[-2000:]


MATRIX = b"%YAML:1.0\ncam_K: !!opencv-matrix\n"
ONE_NUMBER = b"\n   dt: d\n   data: [ 1. ]\n"
PATTERN = b'{"format": "retrue-pattern", "version": 1, '
GRAY = PATTERN + b'"kind": "gray-code", "order": "columns-msb-pattern-inverse-rows-msb-pattern-inverse-white-black", '
GRID = (
    PATTERN + b'"kind": "color-grid", "colors": [[0, 0, 0], [1, 1, 1]], "block": 1, "origin": [1, 1], "code": [[0]], '
)
JPEG_START = b"\xff\xd8"


def png(width: int, height: int) -> bytes:
    data = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    chunks = b"".join(
        struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        for name, body in ((b"IHDR", data), (b"IDAT", zlib.compress(b"\0")), (b"IEND", b""))
    )
    return b"\x89PNG\r\n\x1a\n" + chunks


def scans(count: int) -> bytes:
    frame = b"\xff\xc2\x00\x0b\x08\x00\x40\x00\x40\x01\x01\x11\x00"
    return JPEG_START + frame + b"\xff\xda\x00\x08\x01\x01\x00\x00\x00\x00\x00" * count + b"\xff\xd9"


BOMBS: dict[str, tuple[str, bytes]] = {
    "lists in lists": ("rig", b'{"a":' + b"[" * 1_000_000),
    "a million empty lists": ("rig", b'{"format": "retrue-rig", "version": [' + b"[]," * 1_000_000 + b"[]]}"),
    "an integer of a million digits": ("rig", b'{"a": ' + b"9" * 1_000_000 + b"}"),
    "a number that is infinite": ("rig", b'{"a": 1e999}'),
    "a thousand hundred keys, one twice": (
        "rig",
        b"{" + b",".join(b'"%d": 0' % k for k in range(100_000)) + b', "77": 1}',
    ),
    "nothing but lines": ("rig", b"\n" * 4_000_000),
    "nothing but blank lines and a key": ("rig", b"cam_K:\n" + b" \n" * 1_900_000 + b"x"),
    "lists that never end": ("device", b'{ "lensmodel": "LENSMODEL_PINHOLE",' + b'"intrinsics":[1 ' * 200_000),
    "comments that never end": ("rig", b"<a>" + b"<!--" * 900_000),
    "elements in elements": ("rig", b"<a>" * 900_000),
    "a thousand million laughs": (
        "rig",
        b'<?xml version="1.0"?><?x <!-- ?><!DOCTYPE a [<!ENTITY b "lol"><!ENTITY c "&b;&b;&b;">]><a>&c;</a>',
    ),
    "an entity from a file": ("rig", b'<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]><a>&b;</a>'),
    "a tag that would be run": ("rig", b"cam_K: !!python/object/apply:os.system [true]\n"),
    "a matrix that claims a million rows": ("rig-sized", MATRIX + b"   rows: 1000000\n   cols: 3" + ONE_NUMBER),
    "a matrix of many sides": ("rig-sized", MATRIX + b"   sizes: [ " + b"999999999, " * 300_000 + b"1 ]" + ONE_NUMBER),
    "a step of infinity": ("pattern", GRAY + b'"projector_size": [64, 48], "step": Infinity}'),
    "a step of four hundred digits": ("pattern", GRAY + b'"projector_size": [64, 48], "step": ' + b"9" * 400 + b"}"),
    "a pitch of four hundred digits": ("pattern", GRID + b'"projector_size": [64, 48], "pitch": ' + b"9" * 400 + b"}"),
    "a million kinds": ("pattern", PATTERN + b'"kind": [' + b"[]," * 1_000_000 + b"0]}"),
    "a line of a million commas": ("points", b"camera_x,camera_y,projector_x,projector_y\n" + b"," * 1_000_000),
    "a header of a million commas": ("points", b"," * 1_000_000),
    "ten thousand million pixels": ("image", png(100_000, 100_000)),
    "many pixels in few bytes": ("image", png(14_000, 14_000)),
    "a chunk that claims three gigabytes": ("image", png(16, 12)[:33] + b"\xc3\0\0\x39IDAT" + png(16, 12)[41:]),
    "a million fill bytes": ("image", JPEG_START + b"\xff" * 1_000_000),
    "ten thousand scans": ("image", scans(10_000)),
}  # fmt: skip


@pytest.mark.timeout(60)
@pytest.mark.parametrize("bomb", sorted(BOMBS))
def test_bombs_are_refused(bomb, tmp_path):
    name, content = BOMBS[bomb]
    path = tmp_path / "bomb.json"
    path.write_bytes(content)
    with pytest.raises(RetrueError) as caught:
        TARGETS[name].read(path)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < len(str(path)) * 2 + 300


@pytest.mark.timeout(60)
@pytest.mark.parametrize("line", [b"{}", b"x", b'{"id": ', b'{"id": {"id": , "crc32": "00000000"}'])
def test_a_history_of_nothing_takes_neither_time_nor_memory(line, tmp_path):
    rig = tmp_path / "rig.json"
    for between in (b"\n", b""):
        history_path(rig).write_bytes((line + between) * 20_000)
        history = read_history(rig)
        assert len(history) == 0
        assert 1 <= len(history.damaged) <= MOST_DAMAGED


def test_a_file_without_end_is_refused():
    if not Path("/dev/zero").exists():
        pytest.skip("no /dev/zero here")
    names = ("rig", "pattern", "points", "image", "state")
    command = f"""
import resource, sys
resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))
sys.path.insert(0, {str(ROOT / "fuzz")!r})
from pathlib import Path
from targets import TARGETS
from retrue.errors import RetrueError
from retrue.files.history import MOST_DAMAGED, history_path, read_history
for name in {names}:
    try:
        TARGETS[name].read(Path("/dev/zero"))
    except RetrueError as error:
        print(name, error)
"""
    done = subprocess.run([sys.executable, "-c", command], capture_output=True, text=True, check=False)
    assert [line.split(": ")[0] for line in done.stdout.splitlines()] == [f"{name} /dev/zero" for name in names], done


def test_a_picture_named_like_a_number_that_is_none(tmp_path):
    from retrue.files.images import picture_paths

    for name in ("a\u00b2.png", "a2.png", "a\u0662.png"):
        (tmp_path / name).write_bytes(b"")
    assert len(picture_paths(tmp_path)) == 3


@pytest.mark.parametrize("unit", ['"m\\u001b[31m"', '"\\ud800"', '"' + "m" * 1000 + '"', '"m\\n"'])
def test_a_unit_that_would_spoil_the_terminal(tmp_path, unit):
    seed = TARGETS["rig"].seeds[0].replace(b'"mm"', unit.encode())
    (tmp_path / "rig.json").write_bytes(seed)
    with pytest.raises(FileError, match="unit"):
        TARGETS["rig"].read(tmp_path / "rig.json")
