"""Array types, and the checks that every value passes on its way in."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from retrue.errors import InputError, in_brief, require_kind

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
Image = NDArray[Any]
"""(height, width) or (height, width, channels), uint8 or uint16; colour in the order red, green, blue."""

Cut = slice | NDArray[np.intp]
"""Which rows, or columns, of a picture."""

LARGEST_SIDE = 1_000_000  # of a raster, in pixels


def finite_array(value: ArrayLike, shape: tuple[int | None, ...], name: str) -> FloatArray:
    """`value` as a float64 array of that shape (None: any length), or an `InputError` that names it.

    >>> finite_array([[1, 2]], (None, 2), "points").shape
    (1, 2)
    """
    array = array_of(value, shape, name)
    if not np.isfinite(array).all():
        raise InputError(f"{name}: expected finite numbers, found NaN or infinity")
    return array


def array_of(value: ArrayLike, shape: tuple[int | None, ...], name: str) -> FloatArray:
    """The same, where a number may be NaN: not known."""
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{name}: expected numbers of shape {_shape(shape)}, found {in_brief(value)}") from error
    if array.shape != shape and (
        array.ndim != len(shape)
        or any(want is not None and have != want for want, have in zip(shape, array.shape, strict=True))
    ):
        raise InputError(f"{name}: expected shape {_shape(shape)}, found {_shape(array.shape)}")
    return array


def frozen_array(value: ArrayLike, dtype: type[np.generic] = np.float64) -> NDArray[Any]:
    """A read-only copy, for the fields of frozen dataclasses; itself where nobody can write to it."""
    array = np.asarray(value)
    if array.dtype == dtype and array.flags.owndata and not array.flags.writeable:
        return array
    copy = np.array(array, dtype=dtype)
    copy.setflags(write=False)
    return copy


def whole_size(value: ArrayLike, name: str) -> tuple[int, int]:
    """`value` as (width, height) of a raster, or an `InputError` that names it.

    >>> whole_size([1280.0, 960.0], "size")
    (1280, 960)
    """
    size = finite_array(value, (2,), name)
    if not ((size >= 1).all() and (size == np.round(size)).all() and (size <= LARGEST_SIDE).all()):
        raise InputError(f"{name}: expected width and height in whole pixels, found {in_brief(value)}")
    return int(size[0]), int(size[1])


def whole_numbers(value: ArrayLike, shape: tuple[int | None, ...], name: str) -> IntArray:
    """`value` as integers in an array of that shape (None: any length), or an `InputError` that names it.

    >>> whole_numbers([[255.0, 0, 127]], (None, 3), "colors").tolist()
    [[255, 0, 127]]
    """
    array = finite_array(value, shape, name)
    if not ((array == np.round(array)) & (np.abs(array) < 2**53)).all():
        raise InputError(f"{name}: expected whole numbers, found {in_brief(value)}")
    return array.astype(np.int64)


def require_picture(value: object, name: str) -> None:
    """An `InputError` where `value` is no picture, as `retrue.read_image` reads one."""
    require_kind(value, np.ndarray, name, "retrue.read_image reads one")
    picture = np.asarray(value)
    if not (picture.size and picture.dtype.name in ("uint8", "uint16") and picture.shape[2:] in ((), (3,))):
        shape = " x ".join(map(str, picture.shape))
        raise InputError(f"{name}: expected grey or RGB of uint8 or uint16, found {shape} of {picture.dtype}")


def centred(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points (N, 2) about their mean, and that (2,). As complex numbers: NumPy takes rows of two one at a time.

    >>> [part.tolist() for part in centred(np.array([[0.0, 1.0], [4.0, 3.0]]))]
    [[[-2.0, -1.0], [2.0, 1.0]], [2.0, 2.0]]
    """
    middle = mean_point(points)
    return (np.ascontiguousarray(points).view(np.complex128) - complex(*middle)).view(np.float64), middle


def mean_point(points: FloatArray) -> FloatArray:
    """(2,) mean of points (N, 2), likewise.

    >>> mean_point(np.array([[0.0, 1.0], [4.0, 3.0]])).tolist()
    [2.0, 2.0]
    """
    middle = np.ascontiguousarray(points).view(np.complex128).mean()
    return np.array([middle.real, middle.imag])


def _shape(shape: tuple[int | None, ...]) -> str:
    return " x ".join("N" if length is None else str(length) for length in shape)
