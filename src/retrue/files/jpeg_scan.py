"""Whether the pixels of a JPEG are all in it, told by its codes: it has no checksums.

Where bytes were lost, or others written over them, its codes lead to too few blocks or too many. libjpeg says so to
the terminal, and fills up with grey.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np

from retrue.geometry.arrays import Image
from retrue.kernels import huffman

TABLES, RESTARTS, SCAN = 0xC4, 0xDD, 0xDA
SEQUENTIAL = (0xC0, 0xC1)
MOST_LEFT = 16
"""Bytes behind the last block that are no damage: some cameras write a few."""


@dataclass(slots=True)
class _Parts:
    """What a scan is read by: the picture's size, (across, down) blocks of each colour, and the codes of each table."""

    size: tuple[int, int] = (0, 0)
    blocks: dict[int, tuple[int, int]] = field(default_factory=dict[int, tuple[int, int]])
    codes: dict[int, Image] = field(default_factory=dict[int, Image])
    restart: int = 0


def pixels_are_whole(content: bytes) -> bool:
    """Whether the first scan of a sequential JPEG leads to its end; True for any other kind.

    >>> pixels_are_whole(b"\\xff\\xd8\\xff\\xc0\\0\\x0b\\x08\\0\\x08\\0\\x08\\1\\1\\x11\\0\\xff\\xda\\0\\x08")
    False
    """
    try:
        return _leads_to_its_end(content)
    except (struct.error, KeyError, IndexError, ValueError, ZeroDivisionError):
        return False


def _leads_to_its_end(content: bytes) -> bool:
    parts, place = _Parts(), 2
    while content[place : place + 1] == b"\xff":
        if content[place + 1] == 0xFF:  # a fill byte
            place += 1
            continue
        kind, length = struct.unpack_from(">BH", content, place + 1)
        segment, place = content[place + 4 : place + 2 + length], place + 2 + length
        if kind in SEQUENTIAL:
            height, width, count = struct.unpack_from(">HHB", segment, 1)
            colors = [struct.unpack_from("BB", segment, 6 + 3 * k) for k in range(count)]
            parts.size, parts.blocks = (width, height), {name: (side >> 4, side & 15) for name, side in colors}
        elif kind == TABLES:
            parts.codes.update(_codes(segment))
        elif kind == RESTARTS:
            (parts.restart,) = struct.unpack(">H", segment)
        elif kind == SCAN:
            return not parts.blocks or _scanned(content, place, segment, parts)
    return True


def _codes(segment: bytes) -> dict[int, Image]:
    """(65536,) of each table: of any 16 bits, 256 times the length of the code that they begin with, and its symbol."""
    found: dict[int, Image] = {}
    while segment:
        lengths = np.repeat(np.arange(1, 17), np.frombuffer(segment[1:17], np.uint8))
        symbols = np.frombuffer(segment[17 : 17 + len(lengths)], np.uint8)
        codes = np.repeat(256 * lengths + symbols, 1 << (16 - lengths))  # they follow one another without a gap
        found[segment[0]] = np.pad(codes, (0, 65536 - len(codes))).astype(np.uint16)
        segment = segment[17 + len(lengths) :]
    return found


def _scanned(content: bytes, place: int, segment: bytes, parts: _Parts) -> bool:
    chosen = [struct.unpack_from("BB", segment, 1 + 2 * k) for k in range(segment[0])]
    size, most = np.array(parts.size), np.max(list(parts.blocks.values()), axis=0)
    if len(chosen) == 1:  # no units: the blocks that hold pixels
        sides = np.ceil(size * parts.blocks[chosen[0][0]] / most) / 8
        of_block = [chosen[0][1]]
    else:
        sides = size / (8 * most)
        of_block = [table for name, table in chosen for _ in range(int(np.prod(parts.blocks[name])))]
    pairs = [(table >> 4, 16 + (table & 15)) for table in of_block]  # for the mean, and for the rest
    names = sorted({name for pair in pairs for name in pair})
    if not parts.codes.keys() >= set(names):  # frames of a video: the usual ones are meant
        return True
    codes = np.stack([parts.codes[name] for name in names])
    short = np.where(codes[:, ::128] >> 8 <= 9, codes[:, ::128], 0).astype(np.uint16)
    tables = np.array([[names.index(name) for name in pair] for pair in pairs], np.int32)
    units = math.prod(math.ceil(side) for side in sides.tolist())
    left: int = cast("Any", huffman).bytes_left(content, place, codes, short, tables, units, parts.restart)
    return 0 <= left <= MOST_LEFT
