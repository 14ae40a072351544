"""Values out of parsed JSON, each checked: what it must be, and what was found."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, cast

from retrue.errors import InputError
from retrue.files.rig_json import shown

LARGEST = 1e9  # of any number; a whole one may be too large to be a float


def required(spec: Mapping[str, Any], key: str) -> Any:
    """The value of a key that must be there."""
    if key not in spec:
        raise InputError(f'key "{key}" is missing')
    return spec[key]


def items(value: Any, name: str, exactly: int | None = None, at_most: int | None = None) -> Sequence[Any]:
    """A list of so many values."""
    if not isinstance(value, list):
        raise InputError(f"{name}: expected a list, found {shown(value)}")
    found = cast(list[Any], value)
    if exactly is not None and len(found) != exactly:
        raise InputError(f"{name}: expected {exactly} values, found {len(found)}")
    if at_most is not None and len(found) > at_most:
        raise InputError(f"{name}: expected at most {at_most} values, found {len(found)}")
    return found


def whole_numbers(value: Any, name: str, count: int, low: int, high: int) -> list[int]:
    """So many whole numbers of that range."""
    return [whole(item, name, low, high) for item in items(value, name, exactly=count)]


def whole(value: Any, name: str, low: int, high: int) -> int:
    """A whole number of that range, however it is written."""
    if not (isinstance(value, (int, float)) and not isinstance(value, bool) and value == math.floor(value)):
        raise InputError(f"{name}: expected a whole number, found {shown(value)}")
    if not low <= value <= high:
        raise InputError(f"{name}: expected {low} to {high}, found {shown(value)}")
    return int(value)


def number(value: Any, name: str) -> float:
    """A finite number."""
    if not (isinstance(value, (int, float)) and not isinstance(value, bool) and -LARGEST <= value <= LARGEST):
        raise InputError(f"{name}: expected a finite number, found {shown(value)}")
    return float(value)


def positive(value: Any, name: str) -> float:
    """A finite number above zero."""
    found = number(value, name)
    if not found > 0:
        raise InputError(f"{name}: expected a positive number, found {found:g}")
    return found


def text(value: Any, name: str) -> str:
    """A string."""
    if not isinstance(value, str):
        raise InputError(f"{name}: expected text, found {shown(value)}")
    return value
