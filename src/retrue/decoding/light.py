"""Where a picture still tells how bright it was."""

from __future__ import annotations

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray, Image

FULL = 0.99
"""Of full scale: from there on a sensor may have seen any more light; JPEG leaves 255 a little below itself."""


def saturated(pixels: Image) -> BoolArray:
    """(N,) where any channel of `pixels`, (N,) or (N, channels), is at its end."""
    end = pixels >= FULL * np.iinfo(pixels.dtype).max
    return end if end.ndim == 1 else end[:, 0] | end[:, 1] | end[:, 2]


def around(picture: Image, centre_px: FloatArray) -> Image:
    """(N, 9, channels) the pixels about each (x, y) of `centre_px`, all inside the picture (h, w, channels)."""
    column, row = np.round(centre_px).astype(np.int64).T
    down, right = (offset.ravel() for offset in np.mgrid[-1:2, -1:2])
    rows = np.clip(row[:, None] + down, 0, picture.shape[0] - 1)
    columns = np.clip(column[:, None] + right, 0, picture.shape[1] - 1)
    return picture[rows, columns]
