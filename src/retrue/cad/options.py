"""What CAD can be told; apart from it, so that `--help` need not load NumPy."""

from __future__ import annotations

from dataclasses import dataclass

from retrue.ranges import check_ranges, ranged


@dataclass(frozen=True, slots=True)
class CadOptions:
    """How surfaces are fitted.

    Attributes
    ----------
    cad_tolerance
        How far points may lie from their surface, in the rig's unit; if not given, six sigma of noise.
    """

    cad_tolerance: float | None = ranged(None, 0, 1e12, above=True)

    def __post_init__(self) -> None:
        check_ranges(self)
