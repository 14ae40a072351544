"""A capture on disk: a folder of PNG pictures, there whole or not at all."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Collection, Mapping
from pathlib import Path

from retrue.errors import FileError
from retrue.files.atomic import sync_folder
from retrue.files.images import SUFFIXES, natural_key, write_png
from retrue.geometry.arrays import Image


def write_capture(folder: str | Path, pictures: Mapping[str, Image]) -> None:
    """Write each picture as NAME.png into a new folder; one that holds anything already is left alone.

    Raises
    ------
    FileError
        the folder is not empty, or cannot be written: then nothing is left of it.
    """
    folder = Path(folder)
    require_new_folder(folder)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        waiting = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", suffix=".part", dir=folder.parent))
    except OSError as error:
        raise FileError(folder, f"cannot be written: {error.strerror or error}") from error
    try:
        for name, picture in pictures.items():
            write_png(waiting / f"{name}.png", picture)
        waiting.chmod(0o755)
        if folder.exists():
            folder.rmdir()
        waiting.rename(folder)
        sync_folder(folder.parent)
    except FileError as error:
        raise FileError(folder, f"cannot be written, {error.path.name} {error.problem}") from error
    except OSError as error:
        raise FileError(folder, f"cannot be written: {error.strerror or error}") from error
    finally:
        shutil.rmtree(waiting, ignore_errors=True)


def require_new_folder(folder: Path) -> None:
    """A `FileError` where there is something already."""
    if folder.is_dir() and any(folder.iterdir()):
        raise FileError(folder, "is not empty: a capture is written into a folder of its own; give another one")
    if folder.exists() and not folder.is_dir():
        raise FileError(folder, "expected a folder for the pictures, found a file")


def require_no_other_pictures(folder: Path, names: Collection[str]) -> None:
    """A `FileError` where pictures of other names lie in it already: who reads the folder has these too."""
    if not folder.is_dir():
        return
    others = [path.name for path in folder.iterdir() if path.suffix.lower() in SUFFIXES and path.name not in names]
    if others:
        first, more = min(others, key=natural_key), f" and {len(others) - 1} more" if len(others) > 1 else ""
        raise FileError(
            folder, f"holds pictures of something else, {first}{more}: give another folder, or move them away"
        )
