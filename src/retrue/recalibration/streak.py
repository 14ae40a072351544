"""When to recalibrate, and from which frames: a state and pure functions of it, without any input or output.

good      the streak ends
drifted   the streak grows; long enough, it is time to recalibrate
unknown   says nothing, for a while: a hand before the lens does not end a streak
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from retrue.errors import InputError
from retrue.ranges import check_ranges, ranged


@dataclass(frozen=True, slots=True)
class StreakOptions:
    """When it is time to recalibrate.

    Attributes
    ----------
    drifted_frames
        Frames that must have drifted, with none in between that is good, before the rig is recalibrated.
    joint_frames
        Frames that are solved together: those among the drifted that know their pose best.
    remembered_frames
        Drifted frames that are kept to choose from.
    forget_after
        Unknown frames in a row (dark, no plane) after which drifted ones before them no longer count.
    """

    drifted_frames: int = ranged(3, 1)
    joint_frames: int = ranged(5, 1)
    remembered_frames: int = ranged(8, 1)
    forget_after: int = ranged(10, 1)

    def __post_init__(self) -> None:
        check_ranges(self)
        if not self.remembered_frames >= self.drifted_frames:
            raise InputError(
                f"remembered_frames: expected at least {self.drifted_frames} as drifted_frames says, "
                f"found {self.remembered_frames}"
            )


@dataclass(frozen=True, slots=True)
class CreepOptions:
    """When many frames together say that the rig creeps.

    Attributes
    ----------
    creep_memory
        Frames that the filter averages over; before so many it says nothing.
    creep_sigmas
        Creep that counts, in sigma of the filter; and a frame that jumps so far from the one before is no creep.
    creep_share
        Creep that is worth a recalibration, in sigma of a single frame.
    """

    creep_memory: int = ranged(30, 2)
    creep_sigmas: float = ranged(5.0, 1, 1e3)
    creep_share: float = ranged(1.0, 0, 1e3)

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, slots=True)
class Drifted:
    """A frame that had drifted: its number, and how uncertain its own pose is (degrees; the less the better)."""

    number: int
    uncertainty_deg: float


@dataclass(frozen=True, slots=True)
class Streak:
    """What is remembered between frames.

    Attributes
    ----------
    drifted : the latest frames that had drifted, oldest first, none of them good in between.
    untried : how many of them came since the last attempt to recalibrate.
    unknown : frames since the last one that could tell.
    """

    drifted: tuple[Drifted, ...] = ()
    untried: int = 0
    unknown: int = 0


def after_good() -> Streak:
    """The rig holds: what drifted before was noise, or somebody put the rig right."""
    return Streak()


def after_drifted(streak: Streak, frame: Drifted, options: StreakOptions) -> Streak:
    """One more, the oldest forgotten where there are too many.

    >>> options = StreakOptions(drifted_frames=2, remembered_frames=2)
    >>> streak = Streak()
    >>> for number in (7, 8, 9):
    ...     streak = after_drifted(streak, Drifted(number, 0.1), options)
    >>> [frame.number for frame in streak.drifted], is_due(streak, options)
    ([8, 9], True)
    """
    kept = (*streak.drifted, frame)[-options.remembered_frames :]
    return Streak(kept, streak.untried + 1)


def after_unknown(streak: Streak, options: StreakOptions) -> Streak:
    """The same streak, until so many could not tell that it may be another scene by now."""
    if streak.unknown + 1 >= options.forget_after:
        return Streak()
    return replace(streak, unknown=streak.unknown + 1)


def after_bump(streak: Streak, frames: int) -> Streak:
    """The last frames agree on another place than those before them: only they count, and none was tried yet.

    >>> streak = after_bump(Streak(tuple(Drifted(number, 0.1) for number in (3, 4, 5)), untried=1), 2)
    >>> [frame.number for frame in streak.drifted], streak.untried
    ([4, 5], 2)
    """
    kept = streak.drifted[-frames:]
    return Streak(kept, len(kept))


def is_due(streak: Streak, options: StreakOptions) -> bool:
    """Whether as many frames drifted, since the last attempt, as it takes."""
    return streak.untried >= options.drifted_frames


def attempts(streak: Streak, options: StreakOptions) -> list[tuple[int, ...]]:
    """Numbers of the frames to solve together: the best of all; and, if that is refused, the newest alone.

    The first uses most; the second succeeds where the rig moved again within the streak.
    """
    best = sorted(streak.drifted, key=lambda frame: frame.uncertainty_deg)[: options.joint_frames]
    newest = streak.drifted[-options.drifted_frames :]
    tried = [tuple(sorted(frame.number for frame in frames)) for frames in (best, newest)]
    return list(dict.fromkeys(tried))


def after_refusal(streak: Streak) -> Streak:
    """The frames are kept, but others must come before it is worth another attempt."""
    return replace(streak, untried=0)
