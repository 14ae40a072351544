"""Units of length, for the files that are in metres or millimetres whatever the rig is in."""

from __future__ import annotations

from retrue.errors import InputError, require_kind

UNITS = {"um": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254, "ft": 0.3048}
"""Metres in each unit that a length is given in."""
METRES = UNITS | {"µm": 1e-6, "micrometre": 1e-6, "millimetre": 1e-3, "centimetre": 1e-2, "metre": 1.0, "inch": 0.0254}
METRES |= {"micrometer": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "meter": 1.0}
"""The same, by every name that a rig file may have for one."""


def metres_per(unit: str) -> float:
    """How many metres one `unit` is; an `InputError` where that is not known.

    >>> metres_per("mm"), metres_per(" Inch")
    (0.001, 0.0254)
    """
    require_kind(unit, str, "unit")
    name = unit.strip().lower()
    if name not in METRES:
        raise InputError(
            "unit: expected um, mm, cm, m, in or ft, "
            f"found {unit!r}, whose length is not known; "
            "set the rig's unit, or write PLY or OBJ, which are in the rig's own"
        )
    return METRES[name]


def millimetres_per(unit: str) -> float:
    """The same in millimetres.

    >>> millimetres_per("in")
    25.4
    """
    return 1000 * metres_per(unit)
