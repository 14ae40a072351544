"""What a prompt or a notebook shows of a value: a line that says what it is, and a few below it; never its arrays."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from html import escape
from typing import TYPE_CHECKING

MISSING = "\N{EN DASH}"
SMALLEST = 1e-9  # shown as zero below

Shown = tuple[str, Mapping[str, str]]
"""What follows the name of the class on the first line, and what follows below, by its name."""


class ShortRepr:
    """Base of a dataclass (`repr=False`) that shows what its method `_shown` returns."""

    __slots__ = ()

    if TYPE_CHECKING:

        def _shown(self) -> Shown: ...

    def __repr__(self) -> str:
        title, rows = self._shown()
        width = max(map(len, rows), default=0)
        return "\n".join([f"{type(self).__name__}: {title}", *(f"  {name:{width}}  {rows[name]}" for name in rows)])

    def _repr_html_(self) -> str:
        title, rows = self._shown()
        cells = "".join(
            f'<tr><td style="text-align: left">{escape(name)}</td><td style="text-align: left">{escape(text)}</td></tr>'
            for name, text in rows.items()
        )
        return f"<div><b>{type(self).__name__}</b>: {escape(title)}{cells and f'<table>{cells}</table>'}</div>"


def figures(value: float | None, count: int = 3) -> str:
    """So many significant figures, never in powers of ten; what is larger in full, counts by thousands.

    >>> figures(0.012345), figures(1234.5), figures(-2.0), figures(70000), figures(float("nan"))
    ('0.0123', '1234', '-2.00', '70,000', '–')
    """
    if value is None or not math.isfinite(value):
        return MISSING
    if abs(value) < SMALLEST:
        return "0"
    if isinstance(value, int):
        return f"{value:,}"
    if abs(value) >= 10 ** (count - 1):
        return f"{value:.0f}"
    return f"{value:.{count - 1 - math.floor(math.log10(abs(value)))}f}"


def vector(values: Iterable[float], count: int = 4) -> str:
    """A few numbers with so many significant figures of the largest.

    >>> vector([-430.0, 40.123, 1e-14])
    '[-430, 40.1, 0]'
    """
    numbers = [float(value) for value in values]
    largest = max((abs(number) for number in numbers if math.isfinite(number)), default=0.0)
    digits = count - 1 - math.floor(math.log10(largest)) if largest > 0 else 0
    rounded = [round(number, digits) + 0.0 if math.isfinite(number) else number for number in numbers]
    return f"[{', '.join(f'{number:.{count + 4}g}' for number in rounded)}]"


def counted(count: int, noun: str) -> str:
    """A number of things.

    >>> counted(1, "point"), counted(12345, "point")
    ('1 point', '12,345 points')
    """
    return f"{count:,} {noun}{'' if count == 1 else 's'}"
