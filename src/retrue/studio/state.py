"""All that the pages show of a studio, at one moment."""

from __future__ import annotations

from dataclasses import dataclass

from retrue.recalibration.result import Accepted, Verification
from retrue.reconstruction.cloud import Cloud
from retrue.studio.calibrating import Progress
from retrue.studio.drift_log import Reading
from retrue.studio.look import Look


@dataclass(frozen=True, slots=True, eq=False)
class Offer:
    """A recalibrated rig that waits for a word: keep it, or leave it."""

    result: Accepted
    before: Cloud
    after: Cloud


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """All that a page shows; a new one replaces it, so that whoever reads it sees one moment.

    Attributes
    ----------
    number : grows with every look.
    look : at the latest frame, with no points while a calibration goes on; None before the first.
    busy : what is being done; empty where nothing is.
    message : what came of the last thing that was asked, or what is wrong with a device.
    verification : of the last check.
    offer : after a check that found the rig drifted and could tell its new pose.
    cloud : the last scan.
    calibration : where one is going on.
    rig_there : whether there is a rig to check.
    watching : whether it is checked every few seconds. readings : what came of that.
    """

    number: int = 0
    look: Look | None = None
    busy: str = ""
    message: str = ""
    verification: Verification | None = None
    offer: Offer | None = None
    cloud: Cloud | None = None
    calibration: Progress | None = None
    rig_there: bool = False
    watching: bool = False
    readings: tuple[Reading, ...] = ()

    @property
    def drifted(self) -> bool:
        """Whether the last check, or the last reading of a watch, found the rig so."""
        watched = self.readings[-1].verdict if self.watching and self.readings else ""
        return "drifted" in (watched, self.verification and self.verification.verdict)
