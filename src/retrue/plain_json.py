"""Values as JSON has them; NaN and infinity become null."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Any, cast

import numpy as np


def plain(value: Any) -> Any:
    """`value` with nothing in it that JSON does not have.

    >>> plain({"rms": float("nan"), "t": np.array([1.5, 2.0]), "planes": (np.int64(3),)})
    {'rms': None, 't': [1.5, 2.0], 'planes': [3]}
    """
    if type(value) in (str, int, bool, type(None)):  # most are, and the questions below take their time
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, np.ndarray | np.generic):
        return plain(cast("Any", value).tolist())
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in cast("Mapping[Any, Any]", value).items()}
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        return [plain(item) for item in cast("Sequence[Any]", value)]
    if isinstance(value, int | str):
        return value
    if isinstance(value, PurePath):
        return str(value)
    raise TypeError(f"{type(value).__name__} has no place in JSON")
