"""A TIFF's directory without what its pixels do not need.

libtiff tells the terminal of each tag that it does not know, of each channel that the file does not name, and reads on.
"""

from __future__ import annotations

import struct

SAMPLES, COLORS, EXTRA = 277, 262, 338
PIXELS = frozenset(
    {*range(256, 260), COLORS, 266, 273, 274, SAMPLES, 278, 279, 284, 292, 293, 317, *range(320, 326), EXTRA, 339, 347}
    | {*range(512, 522), *range(529, 533)}
)
"""Tags of TIFF 6.0 that say how pixels lie in the file: size, depth, packing, strips, tiles, palette, subsampling."""
OF_COLORS = {0: 1, 1: 1, 2: 3, 3: 1, 5: 4, 6: 3, 8: 3}
"""Channels of each kind of colours; what is beyond them, transparency say, is extra."""
SHORT, UNSPECIFIED = 3, 0


def of_pixels_alone(content: bytes) -> bytes:
    """The same TIFF by a directory of `PIXELS` alone, with all of its channels named; as it is where that is its own.

    >>> one = struct.pack("<HHII", 256, 3, 1, 9)
    >>> written = b"II*\\0" + struct.pack("<IH", 8, 2) + one + struct.pack("<HHII", 40000, 3, 1, 7) + bytes(4)
    >>> of_pixels_alone(written)[8 + 2 + 2 * 12 + 4 :] == struct.pack("<H", 1) + one + bytes(4)
    True
    """
    order = "<" if content[:1] == b"I" else ">"
    try:
        (place,) = struct.unpack_from(order + "I", content, 4)
        (count,) = struct.unpack_from(order + "H", content, place)
        entries = {
            tag: (kind, many, value)
            for tag, kind, many, value in struct.iter_unpack(
                order + "HHI4s", content[place + 2 : place + 2 + 12 * count]
            )
        }
    except struct.error:
        return content
    kept = {tag: entry for tag, entry in entries.items() if tag in PIXELS}
    samples, colors = (
        struct.unpack_from(order + "H", entries[tag][2])[0] if tag in entries else 1 for tag in (SAMPLES, COLORS)
    )
    extra = samples - OF_COLORS.get(colors, samples)
    if EXTRA not in kept and 0 < extra <= 2:  # as many as stand in the entry itself
        kept[EXTRA] = SHORT, extra, struct.pack(order + "HH", UNSPECIFIED, UNSPECIFIED)
    if kept == entries:
        return content
    end = len(content) + len(content) % 2
    directory = [struct.pack(order + "HHI4s", tag, *kept[tag]) for tag in sorted(kept)]
    parts = [content[:4], struct.pack(order + "I", end), content[8:].ljust(end - 8, b"\0")]
    return b"".join([*parts, struct.pack(order + "H", len(kept)), *directory, bytes(4)])
