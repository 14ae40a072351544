"""What CAD can be told."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class CadOptions:
    """How surfaces are fitted.

    Attributes
    ----------
    cad_tolerance : How far points may lie from their CAD surface, in the rig's unit; six sigma of their noise if not given.
    """

    cad_tolerance: float | None = None
