"""Why an answer was refused: a type for each reason, with the figures that it rests on.

`str(reason)` is one sentence for the user, and says what to do; the type is for programs.
"""

from __future__ import annotations

from dataclasses import dataclass

from retrue.errors import DegenerateError


@dataclass(frozen=True, slots=True)
class Reason:
    """Root of all reasons."""

    @property
    def name(self) -> str:
        """The type's name, as files and JSON give it."""
        return type(self).__name__


class Undecidable(DegenerateError):
    """Raised where the work stops before there is a pose; carries the reason."""

    def __init__(self, reason: Reason) -> None:
        self.reason = reason
        super().__init__(str(reason))


def reason_of(error: DegenerateError) -> Reason:
    """The reason that an error stands for."""
    return error.reason if isinstance(error, Undecidable) else PoseUndetermined(str(error))


@dataclass(frozen=True, slots=True)
class TooFewPoints(Reason):
    """Hardly anything was decoded."""

    found: int
    needed: int

    def __str__(self) -> str:
        return f"expected at least {self.needed} correspondences, found {self.found}; light more of the scene"


@dataclass(frozen=True, slots=True)
class PointsNotSpread(Reason):
    """The correspondences lie on one `shape`, "place" or "line", of a device's picture."""

    device: str
    shape: str

    def __str__(self) -> str:
        where = "at one place" if self.shape == "place" else "on one line"
        return f"all correspondences lie {where} of the {self.device} picture; they must be spread out"


@dataclass(frozen=True, slots=True)
class NoPlane(Reason):
    """Nothing flat fills enough of the picture."""

    correspondences: int

    def __str__(self) -> str:
        return (
            f"no plane among {self.correspondences} correspondences; have a wall, a board or a table top fill part of"
            " the picture"
        )


@dataclass(frozen=True, slots=True)
class PoseUndetermined(Reason):
    """The equations have no unique solution; `problem` is the solver's own sentence."""

    problem: str

    def __str__(self) -> str:
        return self.problem


@dataclass(frozen=True, slots=True)
class TwinsUnresolved(Reason):
    """Two poses explain the plane, and nothing tells which is true.

    Degrees from the old direction of t to that of the nearer and of the farther one.
    """

    near_deg: float
    far_deg: float

    def __str__(self) -> str:
        return (
            f"two poses explain the plane, {self.near_deg:.0f} and {self.far_deg:.0f} deg from the old direction of t,"
            " and too little lies off the plane to tell them apart; put an object or a second plane in view"
        )


@dataclass(frozen=True, slots=True)
class PlaneAndRestContradict(Reason):
    """The points off the plane prefer one pose clearly, and all points together the other."""

    off_plane: int

    def __str__(self) -> str:
        return (
            f"the plane and the {self.off_plane} correspondences off it support different poses; was something moving,"
            " or a lens zoomed?"
        )


@dataclass(frozen=True, slots=True)
class PointsBehind(Reason):
    """The pose has points behind a device, where it sees nothing."""

    share: float

    def __str__(self) -> str:
        return (
            f"the pose has {self.share:.0%} of the points behind the camera or the projector; is it this rig's picture,"
            " and are the two devices not swapped?"
        )


@dataclass(frozen=True, slots=True)
class Imprecise(Reason):
    """The points determine a pose, but hardly; one sigma each."""

    rotation_deg: float
    translation_deg: float

    def __str__(self) -> str:
        return (
            f"the points know the pose only to {self.rotation_deg:.2g} deg in rotation and {self.translation_deg:.2g}"
            " deg in the direction of t; fill more of the picture, or add captures"
        )


@dataclass(frozen=True, slots=True)
class PointsDisagree(Reason):
    """No pose explains enough of the correspondences well enough."""

    share: float
    needed_share: float
    noise_px: float
    max_noise_px: float

    def __str__(self) -> str:
        return (
            f"{self.share:.0%} of the correspondences agree with one pose, to {self.noise_px:.2g} px; expected"
            f" {self.needed_share:.0%} or more, to {self.max_noise_px:g} px: was something moving, have the intrinsics"
            " changed, or is it another rig's picture?"
        )


@dataclass(frozen=True, slots=True)
class ResidualsHaveStructure(Reason):
    """Neighbouring residuals share an error that no pose explains."""

    shared_px: float

    def __str__(self) -> str:
        return (
            f"neighbouring residuals share {self.shared_px:.2g} px that no pose explains; have the intrinsics changed"
            " (zoom, focus)? then calibrate anew"
        )


@dataclass(frozen=True, slots=True)
class PlaneContradicts(Reason):
    """A plane of its own supports another pose."""

    correspondences: int

    def __str__(self) -> str:
        return (
            f"a plane with {self.correspondences} correspondences contradicts the pose of the others; was something"
            " moving, or are pictures of two poses mixed?"
        )


@dataclass(frozen=True, slots=True)
class SurfaceContradicts(Reason):
    """Points that contradict the pose, and agree with each other."""

    share: float

    def __str__(self) -> str:
        return (
            f"{self.share:.0%} of the points contradict the pose as a surface does, not as wrong matches; was something"
            " moving, or have the intrinsics changed (zoom, focus)?"
        )


@dataclass(frozen=True, slots=True)
class PlanesInterleave(Reason):
    """Neighbouring points lie on different planes all over the picture."""

    share: float

    def __str__(self) -> str:
        return (
            f"{self.share:.0%} of the points have a neighbour on another plane, as if two scenes were seen at once; did"
            " the rig move during the capture, or are pictures of two poses mixed?"
        )


@dataclass(frozen=True, slots=True)
class FocalLengthChanged(Reason):
    """The points ask for another focal length of a device; relative, with its sigma."""

    device: str
    amount: float
    sigma: float

    def __str__(self) -> str:
        return (
            f"the points ask for a focal length of the {self.device} that is {self.amount:+.1%} off"
            f" (sigma {self.sigma:.1%}); was it zoomed or refocused? then calibrate anew"
        )


@dataclass(frozen=True, slots=True)
class ImplausibleChange(Reason):
    """The pose would have changed by more than a bump can.

    `checked`: whether the points speak for the intrinsics too; on a bare plane a zoom looks like a large move.
    """

    rotation_deg: float
    translation_deg: float
    limit_deg: float
    checked: bool

    def __str__(self) -> str:
        moved = (
            f"the pose would have changed by {self.rotation_deg:.0f} deg, the direction of t by"
            f" {self.translation_deg:.0f} deg; more than {self.limit_deg:g} deg "
        )
        if self.checked:
            return moved + "no bump does: is it this rig's picture? if it was rebuilt, allow it with --max-change-deg"
        return moved + (
            "is not believed of a plane alone, where a zoom looks the same; put objects or a second plane in view, or"
            " allow it with --max-unchecked-change-deg"
        )


@dataclass(frozen=True, slots=True)
class NearFold(Reason):
    """t is almost parallel to the normal of the only plane."""

    angle_deg: float

    def __str__(self) -> str:
        return (
            f"t is within {self.angle_deg:.1f} deg of the plane's normal, where a plane does not determine it; turn the"
            " plane, or put objects in view"
        )
