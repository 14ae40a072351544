"""Named limits of a watch."""

from __future__ import annotations

from dataclasses import dataclass

from retrue.errors import InputError


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

    drifted_frames: int = 3
    joint_frames: int = 5
    remembered_frames: int = 8
    forget_after: int = 10
    queue: int = 4
    poll_seconds: float = 0.2
    settle_seconds: float = 0.5
    patience_seconds: float = 10.0
    idle_seconds: float | None = None

    def __post_init__(self) -> None:
        for name in ("drifted_frames", "joint_frames", "queue"):
            if not getattr(self, name) >= 1:
                raise InputError(f"{name}: expected at least 1, found {getattr(self, name)}")
        if not self.remembered_frames >= self.drifted_frames:
            raise InputError(
                f"remembered_frames: expected at least {self.drifted_frames} as drifted_frames says, "
                f"found {self.remembered_frames}"
            )
        for name in ("poll_seconds", "settle_seconds", "patience_seconds", "idle_seconds"):
            value = getattr(self, name)
            if value is not None and not 0 <= value <= 1e6:
                raise InputError(f"{name}: expected 0 to a million seconds, found {value}")
