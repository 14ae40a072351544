"""The page of a verification."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from retrue.capture import Capture
from retrue.recalibration.result import Band, Verification
from retrue.report.evidence_tables import change_table
from retrue.report.lengths import LengthUnit, degrees, pixels, problem_and_advice, shown_unit
from retrue.report.page import Block, Fact, Page, Section, Table, Tone
from retrue.report.residual_section import median_residual, residual_section
from retrue.report.scene import cloud_of, rig_scene
from retrue.rig import Rig
from retrue.shown import figures

TONES: Mapping[Band, Tone] = {"holds": "good", "improvable": "warn", "recalibrate": "bad", "cannot tell": "warn"}


def verification_page(rig: Rig, captures: Sequence[Capture], verification: Verification) -> Page:
    """Whether the captures fit the rig, what they support instead, and how sure that is."""
    unit, cloud = shown_unit(rig.unit), cloud_of(rig, captures)
    problem, advice = problem_and_advice(verification.reason)
    sections = [
        Section(
            "In space",
            "The points as this rig measures them.",
            (rig_scene(rig, cloud, verification.supported_pose),),
        )
    ]
    if verification.drift is not None:
        table = change_table(verification.drift, verification.sigma, verification.working_distance, unit)
        lead = "From the rig's pose to the one that the captures support by themselves."
        sections.append(Section("What the captures say", lead, (table, _counts(verification))))
    sections.append(residual_section({"As the rig stands": rig}, captures))
    return Page(
        "verify",
        verification.band.capitalize(),
        TONES[verification.band],
        problem,
        _facts(verification, median_residual(rig, captures), unit),
        tuple(sections),
        advice,
    )


def _counts(verification: Verification) -> Block:
    rows = (
        ("Correspondences", figures(verification.correspondences)),
        ("Epipolar RMS under this rig", pixels(verification.epipolar_rms_px)),
        ("Drift, in sigma", figures(verification.drift_sigmas)),
    )
    return Table(
        ("Evidence", ""),
        rows,
        "Drift in sigma is a distance in five dimensions: a rig that holds stays below 4.5 in 999 of 1000 captures.",
    )


def _facts(verification: Verification, missed: float, unit: LengthUnit) -> tuple[Fact, ...]:
    """One distance: that by which points are off, or, where no pose is supported, that of the rays."""
    drift, sigma = verification.drift, verification.sigma
    if drift is None or sigma is None:
        return (Fact("Rays miss by (median)", pixels(missed), f"{verification.correspondences:,} correspondences"),)
    facts = [
        Fact("Rotation is off by", degrees(drift.rotation_deg), f"± {degrees(sigma.rotation_deg)}"),
        Fact("Direction of t is off by", degrees(drift.translation_deg), f"± {degrees(sigma.translation_deg)}"),
    ]
    if drift.displacement is not None and verification.working_distance is not None:
        note = f"± {unit.text(sigma.displacement)}, at {unit.text(verification.working_distance)}"
        facts.append(Fact("Measured points are off by", unit.text(drift.displacement), note))
    return (*facts, Fact("Drift", f"{figures(verification.drift_sigmas, 2)} sigma"))
