"""The colour grid of the paper: coloured square blocks on black, every window unique."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ColorGrid:
    """A colour grid, as a spec; the centre of block (r, c) lies at projector pixel origin + pitch * (c, r).

    Attributes
    ----------
    projector_size : (width, height).
    colors : red, green, blue, 0 .. 255, of each colour.
    pitch, block : distance between block centres, and side of a block, in projector pixels.
    origin : projector pixel (x, y) of the centre of block (0, 0).
    code : rows of indices into `colors`.
    """

    projector_size: tuple[int, int]
    colors: tuple[tuple[int, int, int], ...]
    pitch: float
    block: float
    origin: tuple[float, float]
    code: tuple[tuple[int, ...], ...]
