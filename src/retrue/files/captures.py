"""A capture from disk: a picture, a folder of pictures, or a table of points."""

from __future__ import annotations

from pathlib import Path

from retrue.capture import Capture
from retrue.correspondences import Correspondences
from retrue.errors import CaptureError, FileError, require_kind, require_path
from retrue.files.image_header import read_image_header
from retrue.files.images import SUFFIXES, picture_paths, read_folder, read_image
from retrue.files.points import TABLES, read_points
from retrue.geometry.arrays import Image
from retrue.patterns.color_grid import ColorGrid
from retrue.patterns.gray_code import GrayCode
from retrue.patterns.line_grid import LineGrid
from retrue.patterns.pattern import PATTERNS, Pattern
from retrue.patterns.sequence import FrameSequence

GRID_PICTURES = ("grid", "white", "black")
"""What the folder of a colour or line grid holds."""


def read_capture(path: str | Path, pattern: Pattern | None = None) -> Correspondences:
    """Correspondences of a capture: decoded from pictures, or read from a points CSV.

    Parameters
    ----------
    path : a picture of a colour or line grid, a folder of pictures (of a Gray code or another sequence; or grid, white
        and black of a colour or line grid), or a CSV of points.
    pattern : what the projector showed; not needed for a CSV.

    Raises
    ------
    CaptureError
        the capture is not of the pattern's kind, or its pictures do not belong together or do not decode.
    FileError
        no such file, or one that cannot be read.
    """
    return load_capture(path, pattern, keep_photograph=False).points


def load_capture(path: str | Path, pattern: Pattern | None = None, *, keep_photograph: bool = True) -> Capture:
    """The same, with what else the files tell; a photograph takes memory, so keep those that will be shown."""
    path = require_path(path, "read_capture(path, pattern)")
    if pattern is not None:
        require_kind(pattern, PATTERNS, "pattern", "retrue.read_pattern reads one")
    if path.is_dir():
        points, photograph = _read_sequence(path, pattern)
    elif not path.exists():
        raise FileError(path, "no such file or folder")
    elif path.suffix.lower() in TABLES:
        return Capture(path.name, read_points(path), path=path)
    else:
        points, photograph = _read_grid(path, pattern)
    height, width = photograph.shape[:2]
    return Capture(path.name, points, photograph if keep_photograph else None, (width, height), path)


def pictures_size(path: Path) -> tuple[int, int] | None:
    """(width, height) of most pictures of a capture, from their headers; None of what is no picture and no folder.

    Raises `FileError` for pictures that cannot be read.
    """
    if path.is_dir():
        sizes = [read_image_header(picture).size for picture in picture_paths(path)]
        return max(set(sizes), key=sizes.count)
    if path.suffix.lower() not in SUFFIXES or not path.exists():
        return None
    return read_image_header(path).size


def _read_sequence(path: Path, pattern: Pattern | None) -> tuple[Correspondences, Image]:
    """The points, and the scene in white light."""
    if pattern is None:
        raise CaptureError(
            path, f"a folder of pictures needs the pattern that they show: give --pattern P.json; {_seems(path)}"
        )
    if isinstance(pattern, ColorGrid | LineGrid):
        return _read_grid_folder(path, pattern)
    from retrue.decoding.sequence.decode_sequence import decode_pictures

    images, paths = read_folder(path, color=_in_color(path, pattern))
    try:
        points, sequence = decode_pictures(pattern, images, [entry.name for entry in paths])
        return points, sequence.color
    except CaptureError as error:
        from retrue.decoding.sequence.diagnosis import shows_another_code

        problem = (
            f"the pattern is another code: {_seems(path)}" if shows_another_code(pattern, images) else error.problem
        )
        raise CaptureError(path, problem) from error


def _read_grid_folder(path: Path, pattern: ColorGrid | LineGrid) -> tuple[Correspondences, Image]:
    """The points of grid.png, with black.png and white.png beside it; and the picture."""
    from retrue.decoding.decode import NAMES, decode_picture

    named = {entry.stem: entry for entry in picture_paths(path)}
    if missing := [name for name in GRID_PICTURES if name not in named]:
        raise CaptureError(
            path,
            f"the pattern is a {NAMES[type(pattern)]}, whose folder holds grid.png, white.png and black.png: "
            f"{missing[0]}.png is missing; {_seems(path)}",
        )
    grid, white, black = (read_image(named[name]) for name in GRID_PICTURES)
    for name, image in (("white", white), ("black", black)):
        if image.shape != grid.shape:
            raise CaptureError(path, f"{name}.png is not of the size and kind of grid.png: take the capture again")
    return decode_picture(pattern, grid, black, white), grid


def _seems(path: Path) -> str:
    """What the pictures of a folder look like."""
    from retrue.decoding.sequence.diagnosis import looks_like

    return f"it holds {looks_like(read_folder(path)[0])}"


def _in_color(path: Path, pattern: GrayCode | FrameSequence) -> list[int]:
    """Which pictures of the folder may show the scene in white light."""
    if isinstance(pattern, GrayCode):
        return [0, pattern.picture_count - 2]
    names = [entry.name for entry in picture_paths(path)]
    from retrue.patterns.layouts import as_captured

    spec = as_captured(pattern, len(names))
    white = [index for index, frame in enumerate(spec.frames) if frame.code == "white"]
    return white if spec.files is None else [names.index(spec.files[k]) for k in white if spec.files[k] in names]


def _read_grid(path: Path, pattern: Pattern | None) -> tuple[Correspondences, Image]:
    """The points, and the picture."""
    if pattern is None:
        raise CaptureError(path, "a picture needs the pattern that it shows: give --pattern P.json")
    if not isinstance(pattern, ColorGrid | LineGrid):
        raise CaptureError(path, "one picture is the capture of a grid, but the pattern is a sequence: give its folder")
    from retrue.decoding.decode import decode_picture

    image = read_image(path)
    return decode_picture(pattern, image), image
