"""What a word names that frames come from: a folder, a video, a stream, a camera."""

from __future__ import annotations

import os
from pathlib import Path

from retrue.errors import FileError, InputError
from retrue.files.images import SUFFIXES
from retrue.files.pairs import sides_of
from retrue.files.patterns import read_pattern
from retrue.files.video import is_stream
from retrue.patterns.color_grid import ColorGrid
from retrue.patterns.gray_code import GrayCode
from retrue.patterns.line_grid import LineGrid
from retrue.patterns.pattern import Pattern
from retrue.rasters import check_pattern
from retrue.rig import Rig
from retrue.watch.folder import FolderSource
from retrue.watch.frame import Position, Source
from retrue.watch.options import WatchOptions
from retrue.watch.pairs import PairedSource
from retrue.watch.video import VideoSource


def source_name(source: str) -> str:
    """Under one name however it was called, so that a later start knows it again."""
    return source if not Path(source).exists() else os.path.realpath(source)


def open_source(source: str, has_pattern: bool, limits: WatchOptions, position: Position) -> Source:
    """The source, to go on at that position. Raises `FileError`, `InputError`."""
    path = Path(source)
    if path.is_dir():
        return FolderSource(path, limits, position)
    if not has_pattern:
        raise InputError("a video needs the pattern that it shows: give --pattern P.json")
    if source.isdecimal() and not path.exists():
        return VideoSource(int(source[:9]), position)
    if is_stream(source):
        return VideoSource(source, position)
    if not path.exists():
        raise FileError(path, "expected a folder, a video, the address of a stream or the index of a camera")
    if path.suffix.lower() in SUFFIXES:
        raise FileError(path, "one picture is no stream: give the folder that it lies in")
    return VideoSource(path, position)


def open_pair(sources: tuple[str, str | None], limits: WatchOptions, position: Position) -> Source:
    """The frames of two cameras: two sources, or one folder that holds a folder of each. Raises as `open_source`."""
    first, second = sources
    if second is None:
        folder = Path(first)
        sides = sides_of(folder) if folder.is_dir() else None
        if sides is None:
            raise InputError(f"{first}: expected two sources, or a folder that holds a folder of each camera")
        first, second = map(str, sides)
    opened = [
        FolderSource(Path(source), limits, position.get(side, {}), suffixes=SUFFIXES)
        if Path(source).is_dir()
        else open_source(source, True, limits, position.get(side, {}))
        for side, source in (("first", first), ("second", second))
    ]
    return PairedSource(opened[0], opened[1])


def open_pattern(rig: Rig, path: Path | None) -> Pattern | None:
    """What single pictures show, and of this rig's projector. Raises `FileError`."""
    if path is None:
        return None
    pattern = read_pattern(path)
    if not isinstance(pattern, ColorGrid | LineGrid):
        found = "a Gray code" if isinstance(pattern, GrayCode) else "a sequence"
        raise FileError(path, f"a watch reads single pictures: expected a colour or line grid, found {found}")
    check_pattern(rig, pattern.projector_size, path)
    return pattern
