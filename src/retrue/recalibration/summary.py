"""What the answers of a recalibration show at a prompt: angles and distances, each with its sigma."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from retrue.shown import counted, figures

if TYPE_CHECKING:
    from retrue.recalibration.result import Evidence, LensReport, PoseChange, PoseSigma, Verification


def evidence_rows(evidence: Evidence, unit: str = "") -> dict[str, str]:
    """What an answer rests on; lengths are in the rig's unit, which evidence alone does not know."""
    rows = {"from": counted(evidence.correspondences, "correspondence")}
    if evidence.rms_px is not None:
        rows["from"] += f", RMS {figures(evidence.rms_px)} px"
    if evidence.lenses is not None:
        rows["lenses"] = lens_text(evidence.lenses)
    rows |= _moved(evidence.change, evidence.sigma, evidence.working_distance, unit)
    if evidence.scale:
        rows["scale"] = evidence.scale
    return rows


def verification_rows(verification: Verification) -> dict[str, str]:
    """What a verdict rests on."""
    rows = {"from": counted(verification.correspondences, "correspondence")}
    if verification.epipolar_rms_px is not None:
        rows["from"] += f", epipolar RMS {figures(verification.epipolar_rms_px)} px"
    return rows | _moved(verification.drift, verification.sigma, verification.working_distance, "")


def change_text(change: PoseChange | PoseSigma) -> str:
    """Rotation, and direction of t."""
    return f"{figures(change.rotation_deg)} deg, direction of t {figures(change.translation_deg)} deg"


def lens_condition(lenses: LensReport | None) -> str:
    """On which word about the lenses an answer rests; nothing where the points checked them, or sigma allows for it."""
    if lenses is None or lenses.verdict != "unchecked" or lenses.word == "may-have-changed":
        return ""
    return "on your word that nobody touched the lenses" if lenses.word == "fixed" else "if nobody touched the lenses"


def lens_text(lenses: LensReport) -> str:
    """What the points say of the lenses."""
    known = " and ".join(f"{100 * figure:.2g} %" for figure in lenses.focal_sigma)
    if lenses.verdict == "checked":
        return f"the points confirm them, focal lengths to {known} (camera, projector)"
    if lenses.verdict == "unchecked":
        said = f"these points cannot check them, and would know the focal lengths to {known} (camera, projector)"
        return f"{said}; sigma allows for a change" if lenses.word == "may-have-changed" else said
    changes = [
        f"the {device}'s focal length by {100 * change:+.2g} % (sigma {100 * sigma:.2g} %)"
        for device, change, sigma in zip(("camera", "projector"), lenses.focal_change, lenses.focal_sigma, strict=True)
    ]
    return f"changed, {', '.join(changes)}"


def _moved(change: PoseChange | None, sigma: PoseSigma | None, distance: float | None, unit: str) -> dict[str, str]:
    rows: dict[str, str] = {}
    if change is not None:
        rows["moved"] = change_text(change)
    if sigma is not None:
        rows["sigma"] = change_text(sigma)
    if change is not None and change.displacement is not None and math.isfinite(change.displacement):
        rows["points"] = f"{_length(distance, unit)} away were off by {_length(change.displacement, unit)}"
        if sigma is not None and sigma.displacement is not None:
            rows["points"] += f", sigma {_length(sigma.displacement, unit)}"
    return rows


def _length(length: float | None, unit: str) -> str:
    return f"{figures(length)} {unit}".rstrip()
