"""What a calibration answers: Calibrated with a rig, or RefusedCalibration with none; evidence and views with both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from retrue.calibration.bundle import Adjusted
from retrue.calibration.jacobians import residuals
from retrue.calibration.observations import View, corner_group
from retrue.geometry.arrays import FloatArray
from retrue.geometry.transform import RigidTransform
from retrue.rig import Rig
from retrue.values import ByValue


@dataclass(frozen=True, slots=True, eq=False)
class FittedView(ByValue):
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


def fitted_views(fit: Adjusted, views: list[View]) -> tuple[FittedView, ...]:
    """All views under the fit."""
    groups = [corner_group(views, device) for device in range(len(fit.setup.devices))]
    errors = [residuals(fit.setup, group) for group in groups]
    return tuple(
        FittedView(
            view.name,
            fit.setup.first_from_board[index],
            view.board_xy,
            tuple(group.pixels[group.view == index] for group in groups),
            tuple(error[group.view == index] for error, group in zip(errors, groups, strict=True)),
        )
        for index, view in enumerate(views)
    )


@dataclass(frozen=True, slots=True, eq=False)
class Calibrated(ByValue):
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
class RefusedCalibration(ByValue):
    """No rig: the captures do not determine it; the reason says what to capture."""

    reason: str
    evidence: Mapping[str, Any] = field(default_factory=dict[str, Any])
    views: tuple[FittedView, ...] = ()
