"""What is wrong with a Gray-code capture, said by the picture.

Two pictures of a pair complement each other: where one is as bright as white, the other is as dark as black. All
tests look at a sample of pixels, scaled so that 0 is the darkest and 1 the brightest that each pixel has seen.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from retrue.decoding.gray.bits import CodeImage
from retrue.errors import CaptureError
from retrue.geometry.arrays import FloatArray, Image
from retrue.patterns.gray_code import GrayCode

if TYPE_CHECKING:
    from retrue.decoding.gray.sequence import Stripes

CAPTURE = "capture"
"""Stands for the capture in messages until the reader of the folder puts its path there."""

LEAST_CONTRAST = 8 / 255
"""Of full scale: below it, a capture is dark."""
LIT = 0.3
"""Of the strongest contrast: a pixel is lit."""
SAMPLE_ROWS, SAMPLE_COLUMNS = 24, 400
ALIKE = 0.1
"""Two pictures whose scaled difference is below it almost everywhere show the same."""
CONFLICT = 0.7
"""|pattern + inverse - 1| of a pixel where both are bright or both are dark; blurred stripes stay below it."""
MOST_CONFLICTS = 0.15
STRIPED = 0.5
"""Where stripes are bright; black is below it, whatever strays into it."""
LEAST_TRANSITIONS = 16
FOLDS = "the {} code runs up and down again, as where the pictures of a bit are missing or wrong"
MISPLACED = (
    "{} does not belong to the others: where it changes, the lower bits of the {} code are not 1 0 .. 0 (on "
    "its head, moved, or of another capture?); take the capture again"
)
MISPLACED_SHARE = 0.8
COARSE, FEWEST_STEPS = 2, 40
LACKING = 0.2
"""Of the changes of a bit, at which the next lower one is 1: noise leaves half, its pictures nearly all."""
FOLDED = 0.5
"""Of the steps between neighbours, that more than balance: of a code that lacks a bit as many go up as down."""
MOST_OUTSIDE = 0.02
MOST_MISSING = 8
"""Numbers in a row: names that lack more are not numbered one by one."""


def require_light(grey: Sequence[Image]) -> None:
    """Raise where no pixel's brightness changes much from picture to picture."""
    values = _sample(grey)
    full_scale = 255.0 if grey[0].dtype == np.uint8 else 65535.0
    contrast = float(np.percentile(values.max(axis=0) - values.min(axis=0), 99)) / full_scale
    if not contrast > LEAST_CONTRAST:
        raise CaptureError(
            CAPTURE,
            f"nothing is lit: brightness changes by {100 * contrast:.1f} % of full scale at most "
            f"(black frames?); turn the projector on or expose longer",
        )


def require_complements(
    grey: Sequence[Image], names: Sequence[str], pairs: Sequence[int], lights: Sequence[int] = ()
) -> None:
    """Raise where pattern and inverse do not complement each other, and say which picture is to blame; or where one of
    `lights`, which are to be white and black, shows stripes."""
    scaled = _scaled(grey)
    bad = [index for index in pairs if not _complement(scaled[index], scaled[index + 1])]
    if bad:
        more = f"; {len(bad)} of {len(pairs)} pairs do not fit" if len(bad) > 1 else ""
        raise CaptureError(CAPTURE, f"{_blame(scaled, names, bad[0])}{more}: take the capture again")
    for index in lights:
        if shows_stripes(scaled[index]):
            same = [names[k] for k, other in enumerate(scaled) if k != index and _alike(scaled[index], other)]
            what = f"shows the same as {same[0]}" if same else "shows stripes"
            raise CaptureError(CAPTURE, f"{names[index]} {what}, where white or black is expected: is one missing?")


def are_complements(grey: Sequence[Image], pairs: Sequence[int]) -> bool:
    """Whether all patterns and inverses complement each other."""
    scaled = _scaled(grey)
    return all(_complement(scaled[index], scaled[index + 1]) for index in pairs)


def shows_stripes(scaled: FloatArray) -> bool:
    """Whether a picture, (pixels,) from the darkest to the brightest that each has seen, is neither white nor black."""
    bright = float(np.percentile(scaled, 95))
    return bright > STRIPED and float(np.mean(scaled < bright / 2)) > MOST_CONFLICTS


def ends_with_white_and_black(grey: Sequence[Image]) -> bool:
    """Whether the last two pictures are all bright and all dark."""
    *_, white, black = _scaled(grey)
    return bool(np.percentile(white, 5) > 0.8 and np.percentile(black, 95) < 0.2)


def explain_count(pattern: GrayCode, grey: Sequence[Image], names: Sequence[str]) -> str:
    """Why the number of pictures is not what the pattern asks for."""
    width, height = pattern.projector_size
    found, expected = len(grey), pattern.picture_count
    counts = (
        f"expected {expected} pictures ({pattern.bits[0]} + {pattern.bits[1]} bits, pattern and inverse, white and "
        f"black) for a projector of {width} x {height}, found {found}"
    )
    gap = missing_numbers(names, expected)
    if gap:
        return f"{counts}: {gap}"
    if found < 4:
        return counts
    scaled = _scaled(grey)
    complete = [
        all(_complement(scaled[index], scaled[index + 1]) for index in range(first, first + found - 3, 2))
        for first in (0, 2)
    ]
    if found % 2 == 0 and any(complete):
        return f"{counts}, every pair complete: is the pattern's projector size (or step) the one that was projected?"
    first = 2 if float(scaled[0].mean()) > 0.9 and float(scaled[1].mean()) < 0.1 else 0
    what = [
        f"{axis} bit {bit}" for axis, bits in zip(("column", "row"), pattern.bits, strict=True) for bit in range(bits)
    ]
    for pair, index in enumerate(range(first, found - 1, 2)):
        if pair < len(what) and not _complement(scaled[index], scaled[index + 1]):
            if found > expected:
                return f"{counts}: {_blame(scaled, names, index)}"
            return f"{counts}: of {what[pair]}, {names[index]} has no counterpart (its pattern or inverse is missing)"
    return f"{counts}: white or black is missing" if found == expected - 1 else counts


def require_order(code: CodeImage, neighbour: CodeImage, names: Sequence[tuple[str, str]], axis: str) -> None:
    """Raise where pictures of an axis are swapped; `names` of its pairs, most significant bit first.

    `code` and `neighbour`, both (N,), are the codes of neighbouring pixels.
    """
    wrong = _order_violations(code, neighbour, len(names))
    if np.count_nonzero(wrong > 0.25) > 1:
        problem = f"the {axis} pictures are not in order"
    elif wrong.max(initial=0) > 0.8:
        pattern, inverse = names[len(names) - 1 - int(np.argmax(wrong))]
        problem = f"pattern and inverse are swapped: {pattern} and {inverse}"
    elif _lacks_a_bit(code, neighbour, len(names)):
        problem = FOLDS.format(axis)
    elif (bit := _misplaced_bit(code, neighbour, len(names))) is not None:
        named = names[len(names) - 1 - bit][0]
        raise CaptureError(CAPTURE, MISPLACED.format(named, axis))
    else:
        return
    raise CaptureError(CAPTURE, f"{problem}; expected pattern before inverse, most significant bit first")


def _order_violations(code: CodeImage, neighbour: CodeImage, bits: int) -> FloatArray:
    """For each bit, least significant first, how often it is not what the change of a higher bit asks for; (bits,).

    Where bit j of a Gray code changes, the next lower bit is 1 and all below it are 0, everywhere. The most
    significant bit has none above it: swapped, it mirrors the code, which no picture can tell.
    """
    gray = code ^ (code >> 1)
    changed = gray ^ neighbour ^ (neighbour >> 1)
    single = (changed != 0) & ((changed & (changed - 1)) == 0)
    changed, gray = changed[single], gray[single]
    wrong = (gray & (changed - 1)) ^ (changed >> 1)
    shares = np.zeros(bits)
    for bit in range(bits - 1):
        above = changed > (1 << bit)
        if np.count_nonzero(above) >= LEAST_TRANSITIONS:
            shares[bit] = np.mean((wrong[above] >> bit) & 1)
    return shares


def _lacks_a_bit(code: CodeImage, neighbour: CodeImage, bits: int) -> bool:
    """Whether at the changes of some bit the next lower one is 0: it is not the next, then."""
    gray = code ^ (code >> 1)
    changed = gray ^ neighbour ^ (neighbour >> 1)
    lower = [(gray[changed == 2 << bit] >> bit) & 1 for bit in range(bits - 1)]
    return any(len(own) >= LEAST_TRANSITIONS and own.mean() < LACKING for own in lower)


def _misplaced_bit(code: CodeImage, neighbour: CodeImage, bits: int) -> int | None:
    """The lowest bit at most of whose changes the lower bits are not those that a Gray code has there, 1 0 .. 0; None
    where none is. The lowest of these is not asked: noise is loudest there."""
    gray = code ^ (code >> 1)
    changed = gray ^ neighbour ^ (neighbour >> 1)
    for bit in range(2, bits):
        own = gray[changed == 1 << bit]
        wrong = ((own ^ (1 << (bit - 1))) & ((1 << bit) - 2)) != 0
        if len(own) >= LEAST_TRANSITIONS and wrong.mean() > MISPLACED_SHARE:
            return bit
    return None


def require_one_way(along: Sequence[tuple[CodeImage, CodeImage]], axis: str) -> None:
    """Raise where about as many codes go up as down: on surfaces, all go one way. Without the finest bits, noise's own.

    `along` both array axes, the codes of neighbouring pixels, (N,) each.
    """
    steps = [(there >> COARSE) - (here >> COARSE) for here, there in along]
    near = [own[np.abs(own) == 1] for own in steps]
    count, more = sum(map(len, near)), sum(abs(int(own.sum())) for own in near)
    if count >= FEWEST_STEPS and more < FOLDED * count:
        raise CaptureError(CAPTURE, FOLDS.format(axis))


def require_inside(agreed: int, outside: Sequence[int], largest: Sequence[int], stripes: Sequence[Stripes]) -> None:
    """Raise where many codes lie beyond the projector; `outside` and `largest` code by axis."""
    for beyond, code, axis in zip(outside, largest, stripes, strict=True):
        if beyond > MOST_OUTSIDE * agreed:
            name = ("column", "row")[axis.axis]
            reached = axis.offset_px + (code + 1) * axis.width_px
            raise CaptureError(
                CAPTURE,
                f"codes exceed the projector: {100 * beyond / agreed:.0f} % of the pixels see {name}s up "
                f"to {reached - 1:g}, the pattern's projector_size has {axis.side}; is it the size that was projected?",
            )


def _blame(scaled: FloatArray, names: Sequence[str], index: int) -> str:
    """Which of the pictures `index` and `index` + 1, which do not complement each other, is wrong and how."""
    for picture in (index, index + 1):
        if float(np.percentile(scaled[picture], 90)) < 0.2:
            return f"{names[picture]} is black"
        if float(np.percentile(scaled[picture], 10)) > 0.8:
            return f"{names[picture]} is all white"
    for picture in (index, index + 1):
        if picture > 0 and _alike(scaled[picture], scaled[picture - 1]):
            return f"{names[picture]} shows the same as {names[picture - 1]} before it (late, repeated or doubled)"
    return f"{names[index]} and {names[index + 1]} are not pattern and inverse of each other (a late or moved frame?)"


def _complement(first: FloatArray, second: FloatArray) -> bool:
    return bool(np.mean(np.abs(first + second - 1) > CONFLICT) < MOST_CONFLICTS)


def _alike(first: FloatArray, second: FloatArray) -> bool:
    return bool(np.percentile(np.abs(first - second), 80) < ALIKE)


def _scaled(grey: Sequence[Image]) -> FloatArray:
    """(pictures, pixels) of a sample of the lit pixels: 0 the darkest, 1 the brightest that the pixel has seen."""
    values = _sample(grey)
    darkest, brightest = values.min(axis=0), values.max(axis=0)
    contrast = brightest - darkest
    lit = contrast > LIT * np.percentile(contrast, 99)
    return (values[:, lit] - darkest[lit]) / contrast[lit]


def changing_pixels(grey: Sequence[Image]) -> float:
    """How many pixels change brightness from picture to picture as those that are lit do; from a sample."""
    values = _sample(grey)
    contrast = values.max(axis=0) - values.min(axis=0)
    lit = int(np.count_nonzero(contrast > LIT * np.percentile(contrast, 99)))
    return lit * grey[0].size / contrast.size


def _sample(grey: Sequence[Image]) -> NDArray[np.float32]:
    height, width = grey[0].shape
    rows, columns = slice(None, None, max(height // SAMPLE_ROWS, 1)), slice(None, None, max(width // SAMPLE_COLUMNS, 1))
    return np.stack([image[rows, columns].ravel() for image in grey]).astype(np.float32)


def missing_numbers(names: Sequence[str], expected: int) -> str:
    """Which numbers are missing from numbered names, of so many that are expected; nothing where none, or more, are."""
    runs = [re.findall(r"\d+", name.rsplit(".", 1)[0]) for name in names]
    if not all(runs):
        return ""
    numbers = [int(run[-1]) for run in runs]
    gaps = [
        (missing, before)
        for (number, following), before in zip(pairwise(numbers), names, strict=False)
        for missing in range(number + 1, min(following, number + MOST_MISSING + 1))
    ]
    if not gaps or any(b <= a for a, b in pairwise(numbers)) or len(gaps) != expected - len(names):
        return ""
    if len(gaps) == 1:
        return f"number {gaps[0][0]} is missing, after {gaps[0][1]}"
    listed = f"{', '.join(str(missing) for missing, _ in gaps[:-1])} and {gaps[-1][0]}"
    return f"numbers {listed} are missing, the first after {gaps[0][1]}"
