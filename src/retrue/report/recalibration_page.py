"""The page of a recalibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from retrue.capture import Capture
from retrue.recalibration.result import Accepted, Evidence, PoseSigma, Refused
from retrue.recalibration.summary import lens_condition
from retrue.report.evidence_tables import change_table, evidence_blocks, pose_table
from retrue.report.lengths import LengthUnit, degrees, pixels, problem_and_advice, sentence, shown_unit
from retrue.report.light_section import light_section
from retrue.report.page import Fact, Page, Section
from retrue.report.residual_section import median_residual, residual_section
from retrue.report.scene import change_scene, cloud_of
from retrue.rig import Rig
from retrue.shown import figures


def recalibration_page(before: Rig, captures: Sequence[Capture], result: Accepted | Refused, *, out: str = "") -> Page:
    """What was seen, which pose was taken and why, how far it is from the old one, and how sure that is.

    Parameters
    ----------
    before : the rig as it was handed in.
    captures : what `recalibrate` was given, in that order.
    out : where the new rig was written to.
    """
    unit, evidence = shown_unit(before.unit), result.evidence
    after = _after(before, result)
    clouds = [cloud_of(rig, captures) for rig in (before, after) if rig is not None]
    scene = change_scene(before, after, evidence.candidates, clouds)
    sections = [Section("In space", _scene_lead(result), (scene,))]
    if after is not None and evidence.change is not None:
        poses = {"before": before.projector_from_camera, "after": after.projector_from_camera}
        changes = change_table(evidence.change, evidence.sigma, evidence.working_distance, unit)
        sections.append(Section(*_changed_heading(result), (changes, pose_table(poses, unit))))
    rigs = {"After": after, "Before": before} if after is not None else {"Before": before}
    sections.append(residual_section(rigs, captures))
    sections.insert(1, Section("Why this one", _why(result), evidence_blocks(before, evidence, unit)))
    if (light := light_section(before, captures, evidence)) is not None:
        sections.insert(2, light)
    facts = _facts(before, after, captures, evidence, unit)
    if isinstance(result, Accepted):
        said = _unchanged(evidence) if result.unchanged else _accepted(evidence, out)
        advice = _unchanged_advice(evidence) if result.unchanged else _accepted_advice(evidence, out)
        return Page("recalibrate", result.verdict.capitalize(), "good", said, facts, tuple(sections), advice)
    problem, advice = problem_and_advice(result.reason)
    return Page("recalibrate", "Refused", "warn", f"{problem} Nothing was written.", facts, tuple(sections), advice)


def _after(before: Rig, result: Accepted | Refused) -> Rig | None:
    """The new rig; where there is none, what it would have been."""
    if isinstance(result, Accepted) and not result.unchanged:
        return result.rig
    pose = result.evidence.pose
    return None if pose is None else replace(before, projector_from_camera=pose)


def _why(result: Accepted | Refused) -> str:
    """The reason, and first of all on whose word it rests."""
    condition = lens_condition(result.evidence.lenses) if isinstance(result, Accepted) else ""
    return f"{sentence(f'It holds {condition}')} {sentence(result.reason)}" if condition else sentence(result.reason)


def _unchanged(evidence: Evidence) -> str:
    said = _assuming("The rig still holds", evidence)
    if evidence.change is not None:
        said += (
            f": the captures put the projector {degrees(evidence.change.rotation_deg)} and"
            f" {degrees(evidence.change.translation_deg)} (rotation, direction of t) from where the rig has it, within"
            " what they can tell"
        )
    return f"{said}. The rig's pose is known better than theirs, and was kept."


def _unchanged_advice(evidence: Evidence) -> tuple[str, ...]:
    return ("Go on measuring: nothing has to be done.", *_lens_advice(evidence))


def _accepted_advice(evidence: Evidence, out: str) -> tuple[str, ...]:
    rig = out or "the new rig"
    return (
        f"Measure with {rig} from now on, and throw away what was measured since the rig moved: or reconstruct it"
        " again, from its captures.",
        f"Take another picture, of another scene: retrue verify with {rig} checks this answer.",
        *_lens_advice(evidence),
    )


def _lens_advice(evidence: Evidence) -> tuple[str, ...]:
    if evidence.lens != "unchecked":
        return ()
    return ("To have the lenses checked, show objects at several depths, or add captures.",)


def _assuming(said: str, evidence: Evidence) -> str:
    condition = lens_condition(evidence.lenses)
    return f"{condition[:1].upper()}{condition[1:]}, {said[:1].lower()}{said[1:]}" if condition else said


def _accepted(evidence: Evidence, out: str) -> str:
    said = "The new pose is accepted"
    if evidence.change is not None:
        said = (
            f"The projector has turned by {degrees(evidence.change.rotation_deg)}, and its direction from the camera"
            f" by {degrees(evidence.change.translation_deg)}"
        )
    if evidence.sigma is not None:
        known = f"{degrees(evidence.sigma.rotation_deg)} and {degrees(evidence.sigma.translation_deg)}"
        said += f"; the new pose is known to {known}"
    return f"{_assuming(said, evidence)}{f', and was written to {out}' if out else ''}."


def _changed_heading(result: Accepted | Refused) -> tuple[str, str]:
    if result.verdict == "unchanged":
        return "What the captures say", "From the rig's pose (before) to the one that they support by themselves."
    lead = "What the answer would have been, had it been trusted." if result.verdict == "refused" else ""
    return "What changed", lead


def _scene_lead(result: Accepted | Refused) -> str:
    if result.verdict == "unchanged":
        return "The points as the captures alone would place them, and both poses of the projector: the rig's was kept."
    if result.verdict == "accepted":
        return "The points as the new rig measures them, and where both devices stand."
    return "The points as far as they can be placed. None of this is to be relied on."


def _facts(
    before: Rig, after: Rig | None, captures: Sequence[Capture], evidence: Evidence, unit: LengthUnit
) -> tuple[Fact, ...]:
    change, sigma = evidence.change, evidence.sigma or PoseSigma(float("nan"), float("nan"))
    if after is None or change is None:
        return (Fact("Correspondences", figures(evidence.correspondences)), Fact("RMS", pixels(evidence.rms_px)))
    facts = [
        Fact("Rotation", degrees(change.rotation_deg), f"± {degrees(sigma.rotation_deg)}"),
        Fact("Direction of t", degrees(change.translation_deg), f"± {degrees(sigma.translation_deg)}"),
    ]
    if change.displacement is not None:
        note = f"at {unit.text(evidence.working_distance)}; now ± {unit.text(sigma.displacement)}"
        facts.append(Fact("Measured points move by", unit.text(change.displacement), note))
    missed = f"{pixels(median_residual(before, captures))} before"
    facts.append(Fact("Rays miss by (median)", pixels(median_residual(after, captures)), missed))
    return tuple(facts)
