"""What a calibration answers: Calibrated with a rig, or RefusedCalibration with none; evidence with both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from retrue.calibration.fitted_views import FittedView
from retrue.rig import Rig


@dataclass(frozen=True, slots=True, eq=False)
class Calibrated:
    """The rig.

    Attributes
    ----------
    rig : its `evidence` is the one below, so that it travels with the file.
    reason : in a sentence, what it rests on.
    evidence : plain JSON values: rms_px, views, left_out, distortion, sigma, predicted_error, coverage, advice.
    views : each pose of the board, with its residuals.
    """

    rig: Rig
    reason: str
    evidence: Mapping[str, Any]
    views: tuple[FittedView, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class RefusedCalibration:
    """No rig: the captures do not determine it; the reason says what to capture."""

    reason: str
    evidence: Mapping[str, Any] = field(default_factory=dict[str, Any])
    views: tuple[FittedView, ...] = ()
