"""Size and channels of a picture from its first bytes, before any memory is taken, and whether its parts are whole."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from retrue.errors import FileError
from retrue.files.jpeg import frame
from retrue.files.tiff_directory import COLORS, HEIGHT, PALETTE, SAMPLES, WIDTH, directory

PNG = b"\x89PNG\r\n\x1a\n"
JPEG = b"\xff\xd8"
TIFF = (b"II*\0", b"MM\0*")


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
                return ImageHeader(*frame(stream))
            if start.startswith(b"BM"):
                return _bmp(start)
            if start.startswith(TIFF):
                return _tiff(stream)
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


def _sum(chunk: memoryview) -> bytes:
    return zlib.crc32(chunk).to_bytes(4, "big")


def _png(start: bytes) -> ImageHeader:
    width, height, _, color_type = struct.unpack_from(">IIBB", start, 16)
    return ImageHeader((width, height), 1 if color_type in (0, 4) else 3)


def _bmp(start: bytes) -> ImageHeader:
    width, height, _, bits = struct.unpack_from("<iiHH", start, 18)
    return ImageHeader((width, abs(height)), 1 if bits < 8 else 3)


def _tiff(stream: BinaryIO) -> ImageHeader:
    first = directory(stream)[2]
    return ImageHeader((first[WIDTH], first[HEIGHT]), 3 if first[COLORS] == PALETTE else first[SAMPLES])
