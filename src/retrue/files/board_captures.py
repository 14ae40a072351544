"""A capture of the calibration board from disk."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from retrue.calibration.views import BoardCapture
from retrue.errors import CaptureError
from retrue.files.images import read_folder
from retrue.patterns.gray_code import GrayCode
from retrue.patterns.pattern import Pattern


def read_board_capture(path: str | Path, pattern: Pattern) -> BoardCapture:
    """One pose of the board: a folder of a Gray code, or of two pictures, lit white and by the colour grid.

    Raises `CaptureError` for pictures that do not belong together or do not decode, `FileError` for files that
    cannot be read.
    """
    from retrue.decoding.decode import decode
    from retrue.decoding.gray_sequence import arrange

    path = Path(path)
    if not path.is_dir():
        raise CaptureError(path, "expected a folder with the pictures of one pose of the board")
    try:
        if isinstance(pattern, GrayCode):
            images, paths = read_folder(path)
            names = [entry.name for entry in paths]
            return BoardCapture(str(path), arrange(pattern, images, names).white, decode(pattern, images, names=names))
        images, paths = read_folder(path, color=(0, 1))
        if len(images) != 2:
            raise CaptureError(path, f"expected two pictures, lit white and by the colour grid, found {len(images)}")
        white = int(np.argmax([float(image.mean()) for image in images]))  # the grid is mostly black
        grid = 1 - white
        return BoardCapture(str(path), images[white], decode(pattern, images[grid], names=[paths[grid].name]))
    except CaptureError as error:
        raise CaptureError(path, error.problem) from error
