"""The pattern kind `sequence` as JSON: the role of each frame, or the name of a common layout that stands for them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

from retrue.errors import InputError
from retrue.files.json_values import items, number, positive, required, shown, text, whole
from retrue.patterns.gray_code import MAX_BITS, MAX_PROJECTOR_SIDE
from retrue.patterns.layouts import LAYOUTS, layout_sequence
from retrue.patterns.sequence import AXES, MOST_FRAMES, Frame, FrameSequence

LONGEST_NAME = 1000  # of a file
CODES = ("gray", "phase", "white", "black", "ignore")


def read_sequence(spec: Mapping[str, Any], projector_size: tuple[int, int]) -> FrameSequence:
    """The sequence that a spec tells; an `InputError` names the frame where something is not what it must be.

    `step_px` and `offset_px` may stand beside `frames`, for all of them, and in each.
    """
    common = {key: spec[key] for key in ("step_px", "offset_px") if key in spec}
    files = _files(spec["files"]) if "files" in spec else None
    if "layout" in spec and "frames" not in spec:
        made = _layout(spec, projector_size)
        return FrameSequence(projector_size, made.frames, files, None if files else made.layout)
    frames: list[Frame] = []
    for index, item in enumerate(items(required(spec, "frames"), "frames", at_most=MOST_FRAMES)):
        if not isinstance(item, dict):
            raise InputError(f"frames[{index}]: expected an object with its code, found {shown(item)}")
        try:
            frames.append(_frame({**common, **cast("dict[str, Any]", item)}))
        except InputError as error:
            raise InputError(f"frames[{index}]: {error}") from error
    return FrameSequence(projector_size, tuple(frames), files)


def sequence_spec(pattern: FrameSequence) -> dict[str, Any]:
    """The same as plain values."""
    frames = [_frame_spec(frame) for frame in pattern.frames]
    files = {} if pattern.files is None else {"files": list(pattern.files)}
    return {"kind": "sequence", "projector_size": pattern.projector_size, "frames": frames, **files}


def _layout(spec: Mapping[str, Any], projector_size: tuple[int, int]) -> FrameSequence:
    name = text(spec["layout"], "layout")
    if name not in LAYOUTS:
        raise InputError(f"layout: expected one of {', '.join(LAYOUTS)}, found {shown(name)}")
    axes = None if "axes" not in spec else [text(axis, "axes") for axis in items(spec["axes"], "axes", at_most=2)]
    return layout_sequence(name, projector_size, axes, whole(spec.get("step_px", 1), "step_px", 1, max(projector_size)))


def _frame(item: Mapping[str, Any]) -> Frame:
    code = required(item, "code")
    if code not in CODES:
        raise InputError(f"code: expected one of {', '.join(CODES)}, found {shown(code)}")
    if code not in ("gray", "phase"):
        return Frame(code)
    axis = required(item, "axis")
    if axis not in AXES:
        raise InputError(f'axis: expected "column" or "row", found {shown(axis)}')
    inverse = item.get("inverse", False)
    if not isinstance(inverse, bool):
        raise InputError(f"inverse: expected true or false, found {shown(inverse)}")
    offset = number(item.get("offset_px", 0), "offset_px")
    if code == "gray":
        bit = whole(required(item, "bit"), "bit", 0, MAX_BITS - 1)
        step = whole(item.get("step_px", 1), "step_px", 1, MAX_PROJECTOR_SIDE)
        return Frame("gray", axis, bit=bit, inverse=inverse, step_px=step, offset_px=offset)
    period = positive(required(item, "period_px"), "period_px")
    shift = number(required(item, "shift"), "shift")
    return Frame("phase", axis, inverse=inverse, period_px=period, shift=shift, offset_px=offset)


def _frame_spec(frame: Frame) -> dict[str, Any]:
    if frame.axis is None:
        return {"code": frame.code}
    spec: dict[str, Any] = {"axis": frame.axis, "code": frame.code}
    if frame.code == "gray":
        spec["bit"] = frame.bit
    else:
        spec |= {"period_px": frame.period_px, "shift": frame.shift}
    if frame.inverse:
        spec["inverse"] = True
    if frame.step_px != 1:
        spec["step_px"] = frame.step_px
    if frame.offset_px:
        spec["offset_px"] = frame.offset_px
    return spec


def _files(value: Any) -> tuple[str, ...]:
    names = tuple(text(name, "files") for name in items(value, "files", at_most=MOST_FRAMES))
    if any(not 0 < len(name) <= LONGEST_NAME for name in names):
        raise InputError("files: expected names of files, found an empty or endless one")
    if len(set(names)) != len(names):
        raise InputError("files: expected each name once, found one twice")
    return names
