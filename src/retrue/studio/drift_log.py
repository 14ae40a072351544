"""The drift of a rig over time: a line for each look of a watch, which goes on where it was after the end."""

from __future__ import annotations

import contextlib
import json
import math
import time
from collections import deque
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, cast

from retrue.errors import FileError
from retrue.files.atomic import read_tail
from retrue.recalibration.result import Verification
from retrue.shown import figures

REMEMBERED = 2000  # readings that are shown; the file keeps all
LONGEST_LINE = 400  # bytes
Verdict = Literal["good", "drifted", "unknown"]


@dataclass(frozen=True, slots=True)
class Reading:
    """One look.

    Attributes
    ----------
    at : seconds since 1970.
    drift, sigma : how far points land elsewhere, RMS, in the rig's unit, and one standard deviation of it; None where
        the picture did not tell.
    """

    at: float
    verdict: Verdict
    drift: float | None
    sigma: float | None

    @classmethod
    def of(cls, found: Verification) -> Reading:
        """Now."""
        drift = None if found.drift is None else found.drift.displacement
        sigma = None if found.sigma is None else found.sigma.displacement
        return cls(time.time(), found.verdict, drift, sigma)


def drift_in_words(found: Verification, unit: str) -> str:
    """By how much points are off, and what is uncertain in it; where nobody knows, why the rig has drifted."""
    drift, sigma = found.drift, found.sigma
    if drift is None or drift.displacement is None or sigma is None:
        return found.reason
    where = f"{figures(drift.displacement)} {unit} off at {figures(found.working_distance)} {unit}"
    return f"points are {where} (sigma {figures(sigma.displacement)} {unit}), turned by {drift.rotation_deg:.2f} deg"


class DriftLog:
    """A file that is only appended to.

    Attributes
    ----------
    on : whether somebody wants the rig to be watched; that, too, lasts.
    readings : the last ones, oldest first.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.on = False
        self.readings: deque[Reading] = deque(maxlen=REMEMBERED)
        for line in self._last_lines():
            with contextlib.suppress(ValueError, TypeError, KeyError):  # torn by a kill, or by hand
                self._take(json.loads(line))

    def switch(self, on: bool) -> None:
        """On or off. Raises `FileError` where that cannot be written, and nothing changes."""
        self._append({"watching": on})
        self.on = on

    def add(self, reading: Reading) -> None:
        """Raises `FileError` where it cannot be written."""
        self._append(asdict(reading))
        self.readings.append(reading)

    def _take(self, document: Any) -> None:
        values = cast("dict[str, Any]", document)
        if "watching" in values:
            self.on = values["watching"] is True
            return
        numbers = [values[name] for name in ("at", "drift", "sigma") if values[name] is not None]
        if values["verdict"] in ("good", "drifted", "unknown") and all(map(math.isfinite, numbers)):
            self.readings.append(Reading(float(values["at"]), values["verdict"], values["drift"], values["sigma"]))

    def _last_lines(self) -> list[bytes]:
        try:
            return read_tail(self._path, REMEMBERED * LONGEST_LINE)
        except FileNotFoundError:
            return []
        except OSError as error:
            raise FileError(self._path, f"cannot be read: {error.strerror or error}") from error

    def _append(self, document: dict[str, Any]) -> None:
        line = json.dumps(document, allow_nan=False).encode() + b"\n"
        try:
            with self._path.open("ab+", buffering=0) as stream:
                size = stream.seek(0, 2)
                if size:
                    stream.seek(size - 1)
                    if stream.read(1) != b"\n":  # a line that was torn stays alone
                        line = b"\n" + line
                if stream.write(line) != len(line):
                    raise OSError("the disk is full")
        except OSError as error:
            raise FileError(self._path, f"cannot be written: {error.strerror or error}") from error
