"""A TIFF's directory without what its pixels do not need.

libtiff tells the terminal of each tag that it does not know, of each channel that the file does not name, and reads on.
"""

from __future__ import annotations

import struct
from io import BytesIO
from typing import BinaryIO

WIDTH, HEIGHT, COLORS, SAMPLES, EXTRA = 256, 257, 262, 277, 338
PIXELS = frozenset(
    {WIDTH, HEIGHT, 258, 259, COLORS, 266, 273, 274, SAMPLES, 278, 279, 284, 292, 293, 317, *range(320, 326), EXTRA}
    | {339, 347, *range(512, 522), *range(529, 533)}
)
"""Tags of TIFF 6.0 that say how pixels lie in the file: size, depth, packing, strips, tiles, palette, subsampling."""
OF_COLORS = {0: 1, 1: 1, 2: 3, 3: 1, 5: 4, 6: 3, 8: 3}
"""Channels of each kind of colours; what is beyond them, transparency say, is extra."""
WHOLE = {1: "B", 3: "H", 4: "I"}  # kinds of numbers, as `struct` says them
SHORT, UNSPECIFIED, PALETTE = 3, 0, 3


def directory(stream: BinaryIO) -> tuple[str, dict[int, tuple[int, int, bytes]], dict[int, int]]:
    """Order of bytes; each tag's kind, count, and value or where it lies; and the first values of those that are whole.

    struct.error or ValueError where there is no directory.
    """
    stream.seek(0)
    order = "<" if stream.read(4)[:1] == b"I" else ">"
    stream.seek(struct.unpack(order + "I", stream.read(4))[0])
    (count,) = struct.unpack(order + "H", stream.read(2))
    listed = [struct.unpack(order + "HHI4s", stream.read(12)) for _ in range(count)]
    first = {tag: struct.unpack_from(order + WHOLE[kind], value)[0] for tag, kind, _, value in listed if kind in WHOLE}
    return order, {tag: (kind, many, value) for tag, kind, many, value in listed}, {SAMPLES: 1, COLORS: 1, **first}


def of_pixels_alone(content: bytes) -> bytes:
    """The same TIFF by a directory of `PIXELS` alone, with all of its channels named; as it is where that is its own.

    >>> one = struct.pack("<HHII", 256, 3, 1, 9)
    >>> written = b"II*\\0" + struct.pack("<IH", 8, 2) + one + struct.pack("<HHII", 40000, 3, 1, 7) + bytes(4)
    >>> of_pixels_alone(written)[8 + 2 + 2 * 12 + 4 :] == struct.pack("<H", 1) + one + bytes(4)
    True
    """
    try:
        order, entries, first = directory(BytesIO(content))
    except (struct.error, ValueError):
        return content
    kept = {tag: entry for tag, entry in entries.items() if tag in PIXELS}
    extra = first[SAMPLES] - OF_COLORS.get(first[COLORS], first[SAMPLES])
    if EXTRA not in kept and 0 < extra <= 2:  # as many as stand in the entry itself
        kept[EXTRA] = SHORT, extra, struct.pack(order + "HH", UNSPECIFIED, UNSPECIFIED)
    if kept == entries:
        return content
    end = len(content) + len(content) % 2
    written = [struct.pack(order + "HHI4s", tag, *kept[tag]) for tag in sorted(kept)]
    parts = [content[:4], struct.pack(order + "I", end), content[8:].ljust(end - 8, b"\0")]
    return b"".join([*parts, struct.pack(order + "H", len(kept)), *written, bytes(4)])
