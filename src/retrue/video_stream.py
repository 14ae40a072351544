"""A camera, a video or a network stream is opened by OpenCV, without a word of its own or of FFmpeg's."""

from __future__ import annotations

import os
from typing import Any

QUIET = "-8"  # of FFmpeg's log levels; it is read once in a process, when the first video is opened


def open_video(source: int | str, opening_ms: int = 30_000, reading_ms: int = 30_000) -> Any:
    """`cv2.VideoCapture` of a camera's index, a file or an address; whether it is open is for the caller to ask.

    What is wrong is said by us, in one sentence, and not by OpenCV and FFmpeg once more at each try.

    Parameters
    ----------
    opening_ms, reading_ms : for a stream to answer, and to send a frame.
    """
    import cv2

    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", QUIET)
    logging = cv2.utils.logging
    level = logging.getLogLevel()
    logging.setLogLevel(logging.LOG_LEVEL_SILENT)
    try:
        if isinstance(source, int):
            return cv2.VideoCapture(source)
        timeouts = cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, opening_ms, cv2.CAP_PROP_READ_TIMEOUT_MSEC, reading_ms
        return cv2.VideoCapture(source, cv2.CAP_FFMPEG, timeouts)
    finally:
        logging.setLogLevel(level)
