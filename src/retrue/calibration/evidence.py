"""What a calibration rests on, as plain JSON values, and what to capture next."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from retrue.calibration.bundle import Adjusted
from retrue.calibration.jacobians import predicted_px, residuals
from retrue.calibration.model_terms import Choice
from retrue.calibration.observations import View, corner_group, unknown_axes
from retrue.calibration.uncertainty import (
    PredictedError,
    depth_spread,
    lens_covariance,
    normal_spread_deg,
    parameter_sigmas,
    pose_covariance,
    rig_covariance,
)
from retrue.calibration.views import LeftOut
from retrue.geometry.arrays import FloatArray

DEVICES = ("camera", "projector")
ROW_NAMES, COLUMN_NAMES = ("top", "middle", "bottom"), ("left", "centre", "right")


def rms_px(fit: Adjusted, views: list[View]) -> dict[str, float]:
    """RMS length of corner residuals: of all corners, as OpenCV's stereoCalibrate counts it, and of each device."""
    errors = [residuals(fit.setup, corner_group(views, device)) for device in range(len(fit.setup.devices))]
    each = {name: _rms(error) for name, error in zip(DEVICES, errors, strict=False)}
    return {"all": _rms(np.concatenate(errors)), **each}


def gather_evidence(
    fit: Adjusted,
    views: list[View],
    left_out: Sequence[LeftOut],
    dropped: Sequence[int],
    choices: Sequence[Choice],
    fixed: Sequence[bool],
    error: PredictedError,
    unit: str,
) -> dict[str, Any]:
    """Everything that a reader needs to trust the rig, or not."""
    errors = rms_px(fit, views)
    together = rig_covariance(fit, fixed)
    coverage = {name: _coverage(fit, views, device) for device, name in enumerate(DEVICES)}
    return {
        "method": "bundle adjustment over intrinsics, board poses and relative pose; dense points on the board's plane",
        "rms_px": errors["all"],
        "camera_rms_px": errors["camera"],
        "projector_rms_px": errors["projector"],
        "views": _views(fit, views, dropped),
        "left_out": [{"name": view.name, "reason": view.reason} for view in left_out],
        "distortion": {
            name: _lens(*pair) for name, pair in zip(DEVICES, zip(choices, fixed, strict=False), strict=True)
        },
        "board": _board(fit, views, choices[-1]),
        "sigma": parameter_sigmas(fit),
        "lens_covariance": lens_covariance(together).tolist(),
        "covariance": pose_covariance(together).tolist(),
        "rig_covariance": together.tolist(),
        "predicted_error": {"rms": error.length, "at_distance": error.distance, "unit": unit},
        "regions_rms_px": {name: _regions(fit, views, device) for device, name in enumerate(DEVICES)},
        "coverage": coverage,
        "board_angles_deg": normal_spread_deg(fit),
        **_assumed(views, fixed),
        "advice": advise(fit, views, dropped, coverage),
    }


def _assumed(views: list[View], fixed: Sequence[bool]) -> dict[str, Any]:
    """What a code of one coordinate does not tell; nothing of one that has both."""
    unknown = unknown_axes(views)
    if not unknown or fixed[1]:
        return {}
    axis, code = (("x", "rows"), ("y", "columns"))[unknown[0]]
    return {
        "one_coordinate": {
            "decoded": code,
            "assumed": f"of the projector, f{axis} and c{axis}, and its position along its {axis} axis: {code} do not "
            "tell them, and reconstruct does not need them; for verify and recalibrate capture poses with both codes",
        }
    }


def advise(fit: Adjusted, views: list[View], dropped: Sequence[int], coverage: dict[str, dict[str, Any]]) -> list[str]:
    """What to capture next, most useful first; empty where nothing is missing."""
    advice: list[str] = []
    angle = normal_spread_deg(fit)
    if not angle > 25:
        advice.append(f"tilt the board more: its poses differ by {angle:.0f} degrees at most, aim for 30 to 60")
    if len(views) < 5:
        advice.append(f"capture more poses: {len(views)} were used, aim for eight")
    said = ("first camera", "second camera") if views[0].two_pictures else DEVICES
    for name, device in zip(DEVICES[: len(fit.setup.devices)], said, strict=False):
        if coverage[name]["empty"] and coverage[name]["share"] < 0.6:
            where = ", ".join(coverage[name]["empty"])
            advice.append(f"hold the board where the {device}'s picture has had none yet: {where}")
    if not depth_spread(fit) > 0.1:
        advice.append("hold the board nearer and farther too: all poses are at nearly one distance")
    corners = sum(len(view.board_xy) for view in views)
    if sum(dropped) > 0.02 * corners:
        advice.append(
            f"mount the board flat: {sum(dropped)} of {corners} corners lie where no evenly bent board has them"
        )
    return advice


def _views(fit: Adjusted, views: list[View], dropped: Sequence[int]) -> list[dict[str, Any]]:
    reports: list[dict[str, Any]] = [
        {
            "name": view.name,
            "complete": view.complete,
            "corners": len(view.seen(0)),
            "corners_left_out": dropped[index],
            "distance": float(fit.setup.first_from_board[index].t[2]),
        }
        for index, view in enumerate(views)
    ]
    for device in range(len(fit.setup.devices)):
        group = corner_group(views, device)
        error = residuals(fit.setup, group)
        for index, report in enumerate(reports):
            report[f"{DEVICES[device]}_rms_px"] = _rms(error[group.view == index])
    return reports


def _lens(choice: Choice, fixed: bool) -> dict[str, Any]:
    return {"kept": [], "why": "known beforehand, held fixed"} if fixed else _weighed(choice)


def _board(fit: Adjusted, views: list[View], choice: Choice) -> dict[str, Any]:
    """How far the board is from flat, as far as its bend was kept."""
    xy = np.concatenate([view.board_xy for view in views])
    xy = xy - 0.5 * (xy.min(axis=0) + xy.max(axis=0))
    x, y = xy.T
    height = np.stack([x * x, x * y, y * y], axis=-1) @ fit.setup.bend
    return {"out_of_flat": float(np.ptp(height)), **_weighed(choice)}


def _weighed(choice: Choice) -> dict[str, Any]:
    gain = {name: round(value, 1) for name, value in choice.gain.items()}
    why = f"a term is kept where chi-square falls by more than {choice.needed:.1f} a coefficient"
    return {"kept": list(choice.kept), "chi_square_gain": gain, "why": why}


def _pixels(fit: Adjusted, views: list[View], device: int) -> FloatArray:
    patches = [view.patch_camera_px if device == 0 else view.patch_projector_px for view in views]
    corners = predicted_px(fit.setup, corner_group(views, device))
    patches = [pixels[np.isfinite(pixels).all(axis=1)] for pixels in patches]  # of one coordinate, the corners tell
    return np.concatenate([*patches, corners])


def _coverage(fit: Adjusted, views: list[View], device: int) -> dict[str, Any]:
    """The share of 8 x 6 cells that the board was seen in, and the ninths of the picture that have none."""
    size = np.array(fit.setup.devices[device].size)
    place = np.clip((_pixels(fit, views, device) + 0.5) / size, 0, 1 - 1e-9)
    fine = len(np.unique((place * [8, 6]).astype(int) @ [1, 8]))
    seen = set(((place * 3).astype(int) @ [1, 3]).tolist())
    empty = [f"{ROW_NAMES[cell // 3]} {COLUMN_NAMES[cell % 3]}" for cell in range(9) if cell not in seen]
    return {"share": fine / 48, "empty": empty}


def _regions(fit: Adjusted, views: list[View], device: int) -> list[list[float | None]]:
    """RMS of the corners in each ninth of the picture, row by row; null where there are none."""
    group = corner_group(views, device)
    error = residuals(fit.setup, group)
    size = np.array(fit.setup.devices[device].size)
    column, row = (np.clip((predicted_px(fit.setup, group) + 0.5) / size, 0, 1 - 1e-9) * 3).astype(int).T
    cell = 3 * row + column
    ninths = [_rms(error[cell == index]) if (cell == index).any() else None for index in range(9)]
    return [ninths[row : row + 3] for row in (0, 3, 6)]


def _rms(error: FloatArray) -> float:
    return float(np.sqrt(2 * np.mean(error**2))) if len(error) else 0.0
