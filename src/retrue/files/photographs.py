"""Pairs of photographs from disk: what both cameras saw, matched."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from retrue.capture import Capture
from retrue.errors import CaptureError, FileError, require_kind, require_kinds
from retrue.files.image_header import read_image_header
from retrue.files.images import read_image
from retrue.files.pairs import Pair, stereo_pairs
from retrue.geometry.arrays import Image
from retrue.patterns.photographs import PHOTOGRAPHS, Photographs
from retrue.rasters import looks_like
from retrue.rig import Rig


@dataclass(frozen=True, slots=True, eq=False)
class PhotographPair:
    """A pair that was read: what the first camera took and what the second one did, and their matches."""

    left: Image
    right: Image
    capture: Capture
    paths: Pair


def find_pairs(paths: Sequence[str | Path], rig: Rig | None = None) -> list[Pair]:
    """The pairs of files that `stereo_pairs` makes of the paths, each of the size that the rig's cameras have.

    Raises
    ------
    InputError, CaptureError : no pairs; or photographs of another size than the camera's, as those of exchanged cameras
        may be. `FileError` of what is no picture.
    """
    require_kinds(paths, (str, Path), "paths")
    for path in map(Path, paths):
        if not path.exists():
            raise FileError(path, "no such file or folder")
    pairs = stereo_pairs([Path(path) for path in paths])
    if rig is not None:
        for pair in pairs:
            _check_sizes(pair, rig)
    return pairs


def read_photographs(
    paths: Sequence[str | Path], rig: Rig | None = None, asked: Photographs = PHOTOGRAPHS
) -> Iterator[PhotographPair]:
    """Each pair, read and matched when it is its turn; `find_pairs` tells what it raises."""
    require_kind(asked, Photographs, "asked")
    pairs = find_pairs(paths, rig)
    return (read_pair(pair, asked) for pair in pairs)


def read_pair(pair: Pair, asked: Photographs = PHOTOGRAPHS) -> PhotographPair:
    """One pair, read and matched."""
    from retrue.decoding.photographs.match_photographs import match_photographs

    left, right = (read_image(path) for path in pair)
    try:
        points = match_photographs(asked, left, right)
    except CaptureError as error:
        raise CaptureError(f"{pair[0]}, {pair[1]}", error.problem) from error
    height, width = left.shape[:2]
    name = f"{pair[0].name}, {pair[1].name}"
    if pair[0].name == pair[1].name:
        name = f"{pair[0].parent.name}/{pair[0].name}, {pair[1].parent.name}/{pair[1].name}"
    return PhotographPair(left, right, Capture(name, points, left, (width, height), pair[0]), pair)


def _check_sizes(pair: Pair, rig: Rig) -> None:
    """A `CaptureError` where a photograph is not of its camera's size."""
    sizes = [read_image_header(path).size for path in pair]
    expected = [rig.camera.size, rig.projector.size]
    for name, path, size, other in zip(("first", "second"), pair, sizes, expected, strict=True):
        if size == other:
            continue
        exchanged = sizes == expected[::-1]
        problem = "left and right are exchanged" if exchanged else looks_like(size, other)
        raise CaptureError(
            path,
            f"the photograph is {size[0]} x {size[1]}, those of the rig's {name} camera {other[0]} x {other[1]}: "
            f"{problem}; hand in each camera's own, as they were calibrated",
        )
