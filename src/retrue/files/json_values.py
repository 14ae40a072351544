"""JSON from strangers: read strictly, and its values checked: what each must be, and what was found."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn, cast

from retrue.errors import FileError, InputError

LARGEST = 1e9  # of any number; a whole one may be too large to be a float
LONGEST_SHOWN = 40  # characters


def parse_json(path: Path, text: str) -> dict[str, Any]:
    """The JSON object in `text`: strict, so no NaN, no infinity, no key twice; a `FileError` names `path`."""
    try:
        value = STRICT.decode(text)
    except (ValueError, RecursionError) as error:
        raise FileError(path, f"expected JSON, found {error}") from error
    if not isinstance(value, dict):
        raise FileError(path, f"expected a JSON object, found {kind_of(value)}")
    return cast(dict[str, Any], value)


def shown(value: Any) -> str:
    """A parsed value as JSON, cut so that it fits on the line of an error, and not written any further.

    >>> shown([["a\\n"], 1e3, None]), len(shown([[0]] * 10**6))
    ('[["a\\\\n"], 1000.0, null]', 40)
    """
    text = ""
    for piece in json.JSONEncoder().iterencode(value):
        text += piece
        if len(text) > LONGEST_SHOWN:
            return text[: LONGEST_SHOWN - 3] + "..."
    return text


def kind_of(value: object) -> str:
    """What a parsed value is, in words."""
    if value is None:
        return "null"
    kinds = {dict: "an object", list: "a list with other values", str: "a string", bool: "a truth value"}
    return next((name for kind, name in kinds.items() if isinstance(value, kind)), "a number")


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


def _no_constant(token: str) -> NoReturn:
    raise ValueError(f"{token}, which is no number")


def _finite(digits: str) -> float:
    number = float(digits)
    if not math.isfinite(number):
        raise ValueError(f"{digits[:LONGEST_SHOWN]}, which is no finite number")
    return number


def _no_key_twice(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    members = dict(pairs)
    if len(members) != len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key, count in Counter(keys).items() if count > 1)
        raise ValueError(f"the key {twice[:LONGEST_SHOWN]!r} twice")
    return members


STRICT = json.JSONDecoder(parse_constant=_no_constant, parse_float=_finite, object_pairs_hook=_no_key_twice)
