"""Why an answer was refused: a type for each reason, with the figures that it rests on.

The cause of an answer (`answers.py`) that was not hoped for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isinf

from retrue.answers import Reason
from retrue.correspondences import Correspondences
from retrue.errors import DegenerateError
from retrue.shown import figures

CLEAR = 3.0  # sigma, of a number of a lens that is named

SMALLEST_SHARE = 0.01  # below, there is none to speak of


class Undecidable(DegenerateError):
    """Raised where the work stops before there is a pose; carries the reason."""

    def __init__(self, reason: Reason) -> None:
        self.reason = reason
        super().__init__(str(reason))


def reason_of(error: DegenerateError, captures: Sequence[Correspondences]) -> Reason:
    """The reason that an error stands for; what decoders said of the captures explains why there are few points."""
    reason = error.reason if isinstance(error, Undecidable) else PoseUndetermined(str(error))
    said = [line for capture in captures if capture.card is not None for line in capture.card.advice]
    if isinstance(reason, TooFewPoints) and said:
        return replace(reason, advice="; ".join(dict.fromkeys(said)))
    return reason


@dataclass(frozen=True, slots=True)
class TooFewPoints(Reason):
    """Hardly anything was decoded; the advice is the decoder's own where it has some."""

    found: int
    needed: int
    advice: str = "light more of the scene"

    def __str__(self) -> str:
        return f"expected at least {self.needed} correspondences, found {self.found}; {self.advice}"


@dataclass(frozen=True, slots=True)
class PointsNotSpread(Reason):
    """The correspondences lie on one `shape`, "place" or "line", of a device's picture."""

    device: str
    shape: str

    def __str__(self) -> str:
        where = "at one place" if self.shape == "place" else "on one line"
        return f"all correspondences lie {where} of the {self.device} picture; they must be spread out"


@dataclass(frozen=True, slots=True)
class PoseUndetermined(Reason):
    """The equations have no unique solution; `problem` is the solver's own sentence."""

    problem: str

    def __str__(self) -> str:
        return self.problem


@dataclass(frozen=True, slots=True)
class PointsDisagree(Reason):
    """No pose explains enough of the correspondences well enough."""

    share: float
    needed_share: float
    noise_px: float
    max_noise_px: float

    def __str__(self) -> str:
        found = f"{self.share:.0%} of the correspondences agree with one pose, to {self.noise_px:.2g} px"
        if not self.share >= SMALLEST_SHARE:
            found = "no correspondences agree with one pose"
        return (
            f"{found}; expected {self.needed_share:.0%} or more, to {self.max_noise_px:g} px: was something moving,"
            " have the intrinsics changed, or is it another rig's picture?"
        )


@dataclass(frozen=True, slots=True)
class RivalUnbeaten(Reason):
    """Another explanation is nearly as good; `rival` says which, the margin is log evidence in nats."""

    rival: str
    margin: float
    rotation_deg: float
    translation_deg: float

    def __str__(self) -> str:
        return (
            f"{self.rival} explains the captures as well: {self.rotation_deg:.0f} deg away in rotation,"
            f" {self.translation_deg:.0f} deg in the direction of t; put an object or a second plane in view"
        )


@dataclass(frozen=True, slots=True)
class Imprecise(Reason):
    """The points determine a pose, but not closely enough: one sigma, as a share of the working distance."""

    rotation_deg: float
    translation_deg: float
    error: float
    max_error: float

    def __str__(self) -> str:
        moved = "any distance" if isinf(self.error) else f"{self.error:.1%} of their distance"
        return (
            f"the points know the pose to {self.rotation_deg:.2g} deg in rotation and {self.translation_deg:.2g} deg in"
            f" the direction of t, which moves points by {moved}; expected {self.max_error:.1%} or less: light more of"
            " the scene, at several depths, or add captures"
        )


@dataclass(frozen=True, slots=True)
class LensChanged(Reason):
    """The points contradict the rig's lenses; what of which device changed most clearly, in that thing's own unit.

    Where even that is less than three sigma, several numbers together would do, and the points do not tell which.
    """

    device: str
    what: str
    amount: float
    sigma: float
    gain: float

    def __str__(self) -> str:
        form, unit = {"focal length": ("+.1%", ""), "k1": ("+.2g", "")}.get(self.what, ("+.1f", " px"))
        amount, sigma = f"{self.amount:{form}}{unit}", f"{self.sigma:{form.lstrip('+')}}{unit}"
        asked = f"they ask for a {self.what} of the {self.device} that is {amount} off (sigma {sigma})"
        if not abs(self.amount) >= CLEAR * self.sigma:
            asked = "which number of the camera's or the projector's is off, they do not tell"
        return (
            f"the points contradict the rig's lenses: {asked}; was it zoomed, refocused or cropped? if so, take the new"
            " lenses with --lens refit, or calibrate anew"
        )


@dataclass(frozen=True, slots=True)
class PartsContradict(Reason):
    """Two large parts of the points support a pose each."""

    share: float
    other_share: float

    def __str__(self) -> str:
        return (
            f"{self.share:.0%} of the points support one pose and {self.other_share:.0%} another; did the rig move"
            " during the capture, are pictures of two poses mixed, or is half of the scene seen in a mirror?"
        )


@dataclass(frozen=True, slots=True)
class CapturesDiffer(Reason):
    """The captures do not share a pose; which one differs most from the others, counted from 1.

    `deviations` in sigma; infinite where hardly a point of it agrees with the others' pose.
    """

    capture: int
    deviations: float

    def __str__(self) -> str:
        off = "has no point in common with" if isinf(self.deviations) else f"is {self.deviations:.0f} sigma off"
        return (
            f"the captures do not share a pose: number {self.capture} {off} the others;"
            " did the rig move between them? then recalibrate on each by itself"
        )


@dataclass(frozen=True, slots=True)
class DevicesExchanged(Reason):
    """Taken for each other, camera and projector moved little; as they are, far. Degrees of both.

    Where their lenses are alike, the rig's pose may as well be `inverted`.
    """

    moved_deg: float
    meant_deg: float
    inverted: PoseInverted | None = None

    def __str__(self) -> str:
        other = "" if self.inverted is None else f". Or {self.inverted}"
        return (
            f"camera and projector may be exchanged: as they are, the rig moved by {self.moved_deg:.0f} deg, and"
            f" exchanged by {self.meant_deg:.0f}; are camera pixels first, and is it this rig's capture?{other}"
        )


@dataclass(frozen=True, slots=True)
class PoseInverted(Reason):
    """From the inverse of its old pose the rig moved little; from that as it is written, far. Degrees of both."""

    meant_deg: float
    moved_deg: float

    def __str__(self) -> str:
        return (
            "the rig's old pose may be written the other way round, as camera_from_projector: the rig moved by"
            f" {self.meant_deg:.0f} deg from its inverse, and by {self.moved_deg:.0f} as it is; if so, hand in the"
            " inverse"
        )


@dataclass(frozen=True, slots=True)
class PictureTurned(Reason):
    """Turned back by so many quarters, a device's picture says that the rig moved little; as it is, far, or nothing."""

    device: str
    quarters: int
    meant_deg: float
    moved_deg: float | None

    def __str__(self) -> str:
        turn = "half" if self.quarters == 2 else "a quarter"
        as_it_is = "no pose explains it" if self.moved_deg is None else f"by {self.moved_deg:.0f}"
        return (
            f"the {self.device}'s picture may be turned by {turn}: turned back, the rig moved by"
            f" {self.meant_deg:.0f} deg, and as it is, {as_it_is}; show or take it as for the calibration, or"
            " calibrate again"
        )


@dataclass(frozen=True, slots=True)
class AxesExchanged(Reason):
    """With x and y exchanged back in both devices, the rig moved little; as they are, far, or no pose explains them."""

    meant_deg: float
    moved_deg: float | None

    def __str__(self) -> str:
        as_it_is = "no pose explains them" if self.moved_deg is None else f"by {self.moved_deg:.0f}"
        return (
            "x and y may be exchanged, in both devices' points: exchanged back, the rig moved by"
            f" {self.meant_deg:.0f} deg, and as they are, {as_it_is}; x counts columns and comes first, y rows"
        )


@dataclass(frozen=True, slots=True)
class LensUnchecked(Reason):
    """The answer would write over a rig, and rests on a word that nobody gave."""

    def __str__(self) -> str:
        return (
            "the points cannot check the lenses, and a rig is only written over on your word that nobody touched"
            ' them; give it with --lens fixed (in TOML: lens = "fixed"), or show objects at several depths'
        )


@dataclass(frozen=True, slots=True)
class PoseDrifted(Reason):
    """The captures support another pose than the rig's; how far away, and what that moves points by.

    `inverted`: the rig's pose may be written the other way round.
    """

    rotation_deg: float
    translation_deg: float
    displacement: float | None
    distance: float | None
    unit: str
    deviations: float
    improvable: bool
    inverted: PoseInverted | None = None

    def __str__(self) -> str:
        moved = drift_text(self.rotation_deg, self.translation_deg, self.displacement, self.distance, self.unit)
        advice = "recalibrate where so little matters" if self.improvable else str(self.inverted or "recalibrate")
        return f"the capture supports another pose: {moved}, {self.deviations:.1f} sigma; {advice}"


@dataclass(frozen=True, slots=True)
class PoseContradicted(Reason):
    """The points contradict the rig's pose, though they do not tell which other one is right, and `doubt` says why."""

    deviations: float
    doubt: Reason

    def __str__(self) -> str:
        return f"the points contradict the rig's pose by {self.deviations:.1f} sigma, though {self.doubt}"


@dataclass(frozen=True, slots=True)
class RaysMiss(Reason):
    """The two rays of a point miss each other under this rig; RMS of the points that agree best."""

    rms_px: float
    max_noise_px: float

    def __str__(self) -> str:
        return (
            f"the rays of the points miss each other by {figures(self.rms_px, 2)} px under this rig; expected"
            f" {self.max_noise_px:g} px or less: is it the capture's rig, and does it hold? ask retrue verify"
        )


@dataclass(frozen=True, slots=True)
class OneCoordinate(Reason):
    """Only columns, or only rows, are known: each ray meets its plane wherever the rig stands."""

    def __str__(self) -> str:
        return (
            "one projector coordinate cannot tell whether the rig holds:"
            " take a few pictures of the other axis, too, and verify"
        )


TOO_LITTLE = (OneCoordinate, TooFewPoints, PointsNotSpread, PoseUndetermined, Imprecise, RivalUnbeaten)
"""Causes that say how little the points tell, and nothing against a rig."""


def drift_text(
    rotation_deg: float, translation_deg: float, displacement: float | None, distance: float | None, unit: str
) -> str:
    """From the rig's pose to the supported one."""
    moved = f"{rotation_deg:.3f} deg in rotation, {translation_deg:.3f} deg in the direction of t"
    if displacement is not None and isinf(displacement):
        moved += f", so far that no rays meet at {distance:.4g} {unit}" if distance else ""
    elif displacement is not None and distance is not None:
        moved += f", {round(displacement, 9):.4g} {unit} for points at {distance:.4g} {unit}"
    return moved
