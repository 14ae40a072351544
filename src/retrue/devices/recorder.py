"""Shows pictures and records, for each, one frame of the camera that shows it and nothing else: by what is in it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import cast

import numpy as np

from retrue.devices.options import RecordOptions
from retrue.devices.probes import Probes, find_probes
from retrue.devices.protocols import CameraDriver, CameraFrame, ProjectorDriver
from retrue.devices.references import References, band_differences, grey_levels, still_noise
from retrue.devices.shown_pictures import Picture, black_and_white, fine_picture, fitting, mean_light, tag_pictures
from retrue.devices.shutter import Shutter
from retrue.devices.shutter_fit import Change, fit_shutter
from retrue.devices.stream_pass import Pass
from retrue.errors import DeviceError
from retrue.geometry.arrays import FloatArray, Image

Progress = Callable[[int, int], None]

STILL_FRAMES = 6  # of white and of black, from which their noise is told
CHANGES = 12  # from black to white and back, from which the shutter is told
PHASE = 0.382  # of a period, by which each comes later than the one before it
ARRIVED = 0.03  # of white over black, that a frame may hold of the picture before
PERIOD_FRAMES = 32
MOST_POOR = 3  # passes that bring nothing
MOST = 64  # pictures between two tags
FEW = 4  # pictures that are worth to find out how quickly they may follow each other
SHORTEST_PERIOD = 1e-4  # seconds between two frames
SEEN_CHANGE = 0.1  # of white over black, in some rows, by which a picture differs from what was shown before it
ALIKE = 1.5  # ratio of the differences of frames that stand still, however noisy they are


@dataclass
class Recorder:
    """Shows and records on one camera and one projector; what it measured of them is kept until `measure` is called.

    Attributes
    ----------
    references : white and black, as the camera saw them last.
    shutter : when the camera exposes which rows; None where that is not known yet, or cannot be told: then only one
        picture after the other is safe.
    """

    camera: CameraDriver
    projector: ProjectorDriver
    options: RecordOptions = field(default_factory=RecordOptions)
    references: References | None = None
    shutter: Shutter | None = None
    _probes: Probes | None = None
    _timed: bool = False
    _turn: int = 0
    _past: list[float] = field(default_factory=list[float])

    def record(self, pictures: Sequence[Picture], progress: Progress | None = None) -> list[CameraFrame]:
        """One frame for each picture (h, w) or (h, w, 3), in their order.

        Raises
        ------
        DeviceError
            the camera does not see what the projector shows, or either went away.
        """
        wide = [fitting(picture, self.projector) for picture in pictures]
        if self.references is None:
            self.measure()
        if len(wide) >= FEW and not self._timed and not self.camera.triggered:
            self._time()
        found: dict[int, CameraFrame] = {}
        poor = 0  # passes, one after the other, that brought nothing
        while len(found) < len(wide):
            missing = [index for index in range(len(wide)) if index not in found][:MOST]
            if self.shutter is not None and poor < MOST_POOR:
                new = self._pass([wide[index] for index in missing], self.shutter)
                poor = 0 if new else poor + 1
                if poor == 2:  # not by chance: the camera's time may have changed
                    self._time()
            else:
                new = {0: self._record_alone(wide[missing[0]], f"picture {missing[0] + 1} of {len(wide)}")}
            found |= {missing[index]: frame for index, frame in new.items()}
            if progress is not None:
                progress(len(found), len(wide))
        return [found[index] for index in range(len(wide))]

    def record_held(self, pictures: Sequence[Picture]) -> list[CameraFrame] | None:
        """One frame for each picture, of something that is held before the rig: quicker, and None where it moves.

        The first picture is white, and is shown already. It comes once more at the end, and must look as it did.
        """
        wide = [fitting(picture, self.projector) for picture in pictures]
        frames = [self.camera.frame() for _ in range(STILL_FRAMES)]
        still = [grey_levels(frame.picture) for frame in frames]
        apart = np.array([band_differences(one, other) for one, other in pairwise(still)])
        if (apart.max(axis=0) > ALIKE * apart.min(axis=0) + self.options.agree_levels).any():
            return None
        noise = still_noise(still)
        self.references = References(still[-1], np.zeros_like(still[-1]), (), noise, noise, self.options.agree_levels)
        self.shutter, self._timed = None, False
        found = [frames[-1]]
        for picture in (*wide[1:], wide[0]):
            base = grey_levels(found[-1].picture)
            frame = self._first_still(picture, lambda levels, base=base: self._differs(levels, base))
            if frame is None:
                return None
            found.append(frame)
        return found[:-1] if self.references.agree(grey_levels(found[-1].picture), still[-1]) else None

    def measure(self) -> None:
        """Look at black and at white, and tell the noise of both."""
        self._look(*black_and_white(self.projector.size))
        self._timed = False

    def _time(self) -> None:
        """Find out how quickly pictures may follow each other."""
        assert self.references is not None
        tags = tuple(self._still(tag)[-1] for tag in tag_pictures(self.projector.size))
        self.references = replace(self.references, tags=tags)
        still = self._still(fine_picture(self.projector.size))
        excess = max(self.references.excess(one, other) for one, other in pairwise(still))
        if excess > 1:  # a camera that compresses its pictures is noisier where there is more in them
            self.references = self.references.louder(excess)
        self._probes = find_probes(self.references)
        self.shutter = fit_shutter(self._changes(self._probes), self._probes, self._period(), self.camera.exposure_ms)
        self._timed = True

    def _changes(self, probes: Probes) -> list[Change]:
        """Frames in which black and white follow each other, at all phases of the camera's period."""
        black, white = black_and_white(self.projector.size)
        self._still(black)
        changes, period = list[Change](), self._period()
        last = self.camera.frame()
        for turn in range(CHANGES):
            to_white = turn % 2 == 0
            at = self.projector.show(white if to_white else black, last.at + (turn * PHASE) % 1 * period)
            frames, shares = [last], [0.0]
            while len(frames) <= self.options.max_lag_frames and not (len(shares) > 1 and min(shares[-2:]) == 1):
                last = self.camera.frame()
                light = probes.light(probes.of(grey_levels(last.picture)), 1.0)[probes.lit].mean(axis=1)
                light = light if to_white else 1 - light
                frames.append(last)
                shares.append(1.0 if (light > 1 - ARRIVED).all() else 0.0 if (light < ARRIVED).all() else 0.5)
            first = max(index for index, share in enumerate(shares) if share == 0)
            if shares[-1] == 1:
                frames = frames[first:-1]
                seen = np.array([probes.of(grey_levels(frame.picture)) for frame in frames])
                changes.append(Change(at, to_white, [frame.at for frame in frames], seen))
        return changes

    def _look(self, black: Picture, white: Picture) -> None:
        """At both: what they look like, and their noise."""
        dark, light = self._still(black), self._still(white)
        tags = () if self.references is None else self.references.tags
        looked = References(light[-1], dark[-1], tags, still_noise(light), still_noise(dark), self.options.agree_levels)
        if not looked.contrast >= self.options.min_contrast:
            raise DeviceError(
                self.camera.name,
                f"does not see what {self.projector.name} shows: its white is {looked.contrast:.1f} grey levels over "
                f"its black, expected {self.options.min_contrast:g} or more; "
                "point it there, darken the room, or expose longer",
            )
        self.references = looked

    def _period(self) -> float:
        """Between two frames, though some may be lost or late: the one that most arrivals are a multiple of apart."""
        times = np.array([self.camera.frame().at for _ in range(PERIOD_FRAMES)])
        usual = max(float(times[-1] - times[0]) / (len(times) - 1), SHORTEST_PERIOD)
        periods = usual * np.arange(0.7, 1.15, 0.1 / PERIOD_FRAMES)
        turns = np.exp(2j * np.pi * (times - times[0]) / periods[:, None]).sum(axis=1)
        best = int(np.abs(turns).argmax())
        counts = cast("FloatArray", np.round((times - times[0]) / periods[best]))
        return float(np.polyfit(counts, times, 1)[0])

    def _pass(self, pictures: Sequence[Picture], shutter: Shutter) -> dict[int, CameraFrame]:
        assert self.references is not None
        assert self._probes is not None
        self._turn += 1
        noise = max(self.references.white_noise.max(), self.references.black_noise.max()) / self.references.contrast
        devices = self.camera, self.projector, self.references, self._probes, shutter
        options = self.options
        found, self._past = Pass(*devices, options.hold_frames, options.max_lag_frames, float(noise)).run(
            pictures, self._turn, self._past
        )
        return found

    def _record_alone(self, picture: Picture, name: str) -> CameraFrame:
        """Show what differs most, wait for it, show the picture, and wait until it stands still."""
        assert self.references is not None
        if self.camera.triggered:
            return self._trigger(picture, name)
        black, white = black_and_white(self.projector.size)
        if self._past:  # what the last pass showed is on its way
            self._still(black)
            self._past = []
        for attempt in range(self.options.attempts):
            # White first where the picture is dark; then the other: perhaps the camera does not see where they differ.
            if (mean_light(picture) < 0.25) == (attempt % 2 == 0):
                light, reference = white, self.references.white
            else:
                light, reference = black, self.references.black
            before = self._first_still(light, lambda frame, end=reference: self._matches(frame, end))
            if before is not None:
                base = grey_levels(before.picture)
                frame = self._first_still(picture, lambda frame, base=base: self._differs(frame, base))
                if frame is not None:
                    return frame
            if attempt % 2:  # the light in the room, or what stands there, may have changed
                self._look(black, white)
        raise DeviceError(self.camera.name, f"no frame shows {name} as it stands still: is something moving before it?")

    def _first_still(self, picture: Picture, belongs: Callable[[Image], bool]) -> CameraFrame | None:
        """The second of two frames in a row that agree and belong to the picture; None where none come."""
        assert self.references is not None
        self.projector.show(picture)
        last: Image | None = None
        differences: list[float] = []
        for _ in range(self.options.max_lag_frames + STILL_FRAMES):
            frame = self.camera.frame()
            levels = grey_levels(frame.picture)
            if belongs(levels) and last is not None and belongs(last):
                if self.references.agree(last, levels):
                    return frame
                differences.append(float(band_differences(last, levels).max()))
            last = levels
        latest = differences[-STILL_FRAMES:]
        if len(latest) == STILL_FRAMES and max(latest) <= ALIKE * min(latest):
            self.references = self.references.louder(ALIKE)  # it does stand still, but is noisier than white and black
        return None

    def _still(self, picture: Picture) -> list[Image]:
        """Frames, as grey levels, of a picture that has surely arrived."""
        self.projector.show(picture)
        if self.camera.triggered:
            return [grey_levels(self.camera.frame().picture)] * 2
        for _ in range(self.options.max_lag_frames):
            self.camera.frame()
        return [grey_levels(self.camera.frame().picture) for _ in range(STILL_FRAMES)]

    def _trigger(self, picture: Picture, name: str) -> CameraFrame:
        assert self.references is not None
        for _ in range(self.options.attempts):
            self.projector.show(picture)
            frame = self.camera.frame()
            levels = grey_levels(frame.picture)
            if self._differs(levels, self.references.black if mean_light(picture) > 0.25 else self.references.white):
                return frame
        raise DeviceError(self.camera.name, f"no frame shows {name}: is the screen what the camera looks at?")

    def _differs(self, frame: Image, base: Image) -> bool:
        assert self.references is not None
        return self.references.differ(frame, base, SEEN_CHANGE)

    def _matches(self, frame: Image, reference: Image) -> bool:
        assert self.references is not None
        return self.references.matches(frame, reference)
