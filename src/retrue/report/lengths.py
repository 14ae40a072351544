"""Lengths, angles, pixels and reasons, as people read them."""

from __future__ import annotations

from dataclasses import dataclass

from retrue.shown import MISSING, figures
from retrue.units import METRES, millimetres_per

NAMELESS = frozenset({"", "?", "unit", "units", "unknown", "none"})


@dataclass(frozen=True, slots=True)
class LengthUnit:
    """The unit that lengths are shown in.

    Attributes
    ----------
    factor : from the rig's unit to it.
    name : "mm" wherever the rig's unit is one of length, "rig units" where nobody knows it.

    >>> shown_unit("m").text(0.0123)
    '12.3 mm'
    >>> shown_unit("unknown").text(200)
    '200 rig units'
    """

    factor: float
    name: str

    def number(self, length: float | None) -> str:
        """Without the unit, for columns whose head names it."""
        return MISSING if length is None else figures(length * self.factor)

    def text(self, length: float | None) -> str:
        """With the unit."""
        number = self.number(length)
        return number if number == MISSING else f"{number} {self.name}"


def shown_unit(unit: str) -> LengthUnit:
    """Millimetres for every unit of length that we know, else the rig's own."""
    name = unit.strip().lower()
    if name in METRES:
        return LengthUnit(millimetres_per(name), "mm")
    return LengthUnit(1.0, "rig units" if name in NAMELESS else unit.strip())


def degrees(value: float | None) -> str:
    """An angle, with its unit."""
    number = figures(value)
    return number if number == MISSING else f"{number}°"


def pixels(value: float | None) -> str:
    """A distance in a picture, with its unit."""
    number = figures(value)
    return number if number == MISSING else f"{number} px"


def problem_and_advice(reason: str) -> tuple[str, tuple[str, ...]]:
    """Our reasons read "what is wrong; what to do": both as sentences.

    >>> problem_and_advice("no plane among 80 points; have a wall fill part of the picture")
    ('No plane among 80 points.', ('Have a wall fill part of the picture.',))
    """
    problem, *advice = reason.split("; ")
    return sentence(problem), tuple(sentence(part) for part in advice)


def sentence(text: str) -> str:
    """With a capital and a full stop."""
    text = text.strip()
    text = text[:1].upper() + text[1:]
    return text if text.endswith((".", "?", "!")) else f"{text}."


def listed(parts: list[str]) -> str:
    """One, two and three.

    >>> listed(["a plane", "a ball", "a box"])
    'a plane, a ball and a box'
    """
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
