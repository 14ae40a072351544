"""Correspondences as arrays, bit for bit and soon: what a decoder found, until it is known what becomes of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast
from zipfile import BadZipFile

import numpy as np

from retrue.correspondences import OPTIONAL_COLUMNS, SIZES, Correspondences
from retrue.errors import FileError
from retrue.files.atomic import replaced_file


def keep_points(path: Path, points: Correspondences) -> None:
    """Write them, whole or not at all. Raises `FileError`."""
    names = ("camera_px", "projector_px", *OPTIONAL_COLUMNS, *SIZES)
    held: dict[str, Any] = {name: value for name in names if (value := getattr(points, name)) is not None}
    with replaced_file(path) as stream:
        np.savez(stream, **held)


def read_kept_points(path: Path) -> Correspondences:
    """What `keep_points` wrote. Raises `FileError`."""
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as held:
            arrays = cast("dict[str, Any]", dict(held))
        arrays |= {name: tuple(arrays[name].tolist()) for name in SIZES if name in arrays}
        return Correspondences(**arrays)
    except (OSError, ValueError, KeyError, TypeError, RuntimeError, BadZipFile, EOFError) as error:
        raise FileError(path, f"cannot be read: {error}; remove it to decode again") from error
