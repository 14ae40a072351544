"""Shows pictures and records, for each, one frame of the camera that shows it and nothing else: by what is in it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from retrue.devices.options import RecordOptions
from retrue.devices.protocols import CameraDriver, CameraFrame, ProjectorDriver
from retrue.devices.references import References, band_differences, grey_levels, still_noise
from retrue.devices.shown_pictures import Picture, black_and_white, fine_picture, fitting, mean_light, tag_pictures
from retrue.devices.stream_pass import Pace, run_pass
from retrue.errors import DeviceError
from retrue.geometry.arrays import Image

Progress = Callable[[int, int], None]

STILL_FRAMES = 6  # of white and of black, from which their noise is told
HOLDS = (2, 3, 4)
DELAYS = (0.0, 0.25, 0.5, 0.75)
TRIAL = 4  # pictures, black and white in turn
PERIOD_FRAMES = 16
MOST_POOR = 3  # passes
FEW = 4  # pictures that are not worth a pass
SHORTEST_PERIOD = 1e-4  # seconds between two frames
SEEN_CHANGE = 0.1  # of white over black, in some rows, by which a picture differs from what was shown before it
ALIKE = 1.5  # ratio of the differences of frames that stand still, however noisy they are


@dataclass
class Recorder:
    """Shows and records on one camera and one projector; what it measured of them is kept until `measure` is called.

    Attributes
    ----------
    references : white and black, as the camera saw them last.
    pace : how pictures can follow each other; None where that is not known yet, or only one after the other is safe.
    """

    camera: CameraDriver
    projector: ProjectorDriver
    options: RecordOptions = field(default_factory=RecordOptions)
    references: References | None = None
    pace: Pace | None = None
    _timed: bool = False
    _turn: int = 0
    _on_the_way: bool = False

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
        poor = 0  # passes that brought next to nothing
        while len(found) < len(wide):
            missing = [index for index in range(len(wide)) if index not in found]
            if self.pace is not None and len(missing) >= FEW and poor < MOST_POOR:
                new = self._pass([wide[index] for index in missing], self.pace)
                poor = 0 if len(new) >= FEW else poor + 1
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
        self.pace, self._timed = None, False
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
        self.pace = self._find_pace(self._period())
        self._timed = True

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
        """Between two frames, though some may be lost or late."""
        times = [self.camera.frame().at for _ in range(PERIOD_FRAMES)]
        steps = np.diff(times)
        usual = max(float(np.median(steps)), float(steps.mean()) / 2, SHORTEST_PERIOD)
        return float(steps.sum() / np.maximum(np.round(steps / usual), 0).sum())

    def _pass(self, pictures: Sequence[Picture], pace: Pace) -> dict[int, CameraFrame]:
        assert self.references is not None
        self._turn += 1
        self._on_the_way = True
        lag = self.options.max_lag_frames
        return run_pass(self.camera, self.projector, self.references, pictures, pace, lag, self._turn)

    def _find_pace(self, period: float) -> Pace | None:
        """The quickest at which a trial loses nothing, changing pictures when no row is exposed where that can be."""
        trial = black_and_white(self.projector.size) * (TRIAL // 2)
        for hold in (self.options.hold_frames,) if self.options.hold_frames else HOLDS:
            paces = [Pace(period, hold, delay) for delay in DELAYS]
            good = [len(self._pass(trial, pace)) == TRIAL for pace in paces]
            if any(good):
                return paces[_middle(good)]
        return None

    def _record_alone(self, picture: Picture, name: str) -> CameraFrame:
        """Show what differs most, wait for it, show the picture, and wait until it stands still."""
        assert self.references is not None
        if self.camera.triggered:
            return self._trigger(picture, name)
        black, white = black_and_white(self.projector.size)
        if self._on_the_way:  # what the last pass showed
            self._still(black)
            self._on_the_way = False
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


def _middle(good: Sequence[bool]) -> int:
    """Of the longest run of delays that do, in the round, the one in its middle.

    >>> _middle([True, False, False, True]), _middle([False, True, True, True])
    (3, 2)
    """
    count = len(good)
    runs = [
        (length, start)
        for start in range(count)
        for length in range(1, count + 1)
        if all(good[(start + step) % count] for step in range(length))
    ]
    length, start = max(runs, key=lambda run: (run[0], -run[1]))
    return (start + (length - 1) // 2) % count
