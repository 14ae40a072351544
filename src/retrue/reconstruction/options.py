"""What a reconstruction can be told."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ReconstructOptions:
    """How a cloud is made.

    Attributes
    ----------
    outlier_sigmas : Drop a point whose rays pass each other by more than this many times the typical distance.
    """

    outlier_sigmas: float = 6.0
