"""A picture in an OpenGL window, byte for byte: drawn as it is, with no texture that could be filtered."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retrue.devices.protocols import Size

GL_UNPACK_ALIGNMENT = 0x0CF5
GL_RGB, GL_UNSIGNED_BYTE = 0x1907, 0x1401
GL_DITHER = 0x0BD0
_Int, _Float, _Pointer = ctypes.c_int, ctypes.c_float, ctypes.c_void_p
SIGNATURES: dict[str, tuple[Any, ...]] = {
    "glViewport": (_Int, _Int, _Int, _Int),
    "glDisable": (_Int,),
    "glPixelStorei": (_Int, _Int),
    "glPixelZoom": (_Float, _Float),
    "glRasterPos2f": (_Float, _Float),
    "glDrawPixels": (_Int, _Int, _Int, _Int, _Pointer),
    "glFinish": (),
}


class GlPicture:
    """Of the context that is current. `address` finds OpenGL's functions by name."""

    def __init__(self, address: Callable[[str], int], size: Size) -> None:
        self._size = size
        self._call = {name: ctypes.CFUNCTYPE(None, *kinds)(address(name)) for name, kinds in SIGNATURES.items()}
        self._call["glDisable"](GL_DITHER)
        self._call["glPixelStorei"](GL_UNPACK_ALIGNMENT, 1)

    def draw(self, picture: NDArray[np.uint8]) -> None:
        """(h, w, 3), its first row on top, into the back buffer."""
        width, height = self._size
        self._call["glViewport"](0, 0, width, height)
        self._call["glRasterPos2f"](-1.0, 1.0)
        self._call["glPixelZoom"](1.0, -1.0)
        self._call["glDrawPixels"](width, height, GL_RGB, GL_UNSIGNED_BYTE, picture.ctypes.data)

    def finish(self) -> None:
        """Wait until all is done."""
        self._call["glFinish"]()
