"""The artefact of an acceptance test, as a spec: what it is, its calibrated lengths, and how sure those are."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Literal

from retrue.errors import InputError, require_kind
from retrue.units import UNITS, metres_per

ArtefactKind = Literal["sphere", "spheres", "plane"]

HOW = (
    "sphere:DIAMETER, spheres:DIAMETER:DISTANCE (of the centres) or plane, such as spheres:25mm:150.012mm+-0.003mm, "
    "where +- is the expanded uncertainty (k = 2) of its calibration"
)
MOST_POSITIONS = {"sphere": 10, "spheres": 7, "plane": 6}


@dataclass(frozen=True, slots=True)
class Length:
    """A calibrated length, and its expanded uncertainty (k = 2)."""

    value: float
    expanded: float = 0.0


@dataclass(frozen=True, slots=True)
class Artefact:
    """What stands before the rig.

    Attributes
    ----------
    kind : "sphere", one ball; "spheres", a bar with two of one diameter; or "plane".
    diameter, distance : of a ball, and of the centres of two; None where there is none.
    unit : of these lengths.

    >>> bar = parse_artefact("spheres:25mm:15.0012cm+-0.0003cm")
    >>> bar.distance, bar.positions
    (Length(value=150.012, expanded=0.003), 7)
    """

    kind: ArtefactKind
    diameter: Length | None = None
    distance: Length | None = None
    unit: str = "mm"

    @property
    def positions(self) -> int:
        """In how many the guideline wants it measured. Source: VDI/VDE 2634 part 2, 2012."""
        return MOST_POSITIONS[self.kind]

    def __str__(self) -> str:
        lengths = [length for length in (self.diameter, self.distance) if length is not None]
        words = [f"{length.value:.10g}{self.unit}" + self._uncertainty(length) for length in lengths]
        return ":".join([self.kind, *words])

    def _uncertainty(self, length: Length) -> str:
        return f"+-{length.expanded:.6g}{self.unit}" if length.expanded else ""

    def converted(self, unit: str) -> Artefact:
        """The same with its lengths in another unit; raises `InputError` where the length of that one is not known."""
        factor = metres_per(self.unit) / metres_per(unit)
        diameter, distance = (
            None if length is None else Length(length.value * factor, length.expanded * factor)
            for length in (self.diameter, self.distance)
        )
        return replace(self, diameter=diameter, distance=distance, unit=unit)


def parse_artefact(spec: str) -> Artefact:
    """The artefact that `KIND[:LENGTHunit[+-LENGTHunit]...]` describes; `InputError`, which says how to write one."""
    require_kind(spec, str, "artefact")
    kind, *parts = spec.strip().split(":")
    wanted = {"sphere": 1, "spheres": 2, "plane": 0}
    if kind not in wanted or len(parts) != wanted[kind]:
        raise InputError(f"artefact: expected {HOW}; found {spec!r}")
    if kind == "plane":
        return Artefact("plane")
    lengths = [_length(part, spec) for part in parts]
    unit = lengths[0][1]
    diameter, *others = [
        Length(*(round(value * metres_per(own) / metres_per(unit), 12) for value in (length.value, length.expanded)))
        for length, own in lengths
    ]
    if kind == "sphere":
        return Artefact("sphere", diameter, unit=unit)
    if not others[0].value > diameter.value:
        raise InputError(f"artefact: expected centres further apart than one diameter, found {spec!r}")
    return Artefact("spheres", diameter, others[0], unit)


def _length(text: str, spec: str) -> tuple[Length, str]:
    number = r"(\d+\.?\d*|\.\d+)\s*([a-z]+)"
    found = re.fullmatch(rf"{number}(?:\s*(?:\+-|±)\s*{number})?", text.strip())
    if found is None or found[2] not in UNITS or (found[4] is not None and found[4] not in UNITS):
        raise InputError(f"artefact: expected {HOW}; found {text!r} in {spec!r}")
    value = float(found[1])
    if not value > 0:
        raise InputError(f"artefact: expected a positive length, found {text!r} in {spec!r}")
    expanded = 0.0 if found[3] is None else float(found[3]) * metres_per(found[4]) / metres_per(found[2])
    if not expanded < value:
        raise InputError(f"artefact: expected an uncertainty below its length, found {text!r} in {spec!r}")
    return Length(value, expanded), found[2]
