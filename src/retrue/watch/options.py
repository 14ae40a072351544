"""Named limits of a watch."""

from __future__ import annotations

from dataclasses import dataclass, field

from retrue.ranges import ranged
from retrue.recalibration.streak import CreepOptions, StreakOptions


@dataclass(frozen=True, slots=True)
class WatchOptions(StreakOptions):
    """When a watch recalibrates, and how long it waits for what.

    Attributes
    ----------
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
    creep
        When many frames together say that the rig creeps.
    """

    queue: int = ranged(4, 1)
    poll_seconds: float = ranged(0.2, 0, 1e6)
    settle_seconds: float = ranged(0.5, 0, 1e6)
    patience_seconds: float = ranged(10.0, 0, 1e6)
    idle_seconds: float | None = ranged(None, 0, 1e6)
    creep: CreepOptions = field(default_factory=CreepOptions)
