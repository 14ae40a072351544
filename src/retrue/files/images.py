"""Pictures from files and folders, and into PNG, which loses nothing."""

from __future__ import annotations

import re
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, cast

from retrue.errors import CaptureError, FileError, InputError, require_kind, require_kinds, require_path
from retrue.files.atomic import read_bytes, replaced_file
from retrue.files.image_header import JPEG, PNG, TIFF, ImageHeader, png_is_whole, read_image_header
from retrue.files.jpeg import whole_scans
from retrue.files.tiff_directory import of_pixels_alone

if TYPE_CHECKING:
    from retrue.geometry.arrays import Image

SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff"})
MAX_PIXELS = 200_000_000
MAX_PICTURES = 1000
MAX_FOLDER_PIXELS = 4_000_000_000
BYTES_A_PIXEL = 8  # at most, uncompressed
METADATA_BYTES = 2**26
MOST_PIXELS_A_BYTE = 10_000  # that any compression packs; beyond it most of the picture must be missing
MOST_SCANS = 500  # of a progressive JPEG; each makes the decoder go over all pixels, and takes ten bytes


def read_image(path: str | Path, *, grey: bool = False) -> Image:
    """A PNG, JPEG, BMP or TIFF picture, 8 or 16 bit.

    Parameters
    ----------
    path : the file; told by its content, not by its ending.
    grey : luminance only, which is quicker to read.

    Returns
    -------
    Image
        (height, width), or (height, width, 3) in the order red, green, blue; uint8 or uint16. Transparency
        is dropped, and no rotation that a camera noted beside the pixels is applied.

    Raises
    ------
    FileError
        no such file, not a picture, cut short, or larger than 200 megapixels (which it tells before any
        memory is taken).
    """
    path = require_path(path, "read_image(path)")
    return _decoded(path, _checked_header(path), grey)


def read_folder(path: str | Path, *, color: Sequence[int] = ()) -> tuple[list[Image], list[Path]]:
    """The pictures of a folder, by number rather than by letter: img2 before img10.

    Parameters
    ----------
    path : the folder; files with another ending than a picture's, and hidden ones, are left alone.
    color : positions (negative ones count from the end) of pictures to read in colour; all others are
        read as grey.

    Returns
    -------
    tuple
        the pictures, all of one size, and their paths.

    Raises
    ------
    CaptureError
        no such folder, no picture in it, or pictures of different sizes.
    FileError
        a picture that cannot be read.
    """
    folder = require_path(path, "read_folder(path)")
    require_kinds(color, Integral, "color")
    paths = picture_paths(folder)
    with ThreadPoolExecutor(2) as threads:
        headers = list(threads.map(_checked_header, paths))
        _require_one_size(folder, paths, [header.size for header in headers])
        width, height = headers[0].size
        if not len(paths) * width * height <= MAX_FOLDER_PIXELS:
            raise CaptureError(
                folder,
                f"expected one capture, found {len(paths)} pictures of {width} x {height} pixels: too much to hold",
            )
        in_color = {index % len(paths) for index in color if -len(paths) <= index < len(paths)}
        grey = [index not in in_color for index in range(len(paths))]
        images = list(threads.map(_decoded, paths, headers, grey))
    return images, paths


def natural_key(name: str) -> list[tuple[int, str]]:
    """Sorts names as people count: runs of digits by value.

    >>> sorted(["cam_10.png", "cam_9.png", "cam_09b.png"], key=natural_key)
    ['cam_9.png', 'cam_09b.png', 'cam_10.png']
    """
    parts = re.split(r"(\d+)", name.casefold())
    return [(int(part), "") if part.isdecimal() else (0, part) for part in parts]


def picture_paths(folder: Path) -> list[Path]:
    """The pictures of a folder, by number; raises as `read_folder` does."""
    try:
        entries = [entry for entry in folder.iterdir() if not entry.name.startswith(".")]
    except FileNotFoundError:
        raise CaptureError(folder, "no such folder") from None
    except OSError as error:
        raise CaptureError(folder, f"cannot be read as a folder: {error.strerror or error}") from error
    paths = [entry for entry in entries if entry.suffix.lower() in SUFFIXES and entry.is_file()]
    if not paths:
        folders = sorted(entry.name for entry in entries if entry.is_dir())
        instead = f", found {len(folders)} folders: hand those in, as {folder / folders[0]}" if folders else ""
        raise CaptureError(folder, f"no pictures in it: expected PNG, JPEG, BMP or TIFF files{instead}")
    if len(paths) > MAX_PICTURES:
        raise CaptureError(folder, f"expected one capture, found {len(paths)} pictures")
    return sorted(paths, key=lambda entry: (natural_key(entry.name), entry.name))


def _require_one_size(folder: Path, paths: Sequence[Path], sizes: Sequence[tuple[int, int]]) -> None:
    usual = max(set(sizes), key=sizes.count)
    odd = [(entry.name, size) for entry, size in zip(paths, sizes, strict=True) if size != usual]
    if odd:
        (name, (width, height)), more = odd[0], f" (and {len(odd) - 1} more)" if len(odd) > 1 else ""
        raise CaptureError(
            folder,
            f"{name}{more} is {width} x {height} pixels, the others {usual[0]} x {usual[1]}: take it again, or out of "
            "the folder if it is no picture of the capture",
        )


def _checked_header(path: Path) -> ImageHeader:
    header = read_image_header(path)
    width, height = header.size
    if not 0 < width * height <= MAX_PIXELS:
        raise FileError(
            path, f"expected a picture of at most {MAX_PIXELS // 10**6} megapixels, found {width} x {height}"
        )
    return header


def _decoded(path: Path, header: ImageHeader, grey: bool) -> Image:
    import cv2
    import numpy as np

    flags = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    flags |= cv2.IMREAD_GRAYSCALE if grey or header.channels == 1 else cv2.IMREAD_COLOR
    content = read_bytes(path, BYTES_A_PIXEL * header.size[0] * header.size[1] + METADATA_BYTES)
    too_short = header.size[0] * header.size[1] > MOST_PIXELS_A_BYTE * len(content)
    if content.startswith(JPEG):
        if (scans := whole_scans(content, MOST_SCANS)) > MOST_SCANS:
            raise FileError(path, f"expected a JPEG of at most {MOST_SCANS} scans, found more")
        whole = scans > 0
    else:
        whole = not content.startswith(PNG) or png_is_whole(content)
    if too_short or not whole:
        raise FileError(path, "not a picture that can be read: damaged or cut short")
    if content.startswith(TIFF):
        content = of_pixels_alone(content)
    try:
        image = cast("Image | None", cv2.imdecode(np.frombuffer(content, dtype=np.uint8), flags))
    except cv2.error as error:
        raise FileError(path, f"not a picture that can be read: {error.err}") from error
    if image is None or image.shape[:2] != header.size[::-1]:
        raise FileError(path, "not a picture that can be read: damaged or cut short")
    if image.dtype.name not in ("uint8", "uint16"):
        raise FileError(path, f"expected 8 or 16 bits a channel, found {image.dtype}")
    return image if image.ndim == 2 else np.ascontiguousarray(image[..., ::-1])


def jpeg(image: Image, quality: int = 85) -> bytes:
    """A grey or red-green-blue picture as JPEG, for whoever only looks at it."""
    import cv2
    import numpy as np

    levels = image if image.dtype.name == "uint8" else (image // 257).astype(np.uint8)
    _, content = cv2.imencode(
        ".jpg",
        levels if levels.ndim == 2 else cv2.cvtColor(levels, cv2.COLOR_RGB2BGR),
        [cv2.IMWRITE_JPEG_QUALITY, quality],
    )
    return content.tobytes()


def write_png(path: str | Path, image: Image) -> None:
    """Write a grey or red-green-blue picture, uint8 or uint16, whole or not at all; every pixel reads back as it is.

    Raises
    ------
    InputError : not such an array. `FileError` : the file cannot be written.
    """
    import cv2
    import numpy as np

    path = require_path(path, "write_png(path, image)")
    require_kind(image, np.ndarray, "image")
    grey = image.ndim == 2
    if not (image.size and image.dtype.name in ("uint8", "uint16") and (grey or image.shape[2:] == (3,))):
        raise InputError(f"picture: expected grey or RGB of uint8 or uint16, found {image.shape} of {image.dtype}")
    _, content = cv2.imencode(".png", image if grey else cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    with replaced_file(path) as stream:
        stream.write(content.tobytes())
