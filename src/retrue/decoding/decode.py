"""From pictures to correspondences, whichever pattern they show."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module

import numpy as np

from retrue.correspondences import Correspondences
from retrue.errors import InputError, require_kind, require_kinds
from retrue.geometry.arrays import Image
from retrue.patterns.color_grid import ColorGrid
from retrue.patterns.pattern import PATTERNS, Pattern


def decode(pattern: Pattern, images: Image | Sequence[Image], *, names: Sequence[str] | None = None) -> Correspondences:
    """Match camera pixels with projector pixels.

    Parameters
    ----------
    pattern : what the projector showed.
    images : colour grid: the picture of it, then optionally a black and a white one of the same scene.
        Gray code: all pictures in the pattern's order, white and black last, first or left out.
        Sequence: the pictures of its frames.
        Each (height, width) or (height, width, 3), red green blue, uint8 or uint16.
    names : of the pictures, for messages; "picture 3" where not given.

    Returns
    -------
    Correspondences
        camera and projector pixels, only valid ones; one projector coordinate where a sequence shows one axis. Its
        `card` tells what was left out and why.

    Raises
    ------
    CaptureError
        the pictures do not belong together or do not show this pattern; names the picture.
    """
    require_kind(pattern, PATTERNS, "pattern", "retrue.read_pattern reads one")
    pictures = [images] if isinstance(images, np.ndarray) else images
    require_kinds(pictures, np.ndarray, "images", "retrue.read_image reads one, and retrue.read_capture decodes files")
    if not isinstance(pattern, ColorGrid):
        from retrue.decoding.sequence.decode_sequence import decode_sequence

        return decode_sequence(pattern, pictures, names)
    if not 1 <= len(pictures) <= 3:
        raise InputError(
            f"colour grid: expected its picture, and at most a black and a white one, found {len(pictures)} pictures"
        )
    from retrue.decoding.blocks.decode_color_grid import decode_color_grid

    return decode_color_grid(pattern, *pictures)


def import_decoder(pattern: Pattern) -> None:
    """Import what `decode` needs for such a pattern, as it otherwise does at its first call."""
    name = "blocks.decode_color_grid" if isinstance(pattern, ColorGrid) else "sequence.decode_sequence"
    import_module(f"retrue.decoding.{name}")
