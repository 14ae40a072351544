"""Decoding pictures beside the time that OpenCV takes to read their files.

Nothing else reads a colour grid, and OpenCV's decoder of Gray codes (contrib) answers one pixel a call.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from time import process_time

import cv2
import numpy as np
from speed_rows import Row, compare, peer

from retrue import (
    GrayCode,
    decode,
    read_capture,
    read_folder,
    read_image,
    read_pattern,
    read_rig,
    recalibrate,
    write_png,
)
from retrue.geometry.arrays import Image
from retrue.patterns.pattern import Pattern
from retrue.rig import Rig

NAMES = ("wall_0", "textured_wall_0", "wall_objects_0", "corner_0", "dim_0")
LARGE = (4096, 3000)
LARGE_NOISE = 2.0  # levels: a picture without would be easy to read


def render_rows(renders: Path, scratch: Path, rounds: int, names: tuple[str, ...] = NAMES) -> Iterator[Row]:
    """Of each picture, of the first enlarged, and of the first from its file to a pose."""
    pattern = read_pattern(renders / "pattern.json")
    large = scratch / "large.png"
    write_png(large, enlarged(read_image(renders / f"{names[0]}.png")))
    for path in (*(renders / f"{name}.png" for name in names), large):
        image = read_image(path)
        height, width = image.shape[:2]
        count = len(decode(pattern, image))
        what = f"decoding {count} points of {path.name}, {width} x {height}: `decode`"
        reading = peer("OpenCV", "imread")
        yield from compare(
            what,
            partial(decode, pattern, image),
            {reading: partial(cv2.imread, str(path))},
            rounds,
            goals={reading: 1.0},
        )
    path, rig = renders / f"{names[0]}.png", read_rig(renders / f"{names[0]}.rig.json")
    yield from compare(
        f"from {path.name} to a pose, in one process",
        lambda: recalibrate(rig, [read_capture(path, pattern)]),
        {peer("OpenCV", "imread"): lambda: cv2.imread(str(path))},
        rounds,
    )


def enlarged(image: Image) -> Image:
    """As a camera of more pixels would see it, its own noise included."""
    width, height = LARGE
    scale = width / image.shape[1]
    smooth = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)[:height]
    noise = np.random.default_rng(0).normal(0, LARGE_NOISE, smooth.shape)
    return np.clip(np.round(smooth + noise), 0, 255).astype(np.uint8)


def sequence_rows(capture: Path, pattern_file: Path, rig_file: Path | None = None, *, rounds: int) -> Iterator[Row]:
    """Of a folder of pictures: decoded, by the clock and by what all its threads take; read, too; and to a pose."""
    pattern = read_pattern(pattern_file)
    pictures, paths = read_folder(capture)
    names = [path.name for path in paths]
    count = len(decode(pattern, pictures, names=names))
    height, width = pictures[0].shape[:2]
    kind = "Gray code" if isinstance(pattern, GrayCode) else f"{pattern_file.stem}"
    what = f"{kind}, {len(pictures)} pictures of {width} x {height}"
    name = peer("OpenCV", "imread, grey")
    reading = {name: lambda: [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in paths]}
    decoding = partial(decode, pattern, pictures, names=names)
    yield from compare(f"{what}: `decode`", decoding, reading, rounds, goals={name: 1.0})
    title = f"{what}: `decode`, processor time"
    yield from compare(title, decoding, reading, rounds, goals={name: 1.0}, clock=process_time)
    yield from compare(f"{what}: files to {count} points", lambda: read_capture(capture, pattern), reading, rounds)
    if rig_file is not None:
        rig = read_rig(rig_file)
        job = partial(_pose, rig, capture, pattern)
        yield from compare(f"{what}: files to a pose", job, reading, rounds)


def _pose(rig: Rig, capture: Path, pattern: Pattern) -> object:
    return recalibrate(rig, [read_capture(capture, pattern)])
