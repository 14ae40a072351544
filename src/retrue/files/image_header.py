"""Size and channels of a picture from its first bytes, before any memory is taken, and whether its parts are whole."""

from __future__ import annotations

import re
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from retrue.errors import FileError

PNG = b"\x89PNG\r\n\x1a\n"
JPEG = b"\xff\xd8"
TIFF = (b"II*\0", b"MM\0*")
MARKER = re.compile(rb"\xff[\x01-\xcf\xd8-\xfe]")  # among a JPEG's pixels: no stuffed zero, no restart, no fill byte
SCAN, END = 0xDA, 0xD9
SEGMENTS = frozenset({*range(0xC0, 0xD0), *range(0xDA, 0xF0), 0xFE})  # tables, frames, scans, what tools add
MOST_MARKERS = 10_000  # of a JPEG, before its picture; fill bytes count too


@dataclass(frozen=True, slots=True)
class ImageHeader:
    """size (width, height); channels 1 for grey, else 3 (or 4)."""

    size: tuple[int, int]
    channels: int


def read_image_header(path: Path) -> ImageHeader:
    """From a PNG, JPEG, BMP or TIFF file, told by its content; `FileError` for anything else."""
    try:
        with path.open("rb") as stream:
            start = stream.read(32)
            if start.startswith(PNG):
                return _png(start)
            if start.startswith(JPEG):
                return _jpeg(stream)
            if start.startswith(b"BM"):
                return _bmp(start)
            if start.startswith(TIFF):
                return _tiff(stream, "<" if start[:1] == b"I" else ">")
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from error
    except (struct.error, ValueError, KeyError, IndexError) as error:
        raise FileError(path, "not a picture that can be read: damaged or cut short") from error
    raise FileError(path, "not a picture: expected PNG, JPEG, BMP or TIFF")


def png_is_whole(content: bytes) -> bool:
    """Whether every chunk of a PNG file lies in it, and those that hold the picture are as they were written.

    OpenCV takes memory for what a chunk claims to hold, and libpng tells the terminal what it thinks of damaged ones.

    >>> png_is_whole(b"\\x89PNG\\r\\n\\x1a\\n" + b"\\xff\\0\\0\\0IDAT" + 8 * b"\\0")
    False
    """
    place = 8
    while place + 8 <= len(content):
        length, kind = struct.unpack_from(">I4s", content, place)
        checked, place = memoryview(content)[place + 4 : place + 8 + length], place + 12 + length
        if kind.isupper() and place <= len(content) and content[place - 4 : place] != _sum(checked):
            return False
        if kind == b"IEND":
            return place <= len(content)
    return False


def jpeg_scans(content: bytes, most: int) -> int:
    """How many scans a JPEG has, counted until they are more than `most`; 0 where its markers do not lead to its end.

    A JPEG has no checksums. But what was written over its pixels holds a marker after some 250 bytes, of a kind that
    none may have there, or of a part that no other follows; libjpeg tells the terminal of it, and reads on.

    >>> scan = b"\\xff\\xda\\0\\x08\\1" + bytes(5)
    >>> jpeg_scans(b"\\xff\\xd8" + scan + b"pixels\\xff\\0" + b"\\xff\\xd9", 9)
    1
    >>> jpeg_scans(b"\\xff\\xd8" + scan + b"pixels\\xff\\3" + b"\\xff\\xd9", 9)
    0
    """
    place, scans = 2, 0
    while scans <= most and (found := MARKER.search(content, place)):
        marker, start = content[found.end() - 1], found.end()
        if marker == END:
            return scans
        length = int.from_bytes(content[start : start + 2], "big")
        place = start + length
        if marker == SCAN:
            scans += 1
            follows = length == 6 + 2 * int.from_bytes(content[start + 2 : start + 3])  # two bytes for each colour
        else:  # before the pixels, tools that add something are believed
            follows = marker in SEGMENTS and not (scans and content[place : place + 1] != b"\xff")
        if not follows:
            return 0
    return scans if scans > most else 0


def _sum(chunk: memoryview) -> bytes:
    return zlib.crc32(chunk).to_bytes(4, "big")


def _png(start: bytes) -> ImageHeader:
    width, height, _, color_type = struct.unpack_from(">IIBB", start, 16)
    return ImageHeader((width, height), 1 if color_type in (0, 4) else 3)


def _bmp(start: bytes) -> ImageHeader:
    width, height, _, bits = struct.unpack_from("<iiHH", start, 18)
    return ImageHeader((width, abs(height)), 1 if bits < 8 else 3)


def _jpeg(stream: BinaryIO) -> ImageHeader:
    stream.seek(2)
    for _ in range(MOST_MARKERS):
        marker = stream.read(2)
        if len(marker) < 2 or marker[0] != 0xFF:
            raise ValueError("no marker")
        if marker[1] == 0xFF:  # a fill byte
            stream.seek(-1, 1)
            continue
        (length,) = struct.unpack(">H", stream.read(2))
        is_frame = 0xC0 <= marker[1] <= 0xCF and marker[1] not in (0xC4, 0xC8, 0xCC)
        if is_frame:
            _, height, width, channels = struct.unpack(">BHHB", stream.read(6))
            return ImageHeader((width, height), channels)
        stream.seek(length - 2, 1)
    raise ValueError("no frame")


def _tiff(stream: BinaryIO, order: str) -> ImageHeader:
    stream.seek(4)
    stream.seek(struct.unpack(order + "I", stream.read(4))[0])
    (count,) = struct.unpack(order + "H", stream.read(2))
    tags: dict[int, int] = {277: 1}
    for _ in range(count):
        tag, kind, _, value = struct.unpack(order + "HHI4s", stream.read(12))
        if kind in (3, 4):  # SHORT, LONG
            tags[tag] = struct.unpack_from(order + ("H" if kind == 3 else "I"), value)[0]
    palette = tags.get(262) == 3
    return ImageHeader((tags[256], tags[257]), 3 if palette else tags[277])
