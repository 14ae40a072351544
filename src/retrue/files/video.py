"""Frames of a video file, a network stream or a camera, through OpenCV."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import cast

import numpy as np

from retrue.errors import FileError
from retrue.files.images import MAX_PIXELS
from retrue.geometry.arrays import Image
from retrue.video_stream import open_video

CONTAINERS = re.compile(
    rb"RIFF....AVI |....(ftyp|moov|mdat|wide|free|skip)|\x1a\x45\xdf\xa3|OggS|FLV|\0\0\x01[\xb3\xba]|G.{187}G",
    re.DOTALL,
)
"""How AVI, MP4 and MOV, Matroska and WebM, Ogg, Flash and MPEG files begin. A playlist is none: FFmpeg would
follow it to whatever files and hosts it names."""
SCHEMES = ("http", "https", "rtmp", "rtmps", "rtp", "rtsp", "rtsps", "srt", "tcp", "udp")


def is_stream(source: str) -> bool:
    """Whether this is the address of a stream.

    >>> is_stream("rtsp://camera.local/main"), is_stream("file:///etc/passwd"), is_stream("clip.avi")
    (True, False, False)
    """
    scheme, mark, _ = source.partition("://")
    return bool(mark) and scheme.lower() in SCHEMES


def read_video(source: Path | str | int, first: int = 0) -> Iterator[tuple[int, Image]]:
    """Number and picture (height, width, 3), red green blue, of each frame from number `first` on.

    Parameters
    ----------
    source : a file, the address of a stream, or the index of a camera; a stream's numbers start at `first`.

    Raises
    ------
    FileError
        no such file, no video, a camera that cannot be opened, or frames of more than 200 megapixels.
    """
    import cv2

    if isinstance(source, Path):
        _require_container(source)
    name = source if isinstance(source, Path) else Path(f"camera {source}" if isinstance(source, int) else source)
    capture = open_video(source if isinstance(source, int) else str(source))
    try:
        if not capture.isOpened():
            raise FileError(name, "cannot be opened as a video: is it there, and free?")
        width, height = (capture.get(key) for key in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        if not width * height <= MAX_PIXELS:
            raise FileError(
                name, f"expected frames of at most {MAX_PIXELS // 10**6} megapixels, found {width} x {height}"
            )
        number = first
        if isinstance(source, Path):
            number = 0
            while number < first and capture.grab():  # a seek would land on the nearest key frame
                number += 1
        while True:
            ok, picture = capture.read()
            if not ok:
                return
            yield number, np.ascontiguousarray(cast("Image", picture)[..., ::-1])
            number += 1
    finally:
        capture.release()


def _require_container(path: Path) -> None:
    try:
        with path.open("rb") as stream:
            start = stream.read(189)
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from error
    if not CONTAINERS.match(start):
        raise FileError(path, "expected a video: AVI, MP4, MOV, Matroska, WebM, Ogg or MPEG")
