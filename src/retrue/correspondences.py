"""Camera pixel <-> projector pixel, the one thing that every decoder returns and every job takes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from retrue.errors import CaptureError, InputError, require_kind, require_kinds
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray, finite_array, frozen_array, whole_size
from retrue.shown import ShortRepr, Shown, counted
from retrue.values import ByValue

T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class Card(ByValue):
    """What a decoder has to say of a capture, counted in what it decodes: pixels of a Gray code, blocks of a
    colour grid, crossings of a line grid, features of a photograph.

    Attributes
    ----------
    counted : "pixels", "blocks", "crossings" or "features".
    seen : how many the projector was seen to light, or the photograph has, decoded : how many became points.
    rejected : the others, by reason.
    coverage : share of the picture.
    advice : what to change, a sentence each.
    details : what only this decoder measures.
    """

    counted: Literal["pixels", "blocks", "crossings", "features"]
    seen: int
    decoded: int
    rejected: Mapping[str, int]
    coverage: float
    advice: tuple[str, ...] = ()
    details: Mapping[str, Any] = field(default_factory=dict[str, Any])


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Correspondences(ByValue, ShortRepr):
    """N matched pixels, only valid ones. (0, 0) is the centre of the top-left pixel, in both devices.

    Attributes
    ----------
    camera_px : (N, 2) float64, (x, y).
    projector_px : (N, 2) float64, (x, y). Of a capture that tells one coordinate only, as columns alone do, the other
        column is NaN, all of it.
    camera_sigma_px, projector_sigma_px : (N,) standard deviation of each point's noise, per axis, or
        None where the decoder cannot tell. Only their ratios need to be right: jobs estimate the level.
    projector_sigma_ratio : (N,) sigma of the projector's x over that of its y, where one is better known than the
        other; `projector_sigma_px` is their root mean square. None: alike.
    confidence : (N,) in 0 .. 1, or None.
    colors : (N, 3) uint8 red, green, blue of the scene, or None.
    cells : (N, 2) int, (row, column) in a grid whose neighbours are neighbours on the surface: camera
        pixels for a dense code, blocks for a colour grid. None where the points have no topology.
    card : what the decoder has to say; None where the points come from elsewhere.
    light : (N,) what the projector alone adds at each point, in any unit; NaN where that is not known, as where the
        picture is saturated.
    light_class : (N,) int. Points of one class share a constant factor of `light`, as blocks of one colour do; None
        where all points do.
    camera_size, projector_size : (width, height) of the rasters that the pixels are of; None where nobody said.
    """

    camera_px: FloatArray
    projector_px: FloatArray
    camera_sigma_px: FloatArray | None = None
    projector_sigma_px: FloatArray | None = None
    confidence: FloatArray | None = None
    colors: NDArray[np.uint8] | None = None
    cells: IntArray | None = None
    card: Card | None = None
    light: FloatArray | None = None
    light_class: IntArray | None = None
    camera_size: tuple[int, int] | None = None
    projector_size: tuple[int, int] | None = None
    projector_sigma_ratio: FloatArray | None = None

    def __post_init__(self) -> None:
        camera_px = finite_array(self.camera_px, (None, 2), "camera_px")
        projector_px = _known_axes(self.projector_px)
        object.__setattr__(self, "camera_px", frozen_array(camera_px))
        object.__setattr__(self, "projector_px", frozen_array(projector_px))
        for name, (dtype, row) in OPTIONAL_COLUMNS.items():
            column = getattr(self, name)
            if column is not None:
                object.__setattr__(self, name, _column(column, dtype, row, name))
        for name in ("projector_px", *OPTIONAL_COLUMNS):
            column = getattr(self, name)
            if column is not None and len(column) != len(camera_px):
                raise InputError(f"{name}: expected {len(camera_px)} rows as in camera_px, found {len(column)}")
        for name in SIGMAS:
            column = getattr(self, name)
            if column is not None and (column < 0).any():
                raise InputError(f"{name}: expected no number below 0, found {column[column < 0][0]:g}")
        for name in SIZES:
            size = getattr(self, name)
            if size is not None:
                object.__setattr__(self, name, whole_size(size, name))

    def __len__(self) -> int:
        return len(self.camera_px)

    @property
    def axes(self) -> tuple[int, ...]:
        """Which projector coordinates are known: (0, 1), only (0,), columns, or only (1,), rows.

        >>> Correspondences([[320, 240]], [[100.5, np.nan]]).axes
        (0,)
        """
        return tuple(axis for axis in range(2) if not (len(self) and np.isnan(self.projector_px[0, axis])))

    def select(self, rows: IntArray | BoolArray) -> Correspondences:
        """The same, with only those rows (a mask or indices)."""
        columns = ("camera_px", "projector_px", *OPTIONAL_COLUMNS)
        kept = {name: None if (column := getattr(self, name)) is None else column[rows] for name in columns}
        return replace(self, **kept)

    def _shown(self) -> Shown:
        rows = {name: _extent(getattr(self, name)) for name in ("camera_px", "projector_px") if len(self)}
        columns = [name for name in OPTIONAL_COLUMNS if getattr(self, name) is not None]
        if columns:
            rows["with"] = ", ".join(columns)
        for name in SIZES:
            if size := getattr(self, name):
                rows[name] = f"{size[0]} x {size[1]}"
        if self.card is not None and self.card.advice:
            rows["advice"] = "; ".join(self.card.advice)
        return counted(len(self), "point"), rows


def _extent(pixels: FloatArray) -> str:
    known = [(name, column) for name, column in zip("xy", pixels.T, strict=True) if not np.isnan(column[0])]
    return ", ".join(f"{name} {round(column.min())} to {round(column.max())}" for name, column in known)


def _known_axes(value: ArrayLike) -> FloatArray:
    """`projector_px` as (N, 2): finite, but for one column that may be NaN from top to bottom."""
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return finite_array(value, (None, 2), "projector_px")
    if array.ndim == 2 and array.shape[1] == 2 and len(array):
        unknown = np.isnan(array[0])
        if unknown.any() and not unknown.all():
            missing = int(unknown.argmax())
            finite_array(array[:, [1 - missing]], (None, 1), "projector_px")
            if np.isnan(array[:, missing]).all():
                return array
    return finite_array(array, (None, 2), "projector_px")


def _column(value: ArrayLike, dtype: type[np.generic], row: tuple[int, ...], name: str) -> NDArray[Any]:
    """A read-only column; an `InputError` where its rows are of another shape, or do not fit the type."""
    array = np.asarray(value)
    if array.ndim != 1 + len(row) or array.shape[1:] != row:
        expected = " x ".join(map(str, ("N", *row)))
        raise InputError(f"{name}: expected shape {expected}, found {' x '.join(map(str, array.shape)) or 'a number'}")
    if array.dtype.kind not in "biuf":
        raise InputError(f"{name}: expected numbers, found {'text' if array.dtype.kind in 'US' else array.dtype}")
    with np.errstate(invalid="ignore"):
        column = frozen_array(array, dtype)
    if array.dtype != dtype and not np.array_equal(column, array, equal_nan=array.dtype.kind == "f"):
        raise InputError(f"{name}: expected numbers that {np.dtype(dtype)} holds, found others as {array.dtype}")
    return column


def require_points(value: object) -> None:
    """An `InputError` that says what to hand in where `value` is no `Correspondences`."""
    require_kind(value, Correspondences, "points", READERS)


def require_both_axes(points: Correspondences, name: str | Path = "points") -> None:
    """A `CaptureError` where only columns or only rows are known, and a pose is asked for.

    One coordinate gives depth, ray by ray, but next to nothing about how the devices stand to each other: from six
    planes of columns alone a pose is 1 to 6 degrees off.
    """
    if len(points.axes) < 2:
        known, other = ("columns", "row") if points.axes == (0,) else ("rows", "column")
        raise CaptureError(
            name,
            f"expected both projector coordinates, found {known} only, which do not hold a pose: take a few {other} "
            f"pictures too, or reconstruct, which needs no more",
        )


def require_captures(values: object) -> None:
    """An `InputError` where `values` is no list of `Correspondences`, or an empty one."""
    require_kinds(values, Correspondences, "captures", READERS)
    if not values:
        raise InputError("captures: expected at least one, found none")


def require_each_once(captures: Sequence[tuple[str | Path, Correspondences]]) -> None:
    """A `CaptureError` where captures, by name, hold the same points: noise repeats in none that was taken again."""
    if repeated := repeated_in([points for _, points in captures], same_points):
        first, second = (captures[index][0] for index in repeated[0])
        raise CaptureError(
            second, f"holds the same points as {first}, and would count twice: hand in each capture once"
        )


def repeated_in(values: Sequence[T], same: Callable[[T, T], bool]) -> list[tuple[int, int]]:
    """(first, again) for each of the values that is the same as one before it.

    >>> repeated_in([3, 4, 3, 3], lambda one, other: one == other)
    [(0, 2), (0, 3)]
    """
    found: list[tuple[int, int]] = []
    for again, value in enumerate(values):
        first = next((index for index in range(again) if same(values[index], value)), again)
        found += [(first, again)] if first < again else []
    return found


def each_once(values: Sequence[T], same: Callable[[T, T], bool]) -> list[T]:
    """The values without those that are the same as one before them.

    >>> each_once([3, 4, 3, 3], lambda one, other: one == other)
    [3, 4]
    """
    repeated = {again for _, again in repeated_in(values, same)}
    return [value for index, value in enumerate(values) if index not in repeated]


def same_points(one: Correspondences, other: Correspondences) -> bool:
    """Whether they hold the same matches to the last bit, some at least, in any order."""
    return 0 < len(one) == len(other) and np.array_equal(_sorted(one), _sorted(other), equal_nan=True)


def _sorted(points: Correspondences) -> FloatArray:
    rows = np.hstack([points.camera_px, points.projector_px])
    return rows[np.lexsort(rows.T)]


READERS = "retrue.read_capture decodes pictures, retrue.read_points reads a table"
SIGMAS = ("camera_sigma_px", "projector_sigma_px", "projector_sigma_ratio")
SIZES = ("camera_size", "projector_size")
OPTIONAL_COLUMNS: dict[str, tuple[type[np.generic], tuple[int, ...]]] = {  # what each row is
    "camera_sigma_px": (np.float64, ()),
    "projector_sigma_px": (np.float64, ()),
    "projector_sigma_ratio": (np.float64, ()),
    "confidence": (np.float64, ()),
    "colors": (np.uint8, (3,)),
    "cells": (np.int64, (2,)),
    "light": (np.float64, ()),
    "light_class": (np.int64, ()),
}
