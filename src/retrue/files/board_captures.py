"""Captures of the calibration board from disk."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from retrue.calibration.board import Board
from retrue.calibration.board_capture import see_board
from retrue.calibration.views import BoardCapture, Progress, picture_size
from retrue.correspondences import Correspondences
from retrue.errors import CaptureError, FileError, require_kind, require_kinds, require_path
from retrue.files.images import SUFFIXES, picture_paths, read_folder, read_image
from retrue.files.points import TABLES, read_points
from retrue.patterns.color_grid import ColorGrid
from retrue.patterns.line_grid import LineGrid
from retrue.patterns.pattern import PATTERNS, Pattern
from retrue.rasters import check_pixels


def read_board_captures(
    paths: Sequence[str | Path],
    pattern: Pattern | None,
    board: Board,
    progress: Progress = lambda message: None,
) -> list[BoardCapture]:
    """Several poses, two at a time; raises as `read_board_capture` does. `progress` is told from any thread."""
    require_kinds(paths, (str, Path), "paths")

    def read(path: str | Path) -> BoardCapture:
        progress(f"reading {Path(path).name}")
        return read_board_capture(path, pattern, board)

    with ThreadPoolExecutor(2) as threads:
        return list(threads.map(read, paths))


def read_board_capture(path: str | Path, pattern: Pattern | None, board: Board) -> BoardCapture:
    """One pose of the board: the pictures of a sequence, two of a grid, or a picture with decoded points.

    Parameters
    ----------
    path : a folder of a Gray code or another sequence; of two pictures, lit white and by the grid; of one
        picture of the board and a points CSV; or such a picture or CSV, the other one beside it by the same name. Of a
        sequence only the part around the board is decoded; where there is no board, nothing is.
    pattern : what the projector showed; not needed for points.

    Raises
    ------
    CaptureError : pictures that do not belong together or do not decode.
    FileError : files that cannot be read.
    """
    path = require_path(path, "read_board_capture(path, pattern, board)")
    if pattern is not None:
        require_kind(pattern, PATTERNS, "pattern", "retrue.read_pattern reads one")
    require_kind(board, Board, "board", "retrue.parse_board makes one of such a text")
    files = picture_with_points(path)
    if files is not None:
        return _with_points(path, *files)
    if not path.is_dir():
        raise CaptureError(
            path,
            "expected a folder with the pictures of one pose of the board, or a picture with a points CSV of the same "
            "name beside it",
        )
    if pattern is None:
        raise CaptureError(path, "pictures of a projected code need the pattern that they show: give --pattern P.json")
    images, paths = read_folder(path, color=(0, 1) if isinstance(pattern, ColorGrid | LineGrid) else ())
    try:
        return see_board(str(path), pattern, images, [entry.name for entry in paths], board)
    except CaptureError as error:
        raise CaptureError(path, error.problem) from error


def picture_with_points(path: Path) -> tuple[Path, Path] | None:
    """The picture of the board and the points CSV, where the capture is made of these; else None."""
    if path.is_dir():
        tables = sorted(entry for entry in path.iterdir() if entry.suffix.lower() == ".csv")
        if not tables:
            return None
        pictures = picture_paths(path)
        if len(tables) != 1 or len(pictures) != 1:
            raise CaptureError(
                path,
                f"expected one picture of the board and one points CSV, found {len(pictures)} pictures and "
                f"{len(tables)} CSVs",
            )
        return pictures[0], tables[0]
    if path.suffix.lower() in TABLES:
        beside = [path.with_suffix(suffix) for suffix in sorted(SUFFIXES | {suffix.upper() for suffix in SUFFIXES})]
        picture = next((entry for entry in beside if entry.is_file()), None)
        if picture is None:
            raise CaptureError(path, "expected the picture of the board beside it, by the same name, found none")
        return picture, path
    if path.suffix.lower() in SUFFIXES and (table := path.with_suffix(".csv")).is_file():
        return path, table
    return None


def _with_points(path: Path, picture: Path, table: Path) -> BoardCapture:
    image, points = read_image(picture, grey=True), read_points(table)
    size = picture_size(image)
    _require_within(table, picture, points, size)
    return BoardCapture(str(path), image, points)


def _require_within(table: Path, picture: Path, points: Correspondences, size: tuple[int, int]) -> None:
    """The points are of that picture, as far as can be told."""
    if points.camera_size is not None and points.camera_size != size:
        width, height = points.camera_size
        raise FileError(
            table, f"the points are of pictures of {width} x {height}, {picture.name} is {size[0]} x {size[1]}"
        )
    check_pixels("camera", size, points.camera_px, table)
    if points.projector_size is not None:
        check_pixels("projector", points.projector_size, points.projector_px[:, points.axes], table)
    beyond = (points.camera_px < -0.5) | (points.camera_px > [size[0] - 0.5, size[1] - 0.5])
    if beyond.any():
        exchanged = size[0] != size[1] and not (points.camera_px[:, ::-1] > [size[0] - 0.5, size[1] - 0.5]).any()
        asked = ": are x and y exchanged?" if exchanged and not (points.camera_px < -0.5).any() else ""
        raise FileError(
            table, f"{int(beyond.any(axis=1).sum())} points lie outside {picture.name}, {size[0]} x {size[1]}{asked}"
        )
