"""The sequences that common tools project, by name.

Each is a function from the projector's size, the axes and the step to frames. Sources: the tools' own code
(jakobwilm/slstudio, src/codec; jhdewitt/sltk, sldisp.cpp; scan3d-capture of Moreno and Taubin, ProjectorWidget.cpp;
kamino410/procam-calibration and OpenCV's GrayCodePattern; elerac/structuredlight; theICTlab/3DUNDERWORLD-SLS-GPU_CPU).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, cast

from retrue.errors import InputError, require_choice, require_kinds
from retrue.geometry.arrays import whole_size
from retrue.patterns.gray_code import GrayCode
from retrue.patterns.sequence import AXES, Frame, FrameSequence
from retrue.ranges import require_number

Size = tuple[int, int]
Axis = Literal["column", "row"]
WHITE, BLACK = Frame("white"), Frame("black")
SLSTUDIO_GRAY_BITS = {"column": 10, "row": 6}


@dataclass(frozen=True, slots=True)
class Layout:
    """How one tool orders its pictures.

    Attributes
    ----------
    description : in a few words, for `--help` and the manual.
    frames : (projector_size, axes, step_px) -> frames.
    axes : what the tool shows where nobody says; a capture of the first one only is taken, too.
    """

    description: str
    frames: Callable[[Size, Sequence[Axis], int], list[Frame]]
    axes: tuple[Axis, ...] = ("column", "row")


def layout_sequence(
    name: str, projector_size: Size, axes: Sequence[str] | None = None, step_px: int = 1
) -> FrameSequence:
    """The sequence of a common layout.

    >>> layout_sequence("procam-calibration", (1024, 768)).picture_count
    42
    >>> layout_sequence("slstudio-2x3", (1824, 1140), ["column"]).names[5]
    'column sine of 1824 px, shifted by 0.667'
    """
    require_choice(name, LAYOUTS, "layout")
    projector_size = whole_size(projector_size, "projector_size")
    require_number(step_px, "step_px", 1, whole=True)
    if axes is not None:
        require_kinds(axes, str, "axes")
    layout = LAYOUTS[name]
    if axes is not None and not (axes and len(set(axes)) == len(axes) and set(axes) <= set(AXES)):
        raise InputError(f'axes: expected "column", "row" or both, found {list(axes)}')
    chosen = layout.axes if axes is None else tuple(axis for axis in AXES if axis in axes)
    frames = layout.frames(projector_size, cast("Sequence[Axis]", chosen), step_px)
    return FrameSequence(projector_size, tuple(frames), layout=name)


def sequence_of(pattern: GrayCode) -> FrameSequence:
    """A Gray code as the sequence that it is, white and black last.

    >>> sequence_of(GrayCode((1024, 768))).picture_count
    42
    """
    frames: list[Frame] = []
    for axis, bits, first in zip(AXES, pattern.bits, pattern.offset, strict=True):
        offset_px = -first * pattern.step
        frames += gray_frames(axis, range(bits)[::-1], inverses=True, step_px=pattern.step, offset_px=offset_px)
    return FrameSequence(pattern.projector_size, (*frames, WHITE, BLACK))


def as_captured(pattern: FrameSequence, count: int) -> FrameSequence:
    """The same layout with the axes that a capture of so many pictures has: columns alone, where that is its number.

    Itself where the number fits, or nothing does.
    """
    if pattern.layout is None or count == pattern.picture_count or pattern.files is not None:
        return pattern
    for smaller in _variants(pattern):
        if smaller.picture_count == count:
            return smaller
    return pattern


def _variants(pattern: FrameSequence) -> Iterator[FrameSequence]:
    for axes in ({"column", None}, {"row", None}, {"column", "row", None}):
        frames = [frame for frame in pattern.frames if frame.axis in axes]
        if any(frame.axis for frame in frames):
            yield replace(pattern, frames=tuple(frames))
            yield replace(pattern, frames=tuple(frame for frame in frames if frame.axis))


def bits_of(codes: int) -> int:
    """Bits that tell so many codes apart."""
    return max((codes - 1).bit_length(), 1)


def gray_frames(
    axis: Axis, bits: Sequence[int], *, inverses: bool, step_px: int = 1, offset_px: float = 0
) -> list[Frame]:
    """The bits of one axis in that order, each followed by its inverse where there are any."""
    kinds = (False, True) if inverses else (False,)
    return [
        Frame("gray", axis, bit=bit, inverse=inverse, step_px=step_px, offset_px=offset_px)
        for bit in bits
        for inverse in kinds
    ]


def sine_frames(axis: Axis, period_px: float, steps: int) -> list[Frame]:
    """One sine at `steps` shifts of equal distance."""
    return [Frame("phase", axis, period_px=period_px, shift=k / steps) for k in range(steps)]


def _side(size: Size, axis: Axis) -> int:
    return size[AXES.index(axis)]


def _pairs(size: Size, axes: Sequence[Axis], step_px: int) -> list[Frame]:
    """Columns, then rows, most significant bit first, each with its inverse."""
    return [
        frame
        for axis in axes
        for frame in gray_frames(
            axis, range(bits_of(-(-_side(size, axis) // step_px)))[::-1], inverses=True, step_px=step_px
        )
    ]


def _opencv(size: Size, axes: Sequence[Axis], step_px: int) -> list[Frame]:
    return [*_pairs(size, axes, step_px), WHITE, BLACK]


def _underworld(size: Size, axes: Sequence[Axis], step_px: int) -> list[Frame]:
    return [WHITE, BLACK, *_pairs(size, axes, step_px)]


def _sltk(size: Size, axes: Sequence[Axis], step_px: int) -> list[Frame]:
    bits = bits_of(-(-max(size) // step_px))  # of either axis, so that the rows' first pictures may stay dark
    return [f for axis in axes for f in gray_frames(axis, range(bits)[::-1], inverses=True, step_px=step_px)]


def _scan3d(size: Size, axes: Sequence[Axis], step_px: int) -> list[Frame]:
    count = min(bits_of(side) for side in size)  # as many for either axis
    frames = [WHITE, BLACK]
    for axis in axes:
        side = _side(size, axis)
        bits = bits_of(side)
        centred = -((2**bits - side) // 2)
        frames += gray_frames(axis, range(bits - count, bits)[::-1], inverses=True, offset_px=centred)
    return _stepless("scan3d-capture", step_px, frames)


def _structuredlight(size: Size, axes: Sequence[Axis], step_px: int) -> list[Frame]:
    frames = [f for axis in axes for f in gray_frames(axis, range(bits_of(_side(size, axis)))[::-1], inverses=False)]
    return _stepless("structuredlight", step_px, frames)


def _structuredlight_phase(size: Size, axes: Sequence[Axis], step_px: int) -> list[Frame]:
    frames = [Frame("phase", axis, period_px=float(_side(size, axis)), shift=-k / 3) for axis in axes for k in range(3)]
    return _stepless("structuredlight-phase", step_px, frames)


def _slstudio_gray(size: Size, axes: Sequence[Axis], step_px: int) -> list[Frame]:
    frames = [WHITE, BLACK]
    for axis in axes:
        bits = bits_of(_side(size, axis))
        frames += gray_frames(axis, range(bits)[::-1][: SLSTUDIO_GRAY_BITS[axis]], inverses=False)
    return _stepless("slstudio-gray", step_px, frames)


def _slstudio_sines(periods: int, steps: int) -> Callable[[Size, Sequence[Axis], int], list[Frame]]:
    """So many periods at so many shifts, then one period at three, the cue; one period needs none."""

    def frames(size: Size, axes: Sequence[Axis], step_px: int) -> list[Frame]:
        made: list[Frame] = []
        for axis in axes:
            made += sine_frames(axis, _side(size, axis) / periods, steps)
            made += sine_frames(axis, float(_side(size, axis)), 3) if periods > 1 else []
        return _stepless("slstudio", step_px, made)

    return frames


def _stepless(name: str, step_px: int, frames: list[Frame]) -> list[Frame]:
    if step_px != 1:
        raise InputError(f"step_px: {name} has none, found {step_px}")
    return frames


LAYOUTS: dict[str, Layout] = {
    "procam-calibration": Layout("Gray, pattern and inverse, columns, rows, white, black", _opencv),
    "opencv": Layout("OpenCV's GrayCodePattern with its white and black, the same order", _opencv),
    "3dunderworld": Layout("white, black, then Gray, pattern and inverse, columns, rows", _underworld),
    "scan3d-capture": Layout(
        "white, black, then Gray centred in its code, pattern and inverse, columns, rows", _scan3d
    ),
    "sltk": Layout("Gray, as many bits for rows as for columns, pattern and inverse, no white, no black", _sltk),
    "structuredlight": Layout("Gray of columns, without inverses, white and black", _structuredlight, ("column",)),
    "structuredlight-phase": Layout("one sine over the columns, three shifts", _structuredlight_phase, ("column",)),
    "slstudio-gray": Layout("white, black, then ten column bits and six row bits, no inverses", _slstudio_gray),
    "slstudio-2x3": Layout(
        "sixteen periods at three shifts, then one period at three; columns, rows", _slstudio_sines(16, 3)
    ),
    "slstudio-nstep": Layout(
        "eight periods at nine shifts, then one period at three; columns, rows", _slstudio_sines(8, 9)
    ),
    "slstudio-3": Layout("one period at three shifts", _slstudio_sines(1, 3), ("column",)),
    "slstudio-4": Layout("one period at four shifts", _slstudio_sines(1, 4), ("column",)),
}
