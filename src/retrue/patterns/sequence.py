"""A sequence of pictures, each with a role: a bit of a Gray code, a shifted sine, white, black, or none."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from retrue.errors import InputError, require_choice, require_kinds
from retrue.geometry.arrays import whole_numbers
from retrue.patterns.gray_code import MAX_BITS, MAX_PROJECTOR_SIDE
from retrue.ranges import require_number
from retrue.shown import ShortRepr, Shown

AXES: tuple[Literal["column"], Literal["row"]] = ("column", "row")
"""The columns' code tells projector x, the rows' projector y."""
MOST_FRAMES = 1000
FEWEST_SHIFTS = 3
SAME_PHASE = 0.015
"""Turns: sines that differ by no more are not told apart."""
LEAST_DETERMINANT = 1e-3
"""Of the shifts' normal equations over N: below it, they do not tell brightness, modulation and phase apart."""

Code = Literal["gray", "phase", "white", "black", "ignore"]


@dataclass(frozen=True, slots=True)
class Frame:
    """What one picture of a sequence shows.

    Stripe n of a Gray code covers the projector pixels offset_px + n * step_px ... offset_px + (n + 1) * step_px - 1
    and shows bit `bit` of n ^ (n >> 1). A sine shows (1 + cos(2 pi ((x - offset_px) / period_px - shift))) / 2 at
    pixel x.

    Attributes
    ----------
    code : what is shown: `gray`, `phase`, `white`, `black`, or `ignore`, nothing that tells.
    axis : `column` or `row`; None of white, black and ignore.
    bit : of a Gray code, from the least significant, 0.
    inverse : whether dark and bright are exchanged.
    period_px, shift : of a sine: in projector pixels, in turns.
    step_px : of a Gray code, width of its smallest stripe in whole projector pixels.
    offset_px : first pixel of stripe 0; negative where the code starts before the projector's first pixel.
    """

    code: Code
    axis: Literal["column", "row"] | None = None
    bit: int | None = None
    inverse: bool = False
    period_px: float | None = None
    shift: float | None = None
    step_px: int = 1
    offset_px: float = 0

    def __post_init__(self) -> None:
        require_choice(self.code, get_args(Code), "code")
        if self.code not in ("gray", "phase"):
            return
        require_choice(self.axis, AXES, "axis")
        require_number(self.offset_px, "offset_px", -MAX_PROJECTOR_SIDE, MAX_PROJECTOR_SIDE)
        if self.code == "gray":
            require_number(self.bit, "bit", 0, MAX_BITS - 1, whole=True)
            require_number(self.step_px, "step_px", 1, MAX_PROJECTOR_SIDE, whole=True)
        else:
            require_number(self.period_px, "period_px", 2, 64 * MAX_PROJECTOR_SIDE)
            require_number(self.shift, "shift", -MOST_FRAMES, MOST_FRAMES)

    @property
    def name(self) -> str:
        """What it shows, for people."""
        if self.code == "gray":
            return f"{self.axis} bit {self.bit} {'inverse' if self.inverse else 'pattern'}"
        if self.code == "phase":
            return f"{self.axis} sine of {self.period_px:g} px, shifted by {self.shift:.3g}"
        return self.code

    def brightness(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """What the projector shows at `pixels` along the frame's axis, 0 to 1.

        >>> Frame("gray", "column", bit=0).brightness(np.arange(5.0)).tolist()
        [0.0, 1.0, 1.0, 0.0, 0.0]
        """
        if self.code == "gray" and self.bit is not None:
            n = np.floor((np.floor(pixels) - self.offset_px) / self.step_px).astype(np.int64)
            lit = ((n ^ (n >> 1)) >> self.bit & 1) == 1
            return np.where(lit != self.inverse, 1.0, 0.0)
        if self.code == "phase" and self.period_px is not None and self.shift is not None:
            turns = (pixels - self.offset_px) / self.period_px - self.shift
            cosine = np.cos(2 * np.pi * turns)
            return (1 - cosine if self.inverse else 1 + cosine) / 2
        return np.full_like(pixels, 1.0 if self.code == "white" else 0.0)


@dataclass(frozen=True, slots=True)
class GrayBits:
    """The Gray code of one axis: which pictures show which bit.

    Attributes
    ----------
    bits : most significant first, without gaps: (bit, picture or None, its inverse or None), one of them given.
    step_px, offset_px : as in `Frame`.
    """

    bits: tuple[tuple[int, int | None, int | None], ...]
    step_px: int
    offset_px: float

    @property
    def lowest(self) -> int:
        """The least significant bit that is shown."""
        return self.bits[-1][0]


@dataclass(frozen=True, slots=True)
class Sine:
    """The pictures of one sine, at several shifts.

    Attributes
    ----------
    period_px, offset_px : as in `Frame`.
    pictures, shifts : index of each picture, and its shift in turns; half a turn more for an inverse.
    """

    period_px: float
    offset_px: float
    pictures: tuple[int, ...]
    shifts: tuple[float, ...]


@dataclass(frozen=True, slots=True, repr=False)
class FrameSequence(ShortRepr):
    """A sequence, as a spec: the role of each picture.

    Attributes
    ----------
    projector_size : (width, height).
    frames : of each picture, in the order of file names, or of `files`.
    files : names of the pictures' files, where their order is another than that of their names.
    layout : name of the common layout that these frames are, if any.

    >>> frames = tuple(Frame("phase", "column", period_px=64.0, shift=k / 3) for k in range(3))
    >>> FrameSequence((64, 48), frames).axes
    (0,)
    """

    projector_size: tuple[int, int]
    frames: tuple[Frame, ...]
    files: tuple[str, ...] | None = None
    layout: str | None = None

    def _shown(self) -> Shown:
        width, height = self.projector_size
        codes = ", ".join(f"{code} {number}" for code, number in Counter(frame.code for frame in self.frames).items())
        named = "" if self.layout is None else f", as {self.layout} has it"
        return f"{width} x {height} px, {len(self.frames)} pictures: {codes}{named}", {}

    def __post_init__(self) -> None:
        width, height = whole_numbers(self.projector_size, (2,), "projector_size").tolist()
        require_kinds(self.frames, Frame, "frames")
        if self.files is not None:
            require_kinds(self.files, str, "files")
        if not (1 <= width <= MAX_PROJECTOR_SIDE and 1 <= height <= MAX_PROJECTOR_SIDE):
            raise InputError(
                f"projector_size: expected sides of 1 to {MAX_PROJECTOR_SIDE} pixels, found {width} x {height}"
            )
        if len(self.frames) > MOST_FRAMES:
            raise InputError(f"frames: expected at most {MOST_FRAMES}, found {len(self.frames)}")
        if self.files is not None and len(self.files) != len(self.frames):
            raise InputError(f"files: expected a name for each of {len(self.frames)} frames, found {len(self.files)}")
        if not self.axes:
            raise InputError("frames: expected some of a Gray code or of sines, found none: they tell no coordinate")
        for axis in self.axes:
            gray, sines = self.gray(axis), self.sines(axis)
            reach = _reach(gray, sines)
            first, last = -0.5, self.projector_size[axis] - 0.5
            if not reach >= last - first - 1e-6:
                raise InputError(
                    f"frames: the {AXES[axis]} pictures tell {reach:g} pixels apart, the projector has "
                    f"{self.projector_size[axis]}: expected more bits, a sine of one period, or periods that differ"
                )
            if gray is not None and gray.offset_px > 0 and gray.offset_px + reach > last + 0.5:
                raise InputError(
                    f"offset_px: expected the first pixel of stripe 0, found {gray.offset_px:g}: pixels before it have "
                    f"no code; for a code whose stripe {gray.offset_px:g} is the first pixel write {-gray.offset_px:g}"
                )

    @property
    def axes(self) -> tuple[int, ...]:
        """Which projector coordinates it tells: 0 of columns, 1 of rows."""
        return tuple(axis for axis, name in enumerate(AXES) if any(frame.axis == name for frame in self.frames))

    @property
    def picture_count(self) -> int:
        """One for each frame."""
        return len(self.frames)

    @property
    def names(self) -> list[str]:
        """What each picture shows."""
        return [frame.name for frame in self.frames]

    def gray(self, axis: int) -> GrayBits | None:
        """The Gray code of an axis, None where it has none; an `InputError` where bits are missing between others."""
        found = [(index, f) for index, f in enumerate(self.frames) if f.code == "gray" and f.axis == AXES[axis]]
        if not found:
            return None
        shown: dict[tuple[int, bool], int] = {}
        for index, frame in found:
            key = (frame.bit or 0, frame.inverse)
            if key in shown:
                raise InputError(f"frames[{index}]: {frame.name} is shown twice, by frames[{shown[key]}] too")
            shown[key] = index
        first = found[0][1]
        if any((frame.step_px, frame.offset_px) != (first.step_px, first.offset_px) for _, frame in found):
            raise InputError(f"frames: expected one step_px and offset_px for all {AXES[axis]} bits, found several")
        bits = sorted({bit for bit, _ in shown}, reverse=True)
        if bits[0] - bits[-1] + 1 != len(bits):
            lost = next(bit for bit in range(bits[0], bits[-1], -1) if bit not in bits)
            raise InputError(
                f"frames: expected all bits from {bits[0]} to {bits[-1]}, found no {AXES[axis]} bit {lost}"
            )
        pictures = tuple((bit, shown.get((bit, False)), shown.get((bit, True))) for bit in bits)
        return GrayBits(pictures, first.step_px, first.offset_px)

    def sines(self, axis: int) -> list[Sine]:
        """The sines of an axis, the shortest period first; an `InputError` where shifts are too few or alike."""
        groups: dict[tuple[float, float], list[tuple[int, float]]] = {}
        for index, frame in enumerate(self.frames):
            if frame.code == "phase" and frame.axis == AXES[axis] and frame.period_px and frame.shift is not None:
                shift = frame.shift + (0.5 if frame.inverse else 0.0)
                groups.setdefault((frame.period_px, frame.offset_px), []).append((index, shift))
        sines: list[Sine] = []
        for (period, offset), shown in sorted(groups.items()):
            pictures, shifts = zip(*shown, strict=True)
            angles = 2 * np.pi * np.array(shifts)
            design = np.stack([np.ones_like(angles), np.cos(angles), np.sin(angles)], axis=1)
            determinant = float(np.linalg.det(design.T @ design / len(angles)))
            if len(shown) < FEWEST_SHIFTS or not determinant > LEAST_DETERMINANT:
                raise InputError(
                    f"frames: expected three or more shifts over a turn of each sine, found {len(shown)} of the "
                    f"{AXES[axis]} sine of {period:g} px"
                )
            sines.append(Sine(period, offset, pictures, shifts))
        return sines

    def render(self) -> list[NDArray[np.uint8]]:
        """The pictures (height, width) to project, in order."""
        width, height = self.projector_size
        pictures: list[NDArray[np.uint8]] = []
        for frame in self.frames:
            side = height if frame.axis == "row" else width
            line = np.rint(255 * frame.brightness(np.arange(side, dtype=np.float64))).astype(np.uint8)
            spread = line[:, None] if frame.axis == "row" else line[None, :]
            pictures.append(np.broadcast_to(spread, (height, width)).copy())
        return pictures


def _reach(gray: GrayBits | None, sines: Sequence[Sine]) -> float:
    """How many projector pixels the pictures of an axis tell apart."""
    told = 0.0 if gray is None else float(gray.step_px * 2 ** (gray.bits[0][0] + 1))
    if sines:
        told = max(told, sines[-1].period_px, repeat_px(sines))
    return told


def repeat_px(sines: Sequence[Sine]) -> float:
    """After how many pixels all of these sines are nearly where they were; the first is the shortest."""
    shortest = sines[0].period_px
    turns = 1
    while turns * shortest < MAX_PROJECTOR_SIDE:
        off = [turns * shortest / sine.period_px for sine in sines]
        if max(abs(each - round(each)) for each in off) < SAME_PHASE:
            break
        turns += 1
    return turns * shortest
