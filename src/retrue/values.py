"""Frozen dataclasses that hold arrays, as values: nobody writes into them, and equal numbers make them equal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:  # what has no arrays needs no NumPy
    from _typeshed import DataclassInstance


class ByValue:
    """Base of a frozen dataclass (`eq=False`) whose arrays are read-only, and which equals what holds the same numbers.

    Arrays are equal where they have one shape and the same numbers, NaN in the same places; so are what mappings and
    sequences hold. Equal values have one hash, so that a rig can be the key of a dictionary. The arrays are not copied:
    where others may write to them, a class does that in a `__post_init__` of its own.
    """

    __slots__ = ()

    def __post_init__(self) -> None:
        for item in fields(cast("DataclassInstance", self)):
            object.__setattr__(self, item.name, _read_only(getattr(self, item.name)))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(_held(self))  # so that copies go through the checks, and are read-only too

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        return self is other or all(_same(mine, its) for mine, its in zip(_held(self), _held(other), strict=True))

    def __hash__(self) -> int:
        return hash((type(self).__name__, *map(_key, _held(self))))


def _held(instance: object) -> list[Any]:
    return [getattr(instance, item.name) for item in fields(cast("DataclassInstance", instance))]


def _read_only(value: Any) -> Any:
    if _is_array(value) and value.flags.writeable:
        value = value.view()
        value.flags.writeable = False
    elif type(value) is tuple:
        return tuple(map(_read_only, cast("tuple[Any, ...]", value)))
    elif type(value) is dict:
        return {key: _read_only(item) for key, item in cast("dict[Any, Any]", value).items()}
    return value


def _same(a: Any, b: Any) -> bool:
    if _is_array(a) or _is_array(b):
        import numpy as np

        return _is_array(a) and _is_array(b) and a.dtype.kind == b.dtype.kind and np.array_equal(a, b, equal_nan=True)
    if _is_mapping(a) and _is_mapping(b):
        return a.keys() == b.keys() and all(_same(value, b[key]) for key, value in a.items())
    if _is_sequence(a) and _is_sequence(b):
        return len(a) == len(b) and all(map(_same, a, b))
    return bool(a == b) or (a != a and b != b)


def _key(value: Any) -> Any:
    """Something to hash, the same for what `_same` calls so."""
    if _is_array(value):
        return value.shape, (value + 0.0).tobytes()  # minus zero equals zero
    if _is_mapping(value):
        return len(value)
    if _is_sequence(value):
        return tuple(map(_key, value))
    return 0 if value != value else value


def _is_array(value: Any) -> bool:
    return getattr(value, "ndim", 0) > 0  # a NumPy scalar is a number


def _is_mapping(value: Any) -> bool:
    return isinstance(value, Mapping)


def _is_sequence(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)
