"""A JPEG's parts, in one walk from marker to marker, and whether its pixels are all in it: it has no checksums.

Where bytes were lost, or others written over them, its codes lead to too few blocks or too many, or a marker stands
where none may. libjpeg says so to the terminal, and fills up with grey.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import TYPE_CHECKING, Any, BinaryIO, cast

if TYPE_CHECKING:  # a header alone loads none of it
    from retrue.geometry.arrays import Image

TABLES, END, SCAN, RESTARTS = 0xC4, 0xD9, 0xDA, 0xDD
FRAMES = frozenset(range(0xC0, 0xD0)) - {TABLES, 0xC8, 0xCC}
SEQUENTIAL = (0xC0, 0xC1)
SEGMENTS = frozenset({*range(0xC0, 0xD0), *range(0xDA, 0xF0), 0xFE})  # tables, frames, scans, what tools add
BEHIND_PIXELS = re.compile(rb"\xff[\x01-\xcf\xd8-\xfe]")  # no stuffed zero, no restart, no fill byte
MOST_MARKERS = 10_000  # fill bytes count too
MOST_LEFT = 16
"""Bytes behind the last block that are no damage: some cameras write a few."""


def segments(stream: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Each marker and what it holds, to the picture's end; whoever meets a scan moves the stream behind its pixels.

    ValueError, struct.error or IndexError where what follows is no part of a JPEG.
    """
    stream.seek(2)
    for _ in range(MOST_MARKERS):
        start, marker = stream.read(2)
        if start == marker == 0xFF:  # a fill byte
            stream.seek(-1, 1)
            continue
        if start == 0xFF and marker == END:
            return
        (length,) = struct.unpack(">H", stream.read(2))
        if start != 0xFF or marker not in SEGMENTS or length < 2:
            raise ValueError("no marker")
        yield marker, stream.read(length - 2)
    raise ValueError("no end")


def frame(stream: BinaryIO) -> tuple[tuple[int, int], int]:
    """(width, height) and channels; raises as `segments` does."""
    for marker, segment in segments(stream):
        if marker in FRAMES:
            height, width, channels = struct.unpack_from(">HHB", segment, 1)
            return (width, height), channels
    raise ValueError("no frame")


def whole_scans(content: bytes, most: int) -> int:
    """How many scans a JPEG has, counted until they are more than `most`; 0 where not all of it is there.

    The codes of a sequential scan are followed to its end. Of others only markers tell: what was written over pixels
    holds one after some 250 bytes, of a kind that none may have there, or of a part that no other follows.

    >>> scan = b"\\xff\\xda\\0\\x08\\1" + bytes(5)
    >>> whole_scans(b"\\xff\\xd8" + scan + b"pixels\\xff\\0" + b"\\xff\\xd9", 9)
    1
    >>> whole_scans(b"\\xff\\xd8" + scan + b"pixels\\xff\\3" + b"\\xff\\xd9", 9)
    0
    >>> whole_scans(b"\\xff\\xd8\\xff\\xc0\\0\\x0b\\x08\\0\\x08\\0\\x08\\1\\1\\x11\\0" + scan + b"\\xff\\xd9", 9)
    0
    """
    stream, parts, scans = BytesIO(content), _Parts(), 0
    try:
        for marker, segment in segments(stream):
            parts.add(marker, segment)
            if marker == SCAN:
                scans += 1
                if scans > most:
                    break
                stream.seek(parts.behind_pixels(content, stream.tell(), segment))
    except (struct.error, KeyError, IndexError, ValueError, ZeroDivisionError):
        return 0
    return scans


@dataclass(slots=True)
class _Parts:
    """What a scan is read by: the picture's size, (across, down) blocks of each colour, each table's code words."""

    size: tuple[int, int] = (0, 0)
    blocks: dict[int, tuple[int, int]] = field(default_factory=dict[int, tuple[int, int]])
    words: dict[int, Image] = field(default_factory=dict[int, "Image"])
    restart: int = 0

    def add(self, marker: int, segment: bytes) -> None:
        if marker in SEQUENTIAL:
            height, width, count = struct.unpack_from(">HHB", segment, 1)
            colors = [struct.unpack_from("BB", segment, 6 + 3 * k) for k in range(count)]
            self.size, self.blocks = (width, height), {name: (side >> 4, side & 15) for name, side in colors}
        elif marker == TABLES:
            self.words.update(_words(segment))
        elif marker == RESTARTS:
            (self.restart,) = struct.unpack(">H", segment)

    def behind_pixels(self, content: bytes, place: int, segment: bytes) -> int:
        """Where the marker behind a scan stands; ValueError where its codes do not lead there."""
        if len(segment) != 4 + 2 * segment[0]:  # two bytes for each colour
            raise ValueError("no scan")
        end = self._behind_codes(content, place, segment) if self.blocks else None
        found = BEHIND_PIXELS.search(content, place if end is None else end)
        if found is None or (end is not None and found.start() > end + MOST_LEFT):
            raise ValueError("no marker")
        return found.start()

    def _behind_codes(self, content: bytes, place: int, segment: bytes) -> int | None:
        """Where the last block ends; None of a video's frames, which name no tables: the usual are meant."""
        import numpy as np

        from retrue.kernels import huffman

        chosen = [struct.unpack_from("BB", segment, 1 + 2 * k) for k in range(segment[0])]
        size, most = np.array(self.size), np.max(list(self.blocks.values()), axis=0)
        if len(chosen) == 1:  # no units: the blocks that hold pixels
            sides = np.ceil(size * self.blocks[chosen[0][0]] / most) / 8
            of_block = [chosen[0][1]]
        else:
            sides = size / (8 * most)
            of_block = [table for name, table in chosen for _ in range(int(np.prod(self.blocks[name])))]
        pairs = sorted(set(of_block))
        names = [name for pair in pairs for name in (pair >> 4, 16 + (pair & 15))]  # for means, and for the rest
        if not self.words.keys() >= set(names):
            return None
        words, tables = np.stack([self.words[name] for name in names]), len(names)
        scratch = np.empty((tables, 65536), np.uint16), np.empty((tables, 4096), np.uint16)
        units = math.prod(math.ceil(side) for side in sides.tolist())
        find: Callable[..., int] = cast("Any", huffman).codes_end
        indices = np.array([pairs.index(pair) for pair in of_block], np.int32)
        end = find(content, place, words, indices, units, self.restart, *scratch)
        if end < 0:
            raise ValueError("no code")
        return end


def _words(segment: bytes) -> dict[int, Image]:
    """(256,) of each table: of its codes, one after another, 256 times the length and the symbol; 0 behind the last."""
    import numpy as np

    found: dict[int, Image] = {}
    while segment:
        lengths = np.repeat(np.arange(1, 17), np.frombuffer(segment[1:17], np.uint8))
        symbols = np.frombuffer(segment[17 : 17 + len(lengths)], np.uint8)
        found[segment[0]] = np.zeros(256, np.uint16)
        found[segment[0]][: len(lengths)] = 256 * lengths + symbols
        segment = segment[17 + len(lengths) :]
    return found
