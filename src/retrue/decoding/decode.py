"""From pictures to correspondences, whichever pattern they show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib import import_module

import numpy as np

from retrue.correspondences import Correspondences
from retrue.errors import InputError, require_kind, require_kinds
from retrue.geometry.arrays import Image
from retrue.patterns.color_grid import ColorGrid
from retrue.patterns.line_grid import LineGrid
from retrue.patterns.pattern import PATTERNS, Pattern
from retrue.patterns.photographs import Photographs

GOOD_COUNT = 30  # points that a job can work with; with fewer, it is asked whether another pattern is there
NAMES = {ColorGrid: "colour grid", LineGrid: "line grid"}


def decode(
    pattern: Pattern | Photographs, images: Image | Sequence[Image], *, names: Sequence[str] | None = None
) -> Correspondences:
    """Match camera pixels with projector pixels, or the pixels of two cameras.

    Parameters
    ----------
    pattern : what the projector showed; `PHOTOGRAPHS` where nothing was.
    images : colour or line grid: the picture of it, then optionally a black and a white one of the same scene.
        Gray code: all pictures in the pattern's order, white and black last, first or left out.
        Sequence: the pictures of its frames.
        Photographs: the first camera's and the second's, whose sizes may differ.
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
    require_kind(pattern, (*PATTERNS, Photographs), "pattern", "retrue.read_pattern reads one")
    pictures = [images] if isinstance(images, np.ndarray) else images
    require_kinds(pictures, np.ndarray, "images", "retrue.read_image reads one, and retrue.read_capture decodes files")
    if isinstance(pattern, Photographs):
        from retrue.decoding.photographs.match_photographs import match_photographs

        if len(pictures) != 2:
            raise InputError(f"photographs: expected two, one of each camera, found {len(pictures)}")
        return match_photographs(pattern, *pictures)
    if not isinstance(pattern, ColorGrid | LineGrid):
        from retrue.decoding.sequence.decode_sequence import decode_sequence

        return decode_sequence(pattern, pictures, names)
    if not 1 <= len(pictures) <= 3:
        raise InputError(
            f"{NAMES[type(pattern)]}: expected its picture, and at most a black and a white one, "
            f"found {len(pictures)} pictures"
        )
    return decode_picture(pattern, *pictures)


def decode_picture(
    pattern: ColorGrid | LineGrid, image: Image, black: Image | None = None, white: Image | None = None
) -> Correspondences:
    """The same of one picture; where it shows the other kind of grid, the card says so."""
    if isinstance(pattern, LineGrid):
        from retrue.decoding.lines.decode_line_grid import decode_line_grid

        points = decode_line_grid(pattern, image, black, white)
    else:
        from retrue.decoding.blocks.decode_color_grid import decode_color_grid

        points = decode_color_grid(pattern, image, black, white)
    if points.card is None or len(points) >= GOOD_COUNT:
        return points
    from retrue.decoding.recognise import what_it_shows

    shown, expected = what_it_shows(image), type(pattern)
    if shown is None or shown is expected:
        return points
    advice = f"the picture shows a {NAMES[shown]}, the pattern is a {NAMES[expected]}: give the pattern that was shown"
    return replace(points, card=replace(points.card, advice=(advice,)))


def import_decoder(pattern: Pattern) -> None:
    """Import what `decode` needs for such a pattern, as it otherwise does at its first call."""
    names: dict[type, str] = {
        ColorGrid: "blocks.decode_color_grid",
        LineGrid: "lines.decode_line_grid",
    }
    name = names.get(type(pattern), "sequence.decode_sequence")
    import_module(f"retrue.decoding.{name}")
