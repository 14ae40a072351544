"""What a prompt or a notebook shows of a value: a line that says what it is, and a few below it; never its arrays."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from html import escape
from os import PathLike
from textwrap import fill
from typing import TYPE_CHECKING, Any, cast

MISSING = "\N{EN DASH}"
WIDTH = 110  # columns of a prompt
SMALLEST = 1e-9  # shown as zero below

Shown = tuple[str, Mapping[str, str]]
"""What follows the name of the class on the first line, and what follows below, by its name."""


class ShortRepr:
    """Base of a dataclass (`repr=False`) that shows what its method `_shown` returns."""

    __slots__ = ()

    if TYPE_CHECKING:

        def _shown(self) -> Shown: ...

    @property
    def shown_title(self) -> str:
        """The first line without the name of the class, for what holds this."""
        return self._shown()[0]

    def __repr__(self) -> str:
        title, rows = self._shown()
        width = max(map(len, rows), default=0)
        lines = [f"{type(self).__name__}: {title}".rstrip(": ")]
        lines += [f"  {name:{width}}  {text}" for name, text in rows.items()]
        return "\n".join(fill(line, WIDTH, subsequent_indent=" " * (width + 4)) for line in lines)

    def _repr_html_(self) -> str:
        title, rows = self._shown()
        cells = "".join(
            f'<tr><td style="text-align: left">{escape(name)}</td><td style="text-align: left">{escape(text)}</td></tr>'
            for name, text in rows.items()
        )
        said = f"<div><b>{type(self).__name__}</b>: {escape(title)}{cells and f'<table>{cells}</table>'}</div>"
        return said + self._in_space()

    def _in_space(self) -> str:
        """What a notebook shows below the words, to turn with the mouse; nothing, unless a class has something."""
        return ""


class HasReport:
    """Base of what a job answers: it can be shown as a page."""

    __slots__ = ()

    def report(self, path: str | PathLike[str], **given: Any) -> None:
        """Write the page about it, as `retrue.write_report(path, self, ...)` does; `given` is what the job was given.

        `result.report("page.html", rig=rig, captures=[points], pictures=[image])`
        """
        from retrue import write_report  # by its public name: only the root knows all floors

        write_report(path, cast("Any", self), **given)


def in_space(*models: Any, **given: Any) -> str:
    """What `retrue.view_html` makes of them."""
    from retrue import view_html  # by its public name: only the root knows all floors

    return view_html(*models, **given)


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


def figures_beside(value: float, expanded: float) -> str:
    """A value to as many places as its uncertainty has.

    >>> figures_beside(0.0000949, 0.409), figures_beside(-1234.5678, 0.0123), figures_beside(-0.0002, 0.15)
    ('0.000', '-1234.5678', '0.000')
    """
    if not (math.isfinite(value) and math.isfinite(expanded) and expanded > SMALLEST):
        return figures(value)
    _, _, places = figures(expanded).partition(".")
    return f"{round(value, len(places)) + 0.0:.{len(places)}f}"


def vector(values: Iterable[float], count: int = 4) -> str:
    """A few numbers with so many significant figures of the largest.

    >>> vector([-430.0, 40.123, 1e-14])
    '[-430, 40.1, 0]'
    """
    numbers = [float(value) for value in values]
    largest = max((abs(number) for number in numbers if math.isfinite(number)), default=0.0)
    digits = max(0, count - 1 - math.floor(math.log10(largest))) if largest > 0 else 0
    shown = [f"{round(number, digits) + 0.0:.{digits}f}" for number in numbers]
    return f"[{', '.join(text.rstrip('0').rstrip('.') if '.' in text else text for text in shown)}]"


def counted(count: int, noun: str) -> str:
    """A number of things.

    >>> counted(1, "point"), counted(12345, "point")
    ('1 point', '12,345 points')
    """
    return f"{count:,} {noun}{'' if count == 1 else 's'}"
