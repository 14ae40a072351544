"""Named limits of a watch."""

from __future__ import annotations

from dataclasses import dataclass

from retrue.errors import InputError
from retrue.ranges import check_ranges, ranged


@dataclass(frozen=True, slots=True)
class WatchOptions:
    """When a watch recalibrates, and how long it waits for what.

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
    queue
        Frames that may wait. A camera's oldest one is dropped when another comes; a folder's stay on the disk.
    poll_seconds
        Between two looks into a folder.
    settle_seconds
        A picture in a folder must have stopped growing for so long.
    patience_seconds
        One that still cannot be read then is tried again for so long, and then passed over.
    idle_seconds
        End when a folder had nothing new for so long. Without it a watch goes on until it is stopped.
    """

    drifted_frames: int = ranged(3, 1)
    joint_frames: int = ranged(5, 1)
    remembered_frames: int = ranged(8, 1)
    forget_after: int = ranged(10, 1)
    queue: int = ranged(4, 1)
    poll_seconds: float = ranged(0.2, 0, 1e6)
    settle_seconds: float = ranged(0.5, 0, 1e6)
    patience_seconds: float = ranged(10.0, 0, 1e6)
    idle_seconds: float | None = ranged(None, 0, 1e6)

    def __post_init__(self) -> None:
        check_ranges(self)
        if not self.remembered_frames >= self.drifted_frames:
            raise InputError(
                f"remembered_frames: expected at least {self.drifted_frames} as drifted_frames says, "
                f"found {self.remembered_frames}"
            )
