"""What the frames since the rig last changed have said; saved, so that a stop within a bump costs no frame."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from retrue.correspondences import Correspondences
from retrue.errors import FileError, InputError
from retrue.files.kept_points import keep_points, read_kept_points
from retrue.geometry.arrays import finite_array
from retrue.plain_json import plain
from retrue.recalibration.creep import BUMP_FRAMES, Creep, after_frame, jump
from retrue.recalibration.result import Verification
from retrue.recalibration.streak import Drifted, Streak, after_bump, after_drifted, after_good, after_unknown
from retrue.rig import Rig
from retrue.watch.frame import Frame
from retrue.watch.options import WatchOptions


@dataclass(frozen=True, slots=True, eq=False)
class Kept:
    """A frame that may be recalibrated from, and how uncertain its own pose is."""

    name: str
    capture: Mapping[str, str]
    points: Correspondences
    uncertainty_deg: float


@dataclass(slots=True)
class Memory:
    """Bounded by the options of the watch: a few frames and a filter.

    Attributes
    ----------
    folder : for the points of drifted frames, which another process may go on from.
    kept : the drifted frames, by number.
    recent : the last frames that could tell; not saved, for others come soon.
    jumped : whether the first of the drifted frames was elsewhere than the one before it, or all that count are.
    """

    folder: Path
    streak: Streak = field(default_factory=Streak)
    kept: dict[int, Kept] = field(default_factory=dict[int, Kept])
    creep: Creep | None = None
    recent: list[Kept] = field(default_factory=list[Kept])
    jumped: bool = False

    def add(
        self, number: int, rig: Rig, frame: Frame, points: Correspondences, found: Verification, limits: WatchOptions
    ) -> None:
        """One more frame that was verified. Raises `FileError` where a drifted one cannot be saved."""
        pose = rig.projector_from_camera
        sigma = float("inf") if found.sigma is None else found.sigma.rotation_deg + found.sigma.translation_deg
        kept = Kept(frame.name, frame.capture, points, sigma)
        if found.verdict == "drifted" and not self.streak.drifted:
            self.jumped = self.creep is None or jump(self.creep, pose, found, limits.creep) > limits.creep.creep_sigmas
        bumps = 0 if self.creep is None else self.creep.bumps
        self.creep = after_frame(self.creep, pose, found, limits.creep)
        if found.verdict != "unknown":
            self.recent = [*self.recent, kept][-limits.remembered_frames :]
        if found.verdict == "good":
            self.streak = after_good()
        elif found.verdict == "unknown":
            self.streak = after_unknown(self.streak, limits)
        else:
            self.streak = after_drifted(self.streak, Drifted(number, sigma), limits)
            if self.creep is not None and self.creep.bumps > bumps:
                self.jumped, self.streak = True, after_bump(self.streak, BUMP_FRAMES)
            self.kept[number] = kept
            self.folder.mkdir(exist_ok=True)
            keep_points(self._path(number), points)
        self._let_go({drifted.number for drifted in self.streak.drifted})

    def forget(self) -> None:
        """Another rig: what frames said of the one before says nothing of it."""
        self.streak, self.creep, self.recent = Streak(), None, []
        self._let_go(set())

    def document(self) -> dict[str, Any]:
        """All but the points, as plain JSON values."""
        frames = [
            {"number": number, "name": item.name, "capture": item.capture, "uncertainty_deg": item.uncertainty_deg}
            for number, item in self.kept.items()
        ]
        streak = {"frames": frames, "untried": self.streak.untried, "unknown": self.streak.unknown}
        creep = None if self.creep is None else {item.name: getattr(self.creep, item.name) for item in fields(Creep)}
        return plain({"streak": streak, "creep": creep, "jumped": self.jumped})

    def restore(self, document: Mapping[str, Any]) -> None:
        """What `document` said. Raises `FileError`, and then nothing is remembered."""
        try:
            streak, creep = document["streak"], document["creep"]
            kept = {int(frame["number"]): self._read(frame) for frame in streak["frames"]}
            drifted = tuple(Drifted(number, frame.uncertainty_deg) for number, frame in kept.items())
            self.streak = Streak(drifted, int(streak["untried"]), int(streak["unknown"]))
            self.creep, self.kept, self.jumped = _creep(creep), kept, bool(document["jumped"])
        except (AttributeError, IndexError, KeyError, TypeError, ValueError, OverflowError, InputError) as error:
            self.forget()
            problem = error.problem if isinstance(error, FileError) else f"{type(error).__name__}: {error}"
            raise FileError(self.folder, f"what was known of earlier frames does not read: {problem}") from error

    def tidy(self) -> None:
        """Remove what a process that was killed left in the folder."""
        known = {self._path(number) for number in self.kept}
        for path in set(self.folder.glob("*.npz")) - known:
            path.unlink(missing_ok=True)
        self._let_go(set(self.kept))

    def _read(self, frame: Mapping[str, Any]) -> Kept:
        sigma = math.inf if frame["uncertainty_deg"] is None else float(frame["uncertainty_deg"])
        return Kept(frame["name"], dict(frame["capture"]), read_kept_points(self._path(int(frame["number"]))), sigma)

    def _let_go(self, numbers: set[int]) -> None:
        for number in [number for number in self.kept if number not in numbers]:
            del self.kept[number]
            self._path(number).unlink(missing_ok=True)
        if not self.kept:
            with contextlib.suppress(OSError):
                self.folder.rmdir()

    def _path(self, number: int) -> Path:
        return self.folder / f"{number}.npz"


def creep_values(creep: Creep | None) -> dict[str, Any] | None:
    """For people; None while the filter says nothing."""
    if creep is None or creep.baseline is None:
        return None
    rotation, translation = np.degrees(creep.added).tolist()
    return {"rotation_deg": rotation, "translation_deg": translation, "sigmas": creep.sigmas}


def _creep(document: Mapping[str, Any] | None) -> Creep | None:
    """Of plain values; lists are arrays, of as many numbers as the filter has."""
    if document is None:
        return None
    shapes = {"state": (10,), "covariance": (10, 10), "frame": (5, 5), "baseline": (5,), "baseline_covariance": (5, 5)}
    values: dict[str, Any] = {name: _numbers(document[name], shape) for name, shape in shapes.items()}
    for name in ("jumps", "recent"):
        values[name] = _numbers(document[name], (None, 5))
    values["scatter"] = float(document["scatter"])
    values.update({name: int(document[name]) for name in ("frames", "rested", "bumps")})
    return Creep(**values)


def _numbers(values: Any, shape: tuple[int | None, ...]) -> Any:
    return None if values is None else finite_array(values, shape, "filter")
