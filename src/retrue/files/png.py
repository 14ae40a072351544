"""Pictures out: PNG, which loses nothing."""

from __future__ import annotations

from pathlib import Path

from retrue.errors import InputError
from retrue.files.atomic import replaced_file
from retrue.geometry.arrays import Image


def write_png(path: str | Path, image: Image) -> None:
    """Write a grey or red-green-blue picture, uint8 or uint16, whole or not at all; every pixel reads back as it is.

    Raises
    ------
    InputError : not such an array. `FileError` : the file cannot be written.
    """
    import cv2

    grey = image.ndim == 2
    if not (image.size and image.dtype.name in ("uint8", "uint16") and (grey or image.shape[2:] == (3,))):
        raise InputError(f"picture: expected grey or RGB of uint8 or uint16, found {image.shape} of {image.dtype}")
    _, content = cv2.imencode(".png", image if grey else cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    with replaced_file(path) as stream:
        stream.write(content.tobytes())
