"""What may have happened to a sequence: relabelled frames, gains, a share of the picture before; fitted to a sample.

Every hypothesis says which frame each picture shows. It is judged where bits change between neighbouring pixels: in
the right order the code goes on by one there, in a wrong one it jumps; and by pattern and inverse, which add up to
the same in each pixel.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from itertools import product

import numpy as np

from retrue.decoding.gray.faults import FOLDED, shows_stripes
from retrue.geometry.arrays import BoolArray, FloatArray, Image, IntArray
from retrue.patterns.sequence import AXES, Frame

SAMPLE = 4000
"""Pixels, with the neighbours right of and below each."""
LIT = 0.3
"""Of the strongest contrast."""
DECIDED = 0.12
"""Of a pixel's contrast: |pattern - inverse| of a bit that is believed."""
LIGHTS_COUNT = 0.1
"""How much white and black count beside the code: automatic exposure may have made them equal."""
LATEST = 3
FEWEST_CHANGES = 40
SAME = 0.04
"""Of the contrast: two pictures that differ by less almost everywhere show the same."""
IGNORE = Frame("ignore")


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """What each picture shows, and why that is not what was expected; `causes` is empty where it is."""

    frames: tuple[Frame, ...]
    causes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Sample:
    """Grey levels (pictures, pixels) of lit pixels, of those right of them, and of those below.

    Hypotheses differ in what a picture is taken for, not in what it shows, and many in one axis or the lights alone:
    `bits`, `runs`, `unlike` and `dark` remember their answers.
    """

    here: FloatArray
    right: FloatArray
    below: FloatArray

    @cached_property
    def contrast(self) -> FloatArray:
        """(pixels,) of the lit pixels, over all pictures."""
        return np.maximum(np.ptp(self.here, axis=0), 1e-6)

    @cached_property
    def bits(self) -> list[Callable[[int | None, int | None], tuple[BoolArray, BoolArray]]]:
        """`_bit` of the lit pixels, of those right of them, and of those below."""
        return [cache(partial(_bit, part, part.min(axis=0), part.max(axis=0))) for part in self._parts]

    @cached_property
    def runs(self) -> Callable[[tuple[tuple[int | None, int | None], ...], int, int, int], Runs]:
        """`_runs` of a code of those bits."""
        return cache(partial(_runs, self.bits))

    @cached_property
    def dark(self) -> Callable[[int | None, int | None], float]:
        """`_dark` of the pictures that are white and black."""
        return cache(partial(_dark, self.here, self.contrast))

    @cached_property
    def unlike(self) -> Callable[[int, int], float]:
        """`_unlike_pair` of two of the pictures."""
        return cache(partial(_unlike_pair, self.here, self.contrast))

    @property
    def _parts(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        return self.here, self.right, self.below

    def corrected(self, gains: FloatArray, share: float) -> Sample:
        """Without gains and without a share of the picture before."""
        return Sample(*(corrected(part, gains, share) for part in self._parts))


@dataclass(frozen=True, slots=True)
class Runs:
    """How many codes of an axis there are, and lie in the projector; how many change to the next pixel, by one or two,
    and by how much more one way than the other."""

    codes: int
    inside: int
    changes: int
    continuous: int
    one_way: float


@dataclass(frozen=True, slots=True)
class Judgement:
    """How well a hypothesis fits.

    Attributes
    ----------
    continuous : share of the changes between neighbours at which the code goes on by one or two.
    one_way : of these, how many more go the usual way than the other; of the axis where that is less.
    inside : share of the codes that lie in the projector.
    unlike : median over pairs of |pattern + inverse - their median|, of the contrast.
    dark : by how much white less black falls short of the contrast, 0 to 2; the brightest or darkest picture stands for
        one that the sequence has not.
    changes : how many changes there were.
    """

    continuous: float
    one_way: float
    inside: float
    unlike: float
    dark: float
    changes: int

    @property
    def score(self) -> float:
        """Larger is better; 1 where all fits."""
        runs = self.continuous * self.inside * (self.one_way > FOLDED)
        return runs - self.unlike - LIGHTS_COUNT * self.dark


def hypotheses(frames: Sequence[Frame], *, doubled: bool = False) -> Iterator[Hypothesis]:
    """As expected first, then every order that people end up with, alone and together.

    `doubled`: what stands in the place of white or black shows the same as another picture, and may be left out.
    """
    either, lights_are = (False, True), ("", "exchanged", "moved", *(("lost",) if doubled else ()))
    orders = product(either, either, either, either, either, lights_are, range(LATEST + 1))
    relabelled = cache(partial(_relabelled, frames))
    seen: set[tuple[Frame, ...]] = set()
    for *moved, lights, late in sorted(orders, key=_surprise):
        backwards, _, low_first, inverse_first, _ = moved
        if backwards and (low_first or inverse_first):  # as the whole is then, already
            continue
        made, causes = relabelled(*moved, lights)
        if late:
            made = (IGNORE,) * late + made[:-late]
            causes = (*causes, f"every picture shows what belongs {late} earlier: the camera is late by {late}")
        if made not in seen:
            seen.add(made)
            yield Hypothesis(made, causes)


def _relabelled(
    frames: Sequence[Frame],
    backwards: bool,
    rows_first: bool,
    low_first: bool,
    inverse_first: bool,
    inverses_last: bool,
    lights: str,
) -> tuple[tuple[Frame, ...], tuple[str, ...]]:
    """The frames as one who mixed them up so has them, and what to tell him."""
    made, causes = list(frames), list[str]()
    if rows_first:
        made = _rows_first(made)
        causes.append("the row pictures come before the column pictures")
    if low_first:
        made = _low_first(made)
        causes.append("the least significant bits come first")
    if inverse_first:
        made = [replace(f, inverse=not f.inverse) if f.code == "gray" else f for f in made]
        causes.append("inverses come before patterns")
    if inverses_last:
        made = _inverses_last(made)
        causes.append(f"all {'patterns' if inverse_first else 'inverses'} come last")
    if lights == "exchanged":
        other = {"white": "black", "black": "white"}
        made = [replace(f, code=other[f.code]) if f.code in other else f for f in made]
        causes.append("white and black are exchanged")
    elif lights == "moved":
        made = _moved_lights(made)
        causes.append("white and black are at the other end")
    elif lights == "lost":
        made = [IGNORE if f.code in ("white", "black") else f for f in made]
        causes.append("white or black is missing, and another picture in its place")
    if backwards:
        made.reverse()
        causes.append("the pictures are in reversed order, the last one first")
    return tuple(made), tuple(causes)


def judge(sample: Sample, frames: Sequence[Frame], projector_size: tuple[int, int]) -> Judgement:
    """Fit a sample of pixels."""
    found, unlike = list[Runs](), list[float]()
    for axis, name in enumerate(AXES):
        bits = bits_of(frames, name)
        if len(bits) < 2:
            continue
        step, offset = bits[0][3], bits[0][4]
        first, last = -offset // step, (projector_size[axis] - 1 - offset) // step
        pairs = tuple((pattern, inverse) for _, pattern, inverse, *_ in bits)
        found.append(sample.runs(pairs, bits[-1][0], first, last))
        unlike += [sample.unlike(min(p, q), max(p, q)) for p, q in pairs if p is not None and q is not None]
    codes = [frame.code for frame in frames]
    changes = sum(one.changes for one in found)
    return Judgement(
        sum(one.continuous for one in found) / max(changes, 1),
        min([1.0, *(one.one_way / one.continuous for one in found if one.continuous >= FEWEST_CHANGES)]),
        sum(one.inside for one in found) / max(sum(one.codes for one in found), 1),
        float(np.median(unlike)) if unlike else 0.0,
        sample.dark(*(codes.index(code) if code in codes else None for code in ("white", "black"))),
        changes,
    )


def _runs(
    parts: Sequence[Callable[[int | None, int | None], tuple[BoolArray, BoolArray]]],
    bits: tuple[tuple[int | None, int | None], ...],
    low: int,
    first: int,
    last: int,
) -> Runs:
    """Of patterns and inverses, most significant first, the last one being bit `low`; `first` to `last` are inside."""
    (number, decided), *others = (_codes([part(pattern, inverse) for pattern, inverse in bits]) for part in parts)
    inside = decided & ((number << low) >= first) & ((number << low) <= last)
    steps = [(other - number)[decided & its & (other != number)] for other, its in others]
    near = [np.sign(step[np.abs(step) <= 2]) for step in steps]
    return Runs(
        int(np.count_nonzero(decided)),
        int(np.count_nonzero(inside)),
        sum(map(len, steps)),
        sum(map(len, near)),
        sum(abs(float(way.sum())) for way in near),
    )


def _dark(here: FloatArray, contrast: FloatArray, white: int | None, black: int | None) -> float:
    light = (here.max(axis=0) if white is None else here[white]) - (here.min(axis=0) if black is None else here[black])
    return float(np.clip(1 - np.median(light / contrast), 0, 2))


def take_sample(grey: Sequence[Image], rng: np.random.Generator) -> Sample | None:
    """Random lit pixels; None where the pictures are too small or dark."""
    height, width = grey[0].shape
    if height < 3 or width < 3:
        return None
    y, x = rng.integers(0, height - 1, 8 * SAMPLE), rng.integers(0, width - 1, 8 * SAMPLE)
    here = _seen(grey, y * width + x)
    contrast = np.ptp(here, axis=0)
    lit = np.flatnonzero(contrast > LIT * np.percentile(contrast, 99))[:SAMPLE]
    if not len(lit):
        return None
    pixels = y[lit] * width + x[lit]
    return Sample(here[:, lit], _seen(grey, pixels + 1), _seen(grey, pixels + width))


def _seen(grey: Sequence[Image], pixels: IntArray) -> FloatArray:
    """(pictures, N) at flat indices: found in half the time that rows and columns take."""
    seen = np.empty((len(grey), len(pixels)))
    for row, image in zip(seen, grey, strict=True):
        row[:] = np.take(image, pixels)
    return seen


def repeated_pictures(sample: Sample) -> list[int]:
    """Which pictures show the same as the one before, but for noise."""
    off = np.percentile(np.abs(np.diff(sample.here, axis=0)) / sample.contrast, 80, axis=1)
    return (np.flatnonzero(off < SAME) + 1).tolist()


def doubled_light(sample: Sample, frames: Sequence[Frame]) -> bool:
    """Whether what is to be white or black shows the stripes of another picture."""
    for k, frame in enumerate(frames):
        if frame.code in ("white", "black") and shows_stripes(
            (sample.here[k] - sample.here.min(axis=0)) / sample.contrast
        ):
            off = np.percentile(np.abs(sample.here - sample.here[k]) / sample.contrast, 80, axis=1)
            if np.count_nonzero(off < SAME) > 1:
                return True
    return False


def corrected(pictures: FloatArray, gains: FloatArray, share: float) -> FloatArray:
    """Pictures (K, ...) over their gains, less the share of the picture before; the first has none before it."""
    made = pictures / gains.reshape(-1, *[1] * (pictures.ndim - 1))
    if share:
        for index in range(1, len(made)):
            made[index] = (made[index] - share * made[index - 1]) / (1 - share)
    return made


def bits_of(frames: Sequence[Frame], axis: str) -> list[tuple[int, int | None, int | None, int, int]]:
    """(bit, pattern, inverse, step, offset), most significant first."""
    patterns: dict[int, int] = {}
    inverses: dict[int, int] = {}
    first = next((frame for frame in frames if frame.code == "gray" and frame.axis == axis), IGNORE)
    for index, frame in enumerate(frames):
        if frame.code == "gray" and frame.axis == axis and frame.bit is not None:
            (inverses if frame.inverse else patterns)[frame.bit] = index
    bits = sorted({*patterns, *inverses}, reverse=True)
    return [(bit, patterns.get(bit), inverses.get(bit), first.step_px, int(first.offset_px)) for bit in bits]


def _codes(bits: Sequence[tuple[BoolArray, BoolArray]]) -> tuple[IntArray, BoolArray]:
    """n of each pixel, and whether all of its bits are decided."""
    decided = np.logical_and.reduce([its for _, its in bits])
    number = bit_before = np.zeros(decided.shape, np.int64)
    for changes, _ in bits:
        bit_before = bit_before ^ changes
        number = (number << 1) | bit_before
    return number, decided


def _bit(
    part: FloatArray, low: FloatArray, high: FloatArray, pattern: int | None, inverse: int | None
) -> tuple[BoolArray, BoolArray]:
    """Of pixels whose pictures go from `low` to `high`: whether pattern outshines inverse, and whether clearly."""
    p = part[pattern] if pattern is not None else low + high - part[inverse]
    q = part[inverse] if inverse is not None else low + high - part[pattern]
    return p > q, np.abs(p - q) > DECIDED * np.maximum(high - low, 1e-6)


def _unlike_pair(here: FloatArray, contrast: FloatArray, one: int, other: int) -> float:
    """Median over the pixels of |one + other - its median|, of the contrast."""
    total = (here[one] + here[other]) / contrast
    return float(np.median(np.abs(total - np.median(total))))


def _surprise(order: tuple[bool, bool, bool, bool, bool, str, int]) -> tuple[int, int]:
    """How many things went wrong at once."""
    *moved, lights, late = order
    return sum((*moved, bool(lights), late > 0)), late


def _rows_first(frames: Sequence[Frame]) -> list[Frame]:
    """The frames of the rows in the places of the first pictures of either axis, then those of the columns."""
    places = [index for index, frame in enumerate(frames) if frame.axis is not None]
    rows = [frame for frame in frames if frame.axis == "row"]
    columns = [frame for frame in frames if frame.axis == "column"]
    made = list(frames)
    for place, frame in zip(places, rows + columns, strict=True):
        made[place] = frame
    return made


def _low_first(frames: Sequence[Frame]) -> list[Frame]:
    """The bits of each axis in the opposite order."""
    made = list(frames)
    for axis in AXES:
        own = [frame.bit for frame in frames if frame.code == "gray" and frame.axis == axis and frame.bit is not None]
        if own:
            top = max(own) + min(own)
            made = [
                replace(f, bit=top - f.bit) if f.code == "gray" and f.axis == axis and f.bit is not None else f
                for f in made
            ]
    return made


def _inverses_last(frames: Sequence[Frame]) -> list[Frame]:
    """In the places of the bits, first of each pair the frame that comes first, then all that come second."""
    places = [index for index, frame in enumerate(frames) if frame.code == "gray"]
    first = next((frames[place].inverse for place in places), False)
    made = list(frames)
    for place, other in zip(places, sorted(places, key=lambda k: frames[k].inverse != first), strict=True):
        made[place] = frames[other]
    return made


def _moved_lights(frames: Sequence[Frame]) -> list[Frame]:
    """White and black first where they were last, and the other way round."""
    lights = [frame for frame in frames if frame.code in ("white", "black")]
    others = [frame for frame in frames if frame.code not in ("white", "black")]
    first = bool(lights) and frames[0].code in ("white", "black")
    return [*others, *lights] if first else [*lights, *others]
