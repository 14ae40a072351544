"""What CAD can be told; apart from it, so that `--help` need not load NumPy."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class CadOptions:
    """How surfaces are fitted.

    Attributes
    ----------
    cad_tolerance : How far points may lie from their surface, in the rig's unit; if not given, six sigma of noise.
    """

    cad_tolerance: float | None = None
