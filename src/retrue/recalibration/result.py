"""What a recalibration answers: Accepted with a rig, or Refused with none; evidence with both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import NoneType
from typing import Any, Literal

import numpy as np

from retrue.answers import Reason
from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.geometry.plane import Plane
from retrue.geometry.robust import quantile
from retrue.geometry.transform import RigidTransform
from retrue.geometry.two_view import FREE, TwoViewPoints, TwoViewPose, residuals
from retrue.recalibration.fit import PoseFit
from retrue.recalibration.options import LensWord
from retrue.recalibration.reasons import TOO_LITTLE, LensUnchecked, PoseDrifted
from retrue.recalibration.scale import inverse_depths
from retrue.recalibration.summary import change_text, evidence_rows, lens_condition, verification_rows
from retrue.rig import Rig
from retrue.rig_difference import displacement_rms, rig_difference
from retrue.shown import HasReport, ShortRepr, Shown, figures, in_space
from retrue.values import ByValue

Band = Literal["holds", "improvable", "recalibrate", "cannot tell"]
"""What a verification means to people: "improvable" is a drift that is found, and small."""

BANDS: Mapping[Literal["good", "drifted", "unknown"], Band] = {
    "good": "holds",
    "drifted": "recalibrate",
    "unknown": "cannot tell",
}


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PoseCandidate(ByValue, ShortRepr):
    """One of the poses that explain the captures, after refinement on all points.

    Attributes
    ----------
    projector_from_camera : t has the length that the scale policy gives it.
    planes : the planes of each capture in turn, camera frame, the rig's unit.
    rms_px : of the points that the best of the poses explains, Sampson distance.
    off_plane_rms_px : epipolar RMS of the points off the first plane; None where there are none.
    chosen : whether the evidence settled on this one.
    """

    projector_from_camera: RigidTransform
    planes: tuple[Plane, ...]
    rms_px: float
    off_plane_rms_px: float | None
    chosen: bool

    def _shown(self) -> Shown:
        off_plane = "" if self.off_plane_rms_px is None else f", {figures(self.off_plane_rms_px)} px off the plane"
        title = f"{'chosen' if self.chosen else 'not chosen'}, RMS {figures(self.rms_px)} px{off_plane}"
        rows = {"projector_from_camera": self.projector_from_camera.shown_title}
        return title, rows | {f"plane {number}": plane.shown_title for number, plane in enumerate(self.planes, start=1)}


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PoseChange(ByValue, ShortRepr):
    """From one pose to another.

    Attributes
    ----------
    rotation_deg, translation_deg : of R, and of the direction of t.
    length : by how much |t| grew, in the rig's unit.
    displacement : how far points at the working distance land elsewhere, RMS, in the rig's unit; None where that
        distance is not known.
    """

    rotation_deg: float
    translation_deg: float
    length: float
    displacement: float | None = None

    def _shown(self) -> Shown:
        displacement = "" if self.displacement is None else f", points by {figures(self.displacement)}"
        return f"{change_text(self)}, length {figures(self.length)}{displacement}", {}


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PoseSigma(ByValue, ShortRepr):
    """One standard deviation.

    Attributes
    ----------
    rotation_deg, translation_deg : of the angle of R, and of that of t.
    displacement : of points at the working distance, RMS, in the rig's unit; |t| is taken for exact. None where
        that distance is not known.
    """

    rotation_deg: float
    translation_deg: float
    displacement: float | None = None

    def _shown(self) -> Shown:
        displacement = "" if self.displacement is None else f", points {figures(self.displacement)}"
        return f"{change_text(self)}{displacement}", {}


@dataclass(frozen=True, slots=True)
class LensReport:
    """What the points say of the lenses.

    Attributes
    ----------
    verdict : "checked": they hold; "unchecked": the points do not tell, and the answer rests on the word that nobody
        touched them; "changed": they do not hold.
    focal_change, focal_sigma : relative, of camera and projector, as the points have it where lenses are free.
    word : yours, from the options.
    """

    verdict: Literal["checked", "unchecked", "changed"]
    focal_change: tuple[float, float]
    focal_sigma: tuple[float, float]
    word: LensWord | None = None

    @classmethod
    def of(
        cls,
        verdict: Literal["checked", "unchecked", "changed"],
        change: FloatArray,
        sigma: FloatArray,
        word: LensWord | None = None,
    ) -> LensReport:
        """From the eight lens parameters."""
        half = len(change) // 2
        return cls(
            verdict,
            (float(np.expm1(change[0])), float(np.expm1(change[half]))),
            (float(sigma[0]), float(sigma[half])),
            word,
        )


@dataclass(frozen=True, slots=True)
class RivalReport:
    """Another explanation, and the log evidence (nats) by which the answer beats it: in all, and where from."""

    name: str
    margin: float
    points: float
    light: float
    move: float


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Evidence(ByValue, ShortRepr):
    """What the verdict rests on. `None` where the work stopped before that was known.

    `working_distance` is the median depth of the points, in the rig's unit.
    """

    correspondences: int
    candidates: tuple[PoseCandidate, ...] = ()
    rms_px: float | None = None
    change: PoseChange | None = None
    sigma: PoseSigma | None = None
    resolved_by: str = ""
    scale: str = ""
    working_distance: float | None = None
    lenses: LensReport | None = None
    rivals: tuple[RivalReport, ...] = ()
    details: Mapping[str, Any] = field(default_factory=dict[str, Any])

    @property
    def pose(self) -> RigidTransform | None:
        """projector_from_camera that the captures support by themselves, also where the rig's own is kept."""
        return next((one.projector_from_camera for one in self.candidates if one.chosen), None)

    @property
    def lens(self) -> Literal["checked", "unchecked", "changed"] | None:
        """What the points say of the lenses, in one word."""
        return None if self.lenses is None else self.lenses.verdict

    def _shown(self) -> Shown:
        return self.resolved_by and f"resolved by {self.resolved_by}", evidence_rows(self)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Accepted(ByValue, ShortRepr, HasReport):
    """The new rig, why this pose, and the evidence; `unchanged`: the rig still holds, and `rig` is the old one."""

    rig: Rig
    reason: str
    evidence: Evidence
    unchanged: bool = False

    @property
    def verdict(self) -> Literal["accepted", "unchanged"]:
        """In one word."""
        return "unchanged" if self.unchanged else "accepted"

    @property
    def cause(self) -> None:
        """Nothing speaks against it."""

    def _shown(self) -> Shown:
        condition = lens_condition(self.evidence.lenses)
        return f"{condition and f'{condition}, '}{self.reason}", evidence_rows(self.evidence, self.rig.unit)

    def _in_space(self) -> str:
        return in_space(rig=self.rig)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Refused(ByValue, ShortRepr, HasReport):
    """No rig: the picture cannot tell, or what it tells is not to be trusted; the cause says what to do."""

    cause: Reason
    evidence: Evidence

    @property
    def verdict(self) -> Literal["refused"]:
        """In one word."""
        return "refused"

    @property
    def reason(self) -> str:
        """The cause in one sentence."""
        return str(self.cause)

    def _shown(self) -> Shown:
        return self.reason, evidence_rows(self.evidence)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Verification(ByValue, ShortRepr, HasReport):
    """Whether a capture still fits a rig.

    Attributes
    ----------
    verdict : "good", "drifted" or "unknown".
    epipolar_rms_px : of the capture's points under the rig as it stands.
    drift : from the rig to the pose that the capture itself supports; None when unknown.
    sigma : of that drift, the rig's own uncertainty included.
    working_distance : median depth of the points, in the rig's unit.
    cause : why the answer is not "good"; None where it is.
    supported_pose : projector_from_camera that the capture itself supports, with the rig's |t|; None as `drift`.
    band : the verdict for people: a rig that drifted is "improvable" or one to "recalibrate".
    drift_sigmas : Mahalanobis length of that drift in the sigma of the capture (chi with 5 degrees of freedom).
    covariance, statistical_covariance : (5, 5) of the supported pose, as in a recalibration's evidence; the second is
        without what the lenses leave open, which all captures of a scene share.
    """

    verdict: Literal["good", "drifted", "unknown"]
    reason: str
    epipolar_rms_px: float | None
    correspondences: int
    drift: PoseChange | None = None
    drift_sigmas: float | None = None
    sigma: PoseSigma | None = None
    working_distance: float | None = None
    cause: Reason | None = None
    supported_pose: RigidTransform | None = None
    band: Band = "cannot tell"
    covariance: FloatArray | None = None
    statistical_covariance: FloatArray | None = None

    @property
    def forbids_measuring(self) -> bool:
        """Whether points measured from this capture would be wrong: the rig has drifted, by more than is improvable,
        or neither its pose nor any other explains the capture."""
        return self.band == "recalibrate" or not isinstance(self.cause, (*TOO_LITTLE, PoseDrifted, NoneType))

    def _shown(self) -> Shown:
        return f"{self.verdict}: {self.reason}", verification_rows(self)


def unattended(result: Accepted | Refused) -> Accepted | Refused:
    """The answer where it would write over a rig and nobody reads it first: refused where it rests on no one's word."""
    lenses = result.evidence.lenses
    if not isinstance(result, Accepted) or result.unchanged or lenses is None:
        return result
    if lenses.verdict == "unchecked" and lenses.word != "fixed":
        return Refused(LensUnchecked(), result.evidence)
    return result


def refuted(verification: Verification, cause: Reason) -> Verification:
    """The same where more is known against the rig than its points told."""
    return replace(verification, verdict="drifted", band=BANDS["drifted"], cause=cause, reason=str(cause))


def candidate(fit: PoseFit, points: TwoViewPoints, scored: BoolArray, length: float, *, chosen: bool) -> PoseCandidate:
    """One pose with t of that length; `scored` (N,) are the points that the best of the poses explains.

    Points that a fit was made without are asked all the same.
    """
    across, planes = fit.found.epipolar, points.plane_index
    if np.isnan(across[scored]).any():
        across = np.where(np.isnan(across), residuals(fit.pose, points).epipolar, across)
    largest = int(np.argmax(np.bincount(planes[planes != FREE], minlength=1)))
    off_plane = scored & (planes != largest)
    return PoseCandidate(
        RigidTransform(fit.pose.R, fit.pose.t * length),
        tuple(Plane.from_n(n / length) for n in fit.pose.planes),
        rms(across[scored]),
        rms(across[off_plane]) if off_plane.any() else None,
        chosen,
    )


def working_distance(fit: PoseFit, points: TwoViewPoints, length: float) -> float | None:
    """Median depth in the camera frame of the points that agree, for t of that length; None where none is in front."""
    disparity = inverse_depths(fit.pose, points.select(fit.explained))
    disparity = disparity[disparity > 0]
    return length / quantile(disparity, 0.5) if len(disparity) else None


def change(rig: Rig, new: RigidTransform, distance: float | None) -> PoseChange:
    """From the rig's pose to the new one; points at that distance are seen by the new rig and measured with the old."""
    found = rig_difference(replace(rig, projector_from_camera=new), rig, distance)
    return PoseChange(found.rotation_deg, found.translation_deg, -found.length, found.displacement)


def sigma(covariance: FloatArray) -> PoseSigma:
    """Standard deviations of the angle of rotation and of the angle of t from a (5, 5) covariance."""
    return PoseSigma(
        float(np.degrees(np.sqrt(np.trace(covariance[:3, :3])))),
        float(np.degrees(np.sqrt(np.trace(covariance[3:, 3:])))),
    )


def sigma_at(distance: float | None, covariance: FloatArray, pose: TwoViewPose, rig: Rig) -> PoseSigma:
    """The same, and what it does to points at that distance: the displacements of independent errors, added up."""
    angles = sigma(covariance)
    if distance is None:
        return angles
    length = float(np.linalg.norm(rig.projector_from_camera.t))
    true = replace(rig, projector_from_camera=RigidTransform(pose.R, pose.t * length))
    values, vectors = np.linalg.eigh(covariance)
    steps: FloatArray = vectors * np.sqrt(np.maximum(values, 0.0))
    moved = [TwoViewPose(pose.R, pose.t).moved(step) for step in steps.T]
    wrong = [(off.R, off.t * length) for off in moved]
    return replace(angles, displacement=float(np.linalg.norm(displacement_rms(true, true, wrong, distance))))


def rms(values: FloatArray) -> float:
    """Root mean square; NaN of nothing.

    >>> rms(np.array([3.0, 4.0])).__round__(6)
    3.535534
    """
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")
