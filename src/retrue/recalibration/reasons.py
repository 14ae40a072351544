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
        return (
            f"{self.share:.0%} of the correspondences agree with one pose, to {self.noise_px:.2g} px; expected"
            f" {self.needed_share:.0%} or more, to {self.max_noise_px:g} px: was something moving, have the intrinsics"
            " changed, or is it another rig's picture?"
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
        return (
            f"the points know the pose to {self.rotation_deg:.2g} deg in rotation and {self.translation_deg:.2g} deg in"
            f" the direction of t, which moves points by {self.error:.1%} of their distance; expected"
            f" {self.max_error:.1%} or less: light more of the scene, at several depths, or add captures"
        )


@dataclass(frozen=True, slots=True)
class LensChanged(Reason):
    """The points contradict the rig's lenses; relative change of a device's focal length, with its sigma."""

    device: str
    amount: float
    sigma: float
    gain: float

    def __str__(self) -> str:
        return (
            f"the points contradict the rig's lenses: they ask for a focal length of the {self.device} that is"
            f" {self.amount:+.1%} off (sigma {self.sigma:.1%}); was it zoomed, refocused or cropped? if so, take the"
            " new focal lengths with --lens refit, or calibrate anew"
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
    """The captures do not share a pose; which one differs most from the others, counted from 1."""

    capture: int
    deviations: float

    def __str__(self) -> str:
        return (
            f"the captures do not share a pose: number {self.capture} is {self.deviations:.0f} sigma off the others;"
            " did the rig move between them? then recalibrate on each by itself"
        )


@dataclass(frozen=True, slots=True)
class LensUnchecked(Reason):
    """The answer would write over a rig, and rests on a word that nobody gave."""

    def __str__(self) -> str:
        return (
            "the points cannot check the lenses, and a rig is only written over on your word that nobody touched"
            " them; give it with --lens fixed, or show objects at several depths"
        )
