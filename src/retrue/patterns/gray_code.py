"""Gray code: columns, then rows, each bit as a pattern and its inverse."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class GrayCode:
    """A Gray-code sequence, as a spec.

    Attributes
    ----------
    projector_size : (width, height).
    step : side in projector pixels of the smallest stripe; a code names the CENTRE of its stripe.
    """

    projector_size: tuple[int, int]
    step: int = 1
