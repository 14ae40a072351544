"""Which picture of a sequence shows what: pictures beside the frames that they are of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import pairwise
from typing import cast

import cv2
import numpy as np

from retrue.decoding.gray.faults import (
    CAPTURE,
    are_complements,
    ends_with_white_and_black,
    explain_count,
    missing_numbers,
    require_complements,
    require_light,
)
from retrue.errors import CaptureError, InputError
from retrue.geometry.arrays import Cut, Image
from retrue.patterns.gray_code import GrayCode
from retrue.patterns.layouts import as_captured, sequence_of
from retrue.patterns.sequence import Frame, FrameSequence

MOST_TO_SUM = 257
"""Pictures of 8 bits, in 16."""
COARSE_BITS = 2
"""Of each axis: their patterns and inverses show every pixel lit and dark."""


@dataclass(frozen=True, slots=True, eq=False)
class ArrangedSequence:
    """The pictures by what they show, all grey, of one size and type.

    Attributes
    ----------
    spec : the frames, one for each picture.
    pictures, names : of the frames.
    white, black : of the scene; made from the coarsest bits where the capture has none, or, of sines alone, the mean
        over a turn for both.
    color : the white picture as it came, for the colours of the points.
    thorough : whether every pixel is read as deep as it resolves, even where most resolve the finest stripes.
    """

    spec: FrameSequence
    pictures: list[Image]
    names: list[str]
    white: Image
    black: Image
    color: Image
    thorough: bool = True

    def part(self, rows: Cut, columns: Cut) -> ArrangedSequence:
        """The same rows and columns of every picture."""
        pictures = [image[rows, columns] for image in self.pictures]
        white, black, color = (image[rows, columns] for image in (self.white, self.black, self.color))
        return replace(self, pictures=pictures, white=white, black=black, color=color)


def arrange(pattern: GrayCode | FrameSequence, images: Sequence[Image], names: Sequence[str]) -> ArrangedSequence:
    """Sort the pictures by what they show.

    Of a Gray code: pairs in the pattern's order; white and black last, first or absent. Of a sequence: as its frames
    say; of a common layout, columns alone are taken, too.

    Raises `CaptureError` where their number, size or content does not fit, and names the picture.
    """
    if len(names) != len(images):
        raise InputError(f"names: expected one for each of {len(images)} pictures, found {len(names)}")
    _require_alike(images, names)
    if isinstance(pattern, GrayCode):
        return _arrange_gray_code(pattern, images, names)
    spec = as_captured(pattern, len(images))
    if spec.files is not None:
        order = _order(spec.files, names)
        images, names = [images[index] for index in order], [names[index] for index in order]
    if len(images) != spec.picture_count:
        from retrue.decoding.sequence.diagnosis import found_instead

        raise CaptureError(CAPTURE, f"expected {_asked(spec)}, found {found_instead(spec, images, names)}")
    grey = [_grey(image) for image in images]
    require_light(grey)
    white, black, color = scene_lights(spec, images, grey)
    return ArrangedSequence(spec, grey, list(names), white, black, color)


def require_all_numbers(pattern: GrayCode | FrameSequence, names: Sequence[str]) -> None:
    """Raise where the files' numbers say which pictures of a sequence are missing: the rest may fit another count."""
    if isinstance(pattern, GrayCode) or pattern.files is not None:
        return
    if gap := missing_numbers(names, pattern.picture_count):
        raise CaptureError(CAPTURE, f"expected {_asked(pattern)}, found {len(names)} pictures: {gap}")


def frames_of(pattern: GrayCode | FrameSequence, count: int) -> tuple[Frame, ...] | None:
    """What so many pictures are expected to show, in order; None where another number is expected."""
    if isinstance(pattern, GrayCode):
        frames = sequence_of(pattern).frames
        return frames if count == len(frames) else frames[:-2] if count == len(frames) - 2 else None
    spec = as_captured(pattern, count)
    return spec.frames if count == spec.picture_count else None


def pair_starts(frames: Sequence[Frame]) -> list[int]:
    """Where pattern and inverse of one bit follow each other."""
    return [
        index
        for index, (first, second) in enumerate(pairwise(frames))
        if first.code == second.code == "gray"
        and (first.axis, first.bit) == (second.axis, second.bit)
        and first.inverse != second.inverse
    ]


def lights_of(frames: Sequence[Frame]) -> list[int]:
    """Where white and black are."""
    return [index for index, frame in enumerate(frames) if frame.code in ("white", "black")]


def taken_without_lights(pattern: GrayCode | FrameSequence, count: int) -> str:
    """That so many pictures are taken for those of the pattern without its white and black; nothing where not so.

    A pair that is missing leaves as many.
    """
    spec, frames = sequence_of(pattern) if isinstance(pattern, GrayCode) else pattern, frames_of(pattern, count)
    lights = {"white", "black"}
    if frames is None or not lights & {f.code for f in spec.frames} or lights & {f.code for f in frames}:
        return ""
    return f"expected {_asked(spec)}, found {count} pictures, as many as without white and black"


def grey_pictures(images: Sequence[Image]) -> list[Image]:
    """All pictures without colour."""
    return [_grey(image) for image in images]


def _arrange_gray_code(pattern: GrayCode, images: Sequence[Image], names: Sequence[str]) -> ArrangedSequence:
    grey = [_grey(image) for image in images]
    pair_count = sum(pattern.bits)
    if len(grey) not in (2 * pair_count, pattern.picture_count):
        raise CaptureError(CAPTURE, _other_layout(pattern, grey) or explain_count(pattern, grey, names))
    require_light(grey)
    if len(grey) == 2 * pair_count and ends_with_white_and_black(grey):
        raise CaptureError(CAPTURE, explain_count(pattern, grey, names))
    first = 0
    if len(grey) == pattern.picture_count:
        first = _first_pair(grey, names)
    else:
        require_complements(grey, names, range(0, len(grey), 2))
    spec = sequence_of(pattern)
    pairs, ends = spec.frames[:-2], spec.frames[-2:]
    frames = pairs if len(grey) == 2 * pair_count else (*ends, *pairs) if first else spec.frames
    spec = replace(spec, frames=frames)
    white, black, color = scene_lights(spec, images, grey)
    return ArrangedSequence(spec, grey, list(names), white, black, color, thorough=False)


def _other_layout(pattern: GrayCode, grey: Sequence[Image]) -> str:
    """That so many pictures are a code of another layout; nothing where they fit none."""
    from retrue.decoding.sequence.diagnosis import fitting_layouts

    fitting = fitting_layouts(grey, pattern.projector_size)
    if not fitting:
        return ""
    asked = f"{pattern.picture_count} pictures of {sum(pattern.bits)} bits, pattern and inverse, white and black"
    found = f"{len(grey)}, which fit the layout {' or '.join(fitting)}"
    return f"expected {asked}; found {found}; `retrue pattern sequence --layout ...` makes its pattern"


def scene_lights(spec: FrameSequence, images: Sequence[Image], grey: Sequence[Image]) -> tuple[Image, Image, Image]:
    """White, black and the white picture in colour."""
    codes = [frame.code for frame in spec.frames]
    gray = _coarse(spec, grey)
    mean = None if gray else _mean([image for image, code in zip(grey, codes, strict=True) if code == "phase"])
    if "white" in codes:
        white, color = grey[codes.index("white")], images[codes.index("white")]
    else:
        color = white = reduce(np.maximum, gray) if mean is None else mean
    if "black" in codes:
        return white, grey[codes.index("black")], color
    return white, reduce(np.minimum, gray) if mean is None else mean, color


def _coarse(spec: FrameSequence, grey: Sequence[Image]) -> list[Image]:
    """Pictures of the Gray code among which every lit pixel is once bright and once dark."""
    codes = [code for axis in spec.axes if (code := spec.gray(axis)) is not None]
    pairs = [pair for code in codes for pair in code.bits[:COARSE_BITS] if None not in pair]
    if not pairs:
        pairs = [pair for code in codes for pair in code.bits]
    return [grey[index] for _, pattern, inverse in pairs for index in (pattern, inverse) if index is not None]


def _mean(pictures: Sequence[Image]) -> Image:
    """Of each pixel, rounded."""
    if pictures[0].dtype == np.uint16 or len(pictures) > MOST_TO_SUM:
        return np.rint(np.mean(pictures, axis=0, dtype=np.float32)).astype(pictures[0].dtype)
    total = pictures[0].astype(np.uint16)
    for picture in pictures[1:]:
        cv2.add(total, picture, total, dtype=cv2.CV_16U)
    return cast(Image, cv2.convertScaleAbs(total, alpha=1 / len(pictures)))


def _asked(spec: FrameSequence) -> str:
    """How many pictures, and of what."""
    counts = {code: sum(frame.code == code for frame in spec.frames) for code in ("gray", "phase", "white", "black")}
    words = {"gray": "of Gray code", "phase": "of sines", "white": "white", "black": "black"}
    what = ", ".join(f"{count} {words[code]}" for code, count in counts.items() if count)
    layout = f" of the layout {spec.layout}" if spec.layout else ""
    return f"{spec.picture_count} pictures{layout} ({what})"


def _order(files: Sequence[str], names: Sequence[str]) -> list[int]:
    """Where each file of the pattern is among the pictures."""
    where = {name: index for index, name in enumerate(names)}
    missing = [name for name in files if name not in where]
    if missing:
        more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
        raise CaptureError(
            CAPTURE, f"expected the {len(files)} files that the pattern names, found no {missing[0]}{more}"
        )
    return [where[name] for name in files]


def _first_pair(grey: Sequence[Image], names: Sequence[str]) -> int:
    """Where the pairs start: 2 when white and black, which differ most, come first, else 0."""
    count = len(grey) - 2
    steps = {k: float(grey[k][::4, ::4].mean()) - float(grey[k + 1][::4, ::4].mean()) for k in (0, count)}
    pairs, lights = {0: range(0, count, 2), 2: range(2, count + 2, 2)}, {0: (count, count + 1), 2: (0, 1)}
    first = 2 if abs(steps[0]) > 1.1 * abs(steps[count]) else 0
    try:
        require_complements(grey, names, pairs[first], lights[first])
    except CaptureError:
        if are_complements(grey, pairs[2 - first]):
            require_complements(grey, names, pairs[2 - first], lights[2 - first])
        raise
    if not steps[lights[first][0]] > 0:
        white, black = (names[k] for k in lights[first])
        raise CaptureError(
            CAPTURE, f"white and black are swapped: {white} is darker than {black}; expected white, then black"
        )
    return first


def _require_alike(images: Sequence[Image], names: Sequence[str]) -> None:
    for image, name in zip(images, names, strict=True):
        if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] != 3) or image.size == 0:
            raise CaptureError(CAPTURE, f"{name}: expected height x width (x 3), found shape {image.shape}")
        if image.dtype.name not in ("uint8", "uint16"):
            raise CaptureError(CAPTURE, f"{name}: expected 8 or 16 bits, found {image.dtype}")
        if image.shape[:2] != images[0].shape[:2]:
            sizes = [f"{picture.shape[1]} x {picture.shape[0]}" for picture in (image, images[0])]
            raise CaptureError(CAPTURE, f"sizes differ: {name} is {sizes[0]}, {names[0]} is {sizes[1]} pixels")
        if image.dtype != images[0].dtype:
            raise CaptureError(CAPTURE, f"depths differ: {name} is {image.dtype}, {names[0]} is {images[0].dtype}")


def _grey(image: Image) -> Image:
    return np.ascontiguousarray(image if image.ndim == 2 else cast(Image, cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)))
