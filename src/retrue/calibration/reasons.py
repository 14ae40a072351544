"""Why a calibration was refused: a type for each cause, with the figures that it rests on."""

from __future__ import annotations

from dataclasses import dataclass

from retrue.answers import Reason


@dataclass(frozen=True, slots=True)
class BoardNotSeen(Reason):
    """No capture shows the board; `left_out` says why, a name and a sentence each."""

    left_out: tuple[tuple[str, str], ...]

    def __str__(self) -> str:
        return f"no capture shows the board: {_listed(self.left_out)}"


@dataclass(frozen=True, slots=True)
class BoardOfAnotherSize(Reason):
    """Every picture shows one number of inner corners, which is not the board's."""

    said: tuple[int, int]
    seen: tuple[int, int]

    def __str__(self) -> str:
        return (
            f"the board is said to have {self.said[0]}x{self.said[1]} inner corners, "
            f"but every picture shows {self.seen[0]}x{self.seen[1]}: check --board"
        )


@dataclass(frozen=True, slots=True)
class TooFewPoses(Reason):
    """One pose of the board is left."""

    left_out: tuple[tuple[str, str], ...]

    def __str__(self) -> str:
        others = f" ({_listed(self.left_out)})" if self.left_out else ""
        return f"one pose of the board does not determine the intrinsics: capture at least five{others}"


@dataclass(frozen=True, slots=True)
class RigUndetermined(Reason):
    """The equations have no unique solution; `problem` is the solver's own sentence."""

    problem: str

    def __str__(self) -> str:
        return f"{self.problem}; is --board the whole board? Tilt it by 30 to 60 degrees, each time another way"


@dataclass(frozen=True, slots=True)
class BoardsParallel(Reason):
    """The poses of the board differ by no more than that angle."""

    angle_deg: float
    advice: str

    def __str__(self) -> str:
        return f"all boards are parallel within {self.angle_deg:.1f} degrees; {self.advice}"


@dataclass(frozen=True, slots=True)
class CornersMiss(Reason):
    """The fit leaves the corners too far from where they were seen."""

    rms_px: float
    largest_px: float

    def __str__(self) -> str:
        return f"the corners miss by {self.rms_px:.2g} px: is the board as --board says, and flat?"


@dataclass(frozen=True, slots=True)
class PointsUncertain(Reason):
    """Points measured with the rig would be less certain than asked for; lengths in its unit."""

    error: float
    distance: float
    unit: str
    advice: str

    def __str__(self) -> str:
        return (
            f"these poses leave points uncertain by {self.error:.3g} {self.unit} at {self.distance:.4g} "
            f"{self.unit}; {self.advice}"
        )


def _listed(left_out: tuple[tuple[str, str], ...]) -> str:
    return "; ".join(f"{name}: {reason}" for name, reason in left_out)
