"""A capture from disk: a picture, a folder of pictures, or a table of points."""

from __future__ import annotations

from pathlib import Path

from retrue.correspondences import Correspondences
from retrue.errors import CaptureError, FileError, require_kind, require_path
from retrue.files.images import read_folder, read_image
from retrue.patterns.color_grid import ColorGrid
from retrue.patterns.gray_code import GrayCode
from retrue.patterns.pattern import Pattern


def read_capture(path: str | Path, pattern: Pattern | None = None) -> Correspondences:
    """Correspondences of a capture: decoded from pictures, or read from a points CSV.

    Parameters
    ----------
    path : a picture of a colour grid, a folder of pictures of a Gray code, or a CSV of points.
    pattern : what the projector showed; not needed for a CSV.

    Raises
    ------
    CaptureError
        the capture is not of the pattern's kind, or its pictures do not belong together or do not decode.
    FileError
        no such file, or one that cannot be read.
    """
    path = require_path(path, "read_capture(path, pattern)")
    if pattern is not None:
        require_kind(pattern, (ColorGrid, GrayCode), "pattern", "retrue.read_pattern reads one")
    if path.is_dir():
        return _read_pictures(path, pattern)
    if not path.exists():
        raise FileError(path, "no such file or folder")
    if path.suffix.lower() == ".csv":
        from retrue.files.points import read_points

        return read_points(path)
    return _read_picture(path, pattern)


def _read_pictures(path: Path, pattern: Pattern | None) -> Correspondences:
    if pattern is None:
        raise CaptureError(path, "a folder of pictures needs the pattern that they show: give --pattern P.json")
    if not isinstance(pattern, GrayCode):
        raise CaptureError(path, "a folder of pictures is a Gray-code capture, but the pattern is a colour grid")
    from retrue.decoding.decode import decode

    images, paths = read_folder(path, color=(0, pattern.picture_count - 2))
    try:
        return decode(pattern, images, names=[entry.name for entry in paths])
    except CaptureError as error:
        raise CaptureError(path, error.problem) from error


def _read_picture(path: Path, pattern: Pattern | None) -> Correspondences:
    if pattern is None:
        raise CaptureError(path, "a picture needs the pattern that it shows: give --pattern P.json")
    if not isinstance(pattern, ColorGrid):
        raise CaptureError(
            path, "one picture is a colour-grid capture, but the pattern is a Gray code: give its folder"
        )
    from retrue.decoding.decode import decode

    image = read_image(path)
    try:
        return decode(pattern, image, names=[path.name])
    except CaptureError as error:
        raise CaptureError(path, error.problem) from error
