"""What a calibration answers: Calibrated with a rig, or RefusedCalibration with none; evidence and views with both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from retrue.answers import Reason
from retrue.calibration.bundle import Adjusted
from retrue.calibration.jacobians import predicted_px, residuals
from retrue.calibration.observations import View, corner_group
from retrue.geometry.arrays import FloatArray
from retrue.geometry.transform import RigidTransform
from retrue.rig import Rig
from retrue.shown import HasReport, ShortRepr, Shown, counted, figures, in_space
from retrue.values import ByValue


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class FittedView(ByValue, ShortRepr):
    """One pose of the board after the fit.

    Attributes
    ----------
    name : of the capture.
    camera_from_board : the pose; lengths in the rig's unit.
    board_xy : (N, 2) corners in the board's frame.
    pixels : one (K, 2) a device, the corners that it saw.
    errors : one (K, 2) a device, predicted minus measured pixels.
    """

    name: str
    camera_from_board: RigidTransform
    board_xy: FloatArray
    pixels: tuple[FloatArray, ...]
    errors: tuple[FloatArray, ...]

    def _shown(self) -> Shown:
        rms = [figures(float(np.sqrt(2 * np.mean(error**2)))) for error in self.errors if error.size]
        title = f"{self.name}, {counted(len(self.board_xy), 'corner')}, RMS {' and '.join(rms)} px"
        return title, {"camera_from_board": self.camera_from_board.shown_title}


def fitted_views(fit: Adjusted, views: list[View]) -> tuple[FittedView, ...]:
    """All views under the fit."""
    groups = [corner_group(views, device) for device in range(len(fit.setup.devices))]
    errors = [residuals(fit.setup, group) for group in groups]
    pixels = [predicted_px(fit.setup, group) for group in groups]
    return tuple(
        FittedView(
            view.name,
            fit.setup.first_from_board[index],
            view.board_xy,
            tuple(shown[group.view == index] for group, shown in zip(groups, pixels, strict=True)),
            tuple(error[group.view == index] for error, group in zip(errors, groups, strict=True)),
        )
        for index, view in enumerate(views)
    )


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Calibrated(ByValue, ShortRepr, HasReport):
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

    @property
    def verdict(self) -> Literal["accepted"]:
        """In one word."""
        return "accepted"

    @property
    def cause(self) -> None:
        """Nothing speaks against it."""

    def _shown(self) -> Shown:
        rows = _rows(self.evidence, self.views, self.rig.unit)
        return self.reason, rows | {"advice": "; ".join(self.evidence.get("advice", ())) or "none"}

    def _in_space(self) -> str:
        return in_space(rig=self.rig)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RefusedCalibration(ByValue, ShortRepr, HasReport):
    """No rig: the captures do not determine it; the cause says what to capture."""

    cause: Reason
    evidence: Mapping[str, Any] = field(default_factory=dict[str, Any])
    views: tuple[FittedView, ...] = ()

    @property
    def verdict(self) -> Literal["refused"]:
        """In one word."""
        return "refused"

    @property
    def reason(self) -> str:
        """The cause in one sentence."""
        return str(self.cause)

    def _shown(self) -> Shown:
        return self.reason, _rows(self.evidence, self.views, "")


def _rows(evidence: Mapping[str, Any], views: tuple[FittedView, ...], unit: str) -> dict[str, str]:
    rows = {"from": counted(len(views), "pose")}
    if left_out := evidence.get("left_out"):
        rows["from"] += f", {len(left_out)} left out"
    if "rms_px" in evidence:
        rows["from"] += f", RMS {figures(evidence['rms_px'])} px"
    if error := evidence.get("predicted_error"):
        known, distance = figures(error["rms"]), figures(error["at_distance"])
        rows["points"] = f"known to {known} {unit}".rstrip() + f" at {distance} {unit}".rstrip()
    return rows
