"""The page of a static calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from retrue.calibration.result import Calibrated, FittedView, RefusedCalibration
from retrue.calibration.setup import INTRINSICS
from retrue.geometry.camera import Camera
from retrue.geometry.transform import vector_from_rotation
from retrue.report.calibration_charts import boards_in_space, coverage_chart, residuals_per_view, view_names
from retrue.report.lengths import LengthUnit, pixels, problem_and_advice, sentence, shown_unit
from retrue.report.page import Block, Fact, Page, Section, Table, Tabs
from retrue.rig import Rig
from retrue.shown import MISSING, figures

DEVICES = ("camera", "projector")


def calibration_page(
    result: Calibrated | RefusedCalibration, sizes: Mapping[str, tuple[int, int]], unit: str, *, out: str = ""
) -> Page:
    """Where the board was held, how well every pose fits, what came out and how well that is known.

    Parameters
    ----------
    result : of `calibrate`.
    sizes : (width, height) of each device's picture, by its name: the camera first.
    unit : the board's.
    out : where the rig was written to.
    """
    shown, evidence, views = shown_unit(unit), result.evidence, result.views
    rig = result.rig if isinstance(result, Calibrated) else None
    sections: list[Section] = []
    if views:
        scene = boards_in_space(views, rig)
        tabs = Tabs(
            tuple(
                (name.capitalize(), coverage_chart(views, device, size, name))
                for device, (name, size) in enumerate(sizes.items())
            )
        )
        sections += [
            Section("Poses of the board", "Each as the fit places it.", (scene,)),
            Section("What the board covered", _coverage_words(evidence), (tabs,)),
            Section(
                "How well each pose fits",
                "",
                (residuals_per_view(views, tuple(sizes)), _views_table(evidence, views, shown)),
            ),
        ]
    if rig is not None:
        sections.append(Section("What came out", _error_words(evidence, shown), _parameters(rig, evidence, shown)))
    if evidence.get("left_out"):
        rows = tuple((view["name"], sentence(view["reason"])) for view in evidence["left_out"])
        sections.append(Section("What was left out", "", (Table(("capture", "why"), rows, numeric=False),)))
    advice = tuple(sentence(line) for line in evidence.get("advice", ()))
    facts = _facts(evidence, shown, len(views))
    if rig is not None:
        words = f"{result.reason}{f'; written to {out}' if out else ''}"
        return Page("calibrate", "Calibrated", "good", sentence(words), facts, tuple(sections), advice)
    problem, own_advice = problem_and_advice(result.reason)
    advice += tuple(line for line in own_advice if line not in advice)
    return Page("calibrate", "Refused", "warn", f"{problem} Nothing was written.", facts, tuple(sections), advice)


def _facts(evidence: Mapping[str, Any], unit: LengthUnit, used: int) -> tuple[Fact, ...]:
    if "rms_px" not in evidence:
        return ()
    error, coverage = evidence["predicted_error"], evidence["coverage"]
    left_out = len(evidence.get("left_out", ()))
    shares = {name: f"{share['share']:.0%}" for name, share in coverage.items()}
    return (
        Fact("Corners miss by (RMS)", pixels(evidence["rms_px"])),
        Fact("Points are known to", unit.text(error["rms"]), f"one sigma, at {unit.text(error['at_distance'])}"),
        Fact("Poses", str(used), f"{left_out} left out"),
        Fact("Coverage", " · ".join(shares.values()), " · ".join(shares)),
    )


def _coverage_words(evidence: Mapping[str, Any]) -> str:
    empty = [
        f"the {name} has not seen it {' or '.join(places['empty'])}"
        for name, places in evidence.get("coverage", {}).items()
        if places["empty"]
    ]
    return sentence("; ".join(empty)) if empty else "Both pictures were covered in every ninth."


def _error_words(evidence: Mapping[str, Any], unit: LengthUnit) -> str:
    error = evidence["predicted_error"]
    return (
        f"What these sigmas mean: a point at {unit.text(error['at_distance'])} is known to {unit.text(error['rms'])}"
        " (one sigma, RMS over the picture)."
    )


def _views_table(evidence: Mapping[str, Any], views: Sequence[FittedView], unit: LengthUnit) -> Block:
    rows = tuple(
        (
            name,
            str(view["corners"]),
            str(view["corners_left_out"]),
            unit.text(view["distance"]),
            *(pixels(view.get(f"{device}_rms_px")) for device in DEVICES),
        )
        for name, view in zip(view_names(views), evidence["views"], strict=True)
    )
    return Table(("pose", "corners", "left out", "distance", "camera RMS", "projector RMS"), rows)


def _parameters(rig: Rig, evidence: Mapping[str, Any], unit: LengthUnit) -> tuple[Block, ...]:
    sigma = evidence["sigma"]
    devices = {"camera": rig.camera, "projector": rig.projector}
    values = {name: _intrinsics(device) for name, device in devices.items()}
    rows = tuple(
        (
            parameter,
            *(
                cell
                for name in devices
                for cell in _with_sigma(values[name][parameter], sigma.get(name, {}).get(parameter))
            ),
        )
        for parameter in INTRINSICS
    )
    pose, known = rig.projector_from_camera, sigma.get("projector_from_camera", {})
    angles = np.degrees(vector_from_rotation(pose.R))
    turns = tuple(
        (f"r{axis}, deg", f"{angle:.4f}", figures(known.get(f"r{axis}_deg"), 2))
        for axis, angle in zip("xyz", angles.tolist(), strict=True)
    )
    shifts = tuple(
        (f"t{axis}, {unit.name}", figures(unit.factor * shift, 6), _length_sigma(known.get(f"t{axis}"), unit))
        for axis, shift in zip("xyz", pose.t.tolist(), strict=True)
    )
    kept = tuple(
        (name, ", ".join(lens["kept"]) or "none", lens["why"]) for name, lens in evidence.get("distortion", {}).items()
    )
    return (
        Table(
            ("", "camera", "sigma", "projector", "sigma"), rows, "Intrinsics, in pixels; distortion in OpenCV's terms."
        ),
        Table(("projector_from_camera", "", "sigma"), turns + shifts, "Rotation as axis times angle, and t."),
        Table(("lens", "terms kept", "why"), kept, numeric=False),
    )


def _intrinsics(device: Camera) -> dict[str, float]:
    (fx, _, cx), (_, fy, cy), _ = device.K.tolist()
    return dict(zip(INTRINSICS, (fx, fy, cx, cy, *device.distortion[:5].tolist()), strict=True))


def _with_sigma(value: float, sigma: float | None) -> tuple[str, str]:
    """To the digits that the sigma leaves; a parameter that was not estimated has none."""
    if sigma is None:
        return (figures(value, 6) if value else "0", MISSING)
    return figures(value, 6), figures(sigma, 2)


def _length_sigma(sigma: float | None, unit: LengthUnit) -> str:
    """A sigma of a length in the shown unit."""
    return MISSING if sigma is None else figures(unit.factor * sigma, 2)
