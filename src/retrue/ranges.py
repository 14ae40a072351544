"""Options that declare their ranges: what a number may be stands beside its default, and is checked when one is set.

@dataclass(frozen=True, slots=True)
class RecalibrateOptions:
    max_outliers: float = ranged(0.65, 0, 1)

    def __post_init__(self) -> None:
        check_ranges(self)
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from math import inf, isfinite
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, TypeVar

from retrue.errors import InputError, in_brief

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Number = TypeVar("Number", int, float, float | None)


@dataclass(frozen=True, slots=True)
class Range:
    """Which numbers an option may be.

    Attributes
    ----------
    least, most : both included.
    above : without `least` itself.
    whole : integers only.

    >>> print(Range(0, 1)), 0.5 in Range(0, 1), float("nan") in Range(0, 1)
    0 to 1
    (None, True, False)
    >>> print(Range(0, above=True))
    more than 0
    """

    least: float
    most: float = inf
    above: bool = False
    whole: bool = False

    def __contains__(self, value: object) -> bool:
        if isinstance(value, bool) or not isinstance(value, Integral if self.whole else Real):
            return False
        number = float(value)
        return (number > self.least or (number == self.least and not self.above)) and number <= self.most

    def __str__(self) -> str:
        if self.least == -inf and self.most == inf:
            return "a whole number" if self.whole else "a finite number"
        low = f"{self.least:.12g}"
        limits = {
            (False, False): f"{low} to {self.most:.12g}",
            (False, True): f"{low} or more",
            (True, False): f"more than {low}, at most {self.most:.12g}",
            (True, True): f"more than {low}",
        }[self.above, self.most == inf]
        return f"a whole number, {limits}" if self.whole else limits


def ranged(default: Number, least: float, most: float = inf, *, above: bool = False) -> Number:
    """The field of an option with that default; None, where it is the default, stands for "not given".

    An option whose default is an `int` takes whole numbers only.
    """
    allowed = Range(least, most, above, isinstance(default, int))
    return field(default=default, metadata={"range": allowed})


def check_ranges(options: DataclassInstance) -> None:
    """An `InputError` that names the option, what it may be and what it is, for the first one out of its range."""
    for name, allowed in declared_ranges(type(options)).items():
        value: Any = getattr(options, name)
        if not (value in allowed or (value is None and _may_be_none(options, name))):
            raise InputError(f"{name}: expected {allowed}, found {in_brief(value)}")


def require_number(
    value: Any, name: str, least: float = -inf, most: float = inf, *, above: bool = False, whole: bool = False
) -> None:
    """An `InputError` that names it, where `value` is no number, NaN, infinite or out of that range.

    >>> try:
    ...     require_number("75mm", "spacing", 0, above=True)
    ... except InputError as error:
    ...     print(error)
    spacing: expected more than 0, found '75mm'
    """
    allowed = Range(least, most, above, whole)
    if not (value in allowed and isfinite(value)):
        raise InputError(f"{name}: expected {allowed}, found {in_brief(value)}")


def declared_ranges(options: type[DataclassInstance]) -> dict[str, Range]:
    """The range of each option that declares one."""
    return {item.name: item.metadata["range"] for item in fields(options) if "range" in item.metadata}


def _may_be_none(options: DataclassInstance, name: str) -> bool:
    return next(item.default is None for item in fields(options) if item.name == name)
