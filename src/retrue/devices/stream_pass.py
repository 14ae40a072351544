"""Pictures shown one after another at the camera's pace, and of each the frame that shows it, some frames later.

Each stays until every row has been exposed to it alone, and once more to some of it: two frame times less an exposure.
Where no frame has all its rows whole, its bands come from two frames in a row. Nothing is taken for what it should be
by its time alone: frames must be the mixtures of pictures that their place among them says, before and after, up to a
tag at either end, whose looks are known. A picture some rows of which were lost is shown again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from retrue.devices.frame_order import FITS, TOUCHED, FrameOrder, Placed, Shows
from retrue.devices.probes import Probes
from retrue.devices.protocols import CameraDriver, CameraFrame, ProjectorDriver
from retrue.devices.references import BANDS, References, grey_levels
from retrue.devices.shown_pictures import Picture, coarse_change, tag_pictures
from retrue.devices.shutter import MARGIN, Shutter
from retrue.geometry.arrays import Image

FEWEST_SIGHTS = 2  # frames that hold some of a picture, in each band
RECENT = 16  # frames by which lateness is judged
BAD_FRAMES = 3  # in a row that are not what they are taken for, after which nothing is
VISIBLE_CHANGE = 0.4  # of full scale: two pictures that differ so much must look different
SHARE_OF_CHANGE = 0.1  # of white over black by which they must, in some rows
MOST_TURNS = 3  # of one picture in a pass
PATIENCE = 8  # frames after the last one that was expected


@dataclass(frozen=True, slots=True, eq=False)
class Pass:
    """How pictures are shown one after the other.

    Attributes
    ----------
    hold_frames : that each picture stays for; 0: as few as it takes.
    max_lag : frames after which a picture must have arrived.
    noise : of a pixel, as a share of white over black.
    """

    camera: CameraDriver
    projector: ProjectorDriver
    references: References
    probes: Probes
    shutter: Shutter
    hold_frames: int
    max_lag: int
    noise: float

    def run(
        self, pictures: Sequence[Picture], turn: int, past: Sequence[float] = ()
    ) -> tuple[dict[int, CameraFrame], list[float]]:
        """The frames of those pictures that are proven, by position; and when pictures came on, for the pass after it.

        `turn` is odd and even in turn; `past` is when pictures came on that may still be on their way.
        """
        run = _Run(self, pictures, turn, past)
        return run.run(), run.times()


class _Run:
    def __init__(self, how: Pass, pictures: Sequence[Picture], turn: int, past: Sequence[float]) -> None:
        self._how, self._pictures = how, pictures
        tags = tag_pictures(how.projector.size)
        self._tags = [tags[turn % 2], tags[2]]
        looks = [how.references.tags[turn % 2], how.references.tags[2]]
        self._looks = [how.probes.light(how.probes.of(look), how.shutter.gamma) for look in looks]
        self._shows = Shows()
        for at in past:
            self._shows.add(at)
        self._keys = [-1] * (1 + len(past))  # of each show, which picture it is of; -1: none
        self._order = FrameOrder(how.shutter, how.probes, self._shows, how.noise, how.max_lag)
        self._queue = deque(range(len(pictures)))
        self._frames: dict[int, CameraFrame] = {}  # those that may still be needed
        self._lags = deque([how.shutter.lag[1]], RECENT)
        self._last: Picture | None = None
        self._done = len(self._keys)  # shows that are judged
        self._bad = 0
        self._found: dict[int, CameraFrame] = {}
        self._before: tuple[int, Image] | None = None  # the picture before, and what it looked like

    def run(self) -> dict[int, CameraFrame]:
        first = self._how.camera.frame()
        self._take(first)
        shutter = self._how.shutter
        soon = np.ceil((first.at - shutter.start) / shutter.period) + 1  # before the first row of a frame
        begin = shutter.start + min(shutter.readout, 0.0)
        self._show(self._tags[0], begin + (soon - 2 * MARGIN) * shutter.period, -1, self._looks[0])
        waited = 0
        while self._bad < BAD_FRAMES and waited < PATIENCE + self._how.max_lag:
            if self._queue and self._next_show() <= self._next_arrival():
                key = self._queue.popleft()
                self._show(self._pictures[key], self._next_show(), key)
                continue
            if not self._queue and self._keys[-1] >= 0 and self._next_show() <= self._next_arrival():
                self._show(self._tags[1], self._next_show(), -1, self._looks[1])
                continue
            waited = 0 if self._queue or self._keys[-1] >= 0 else waited + 1
            self._take(self._how.camera.frame())
            self._judge(*self._order.settled())
            if self._keys[-1] < 0 and self._order.all_show(len(self._keys) - 1):
                self._judge(*self._order.ended())
            if self._done == len(self._shows.at) - 1 and not self._queue and self._keys[-1] < 0:
                break
        self._judge(*self._order.ended())
        return self._found if self._closed() else {}

    def _closed(self) -> bool:
        """Whether it ends as it should: with the last tag where it is expected, and with no tag before it."""
        best, lit, before = self._order.best, self._how.probes.lit, self._before
        if best is None or before is None or self._bad or not best.is_alone(len(self._keys) - 1):
            return False
        tag = self._how.references.tags[2]
        alike = coarse_change(self._pictures[before[0]], self._tags[1]) < VISIBLE_CHANGE
        return bool((best.off[lit] <= FITS).all()) and (alike or not self._how.references.matches(before[1], tag))

    def times(self) -> list[float]:
        """When pictures came on that may be on their way to the camera."""
        return self._shows.at[1:][-2 * self._how.max_lag :]

    def _show(self, picture: Picture, at: float, key: int, looks: np.ndarray | None = None) -> None:
        on = self._how.projector.show(picture, at)
        self._shows.add(on, looks, same=self._last is not None and np.array_equal(picture, self._last))
        self._last = picture
        self._keys.append(key)

    def _take(self, frame: CameraFrame) -> None:
        self._order.add(grey_levels(frame.picture), frame.at)
        best = self._order.best
        assert best is not None
        self._frames[best.index] = frame
        self._lags.append(frame.at - self._how.shutter.begins(best.number, np.zeros(1))[0])
        lit = self._how.probes.lit
        self._bad = self._bad + 1 if np.mean(best.off[lit] > FITS) > 0.25 else 0

    def _next_arrival(self) -> float:
        """When the next frame has come for sure."""
        best, shutter = self._order.best, self._how.shutter
        assert best is not None
        return shutter.start + (best.number + 1) * shutter.period + max(self._lags)

    def _next_show(self) -> float:
        """When each row has been exposed to what is shown now alone, and once more to some of it."""
        shutter, on = self._how.shutter, self._shows.at[-1]
        if self._how.hold_frames:
            return on + self._how.hold_frames * shutter.period
        twice = on + 2 * shutter.period - (1 - 2 * TOUCHED) * shutter.exposure
        return max(shutter.seen_by(on, self._how.probes.edges), twice)

    def _judge(self, settled: Placed | None, following: int) -> None:
        """Take what is settled of each picture, up to the last frame that is; show again what is not proven."""
        if settled is None:
            return
        while self._done < len(self._shows.at) - 1:
            on, off = self._shows.at[self._done], self._shows.at[self._done + 1]
            begin = self._how.shutter.begins(following, self._how.probes.middle).min()
            if begin < off - TOUCHED * self._how.shutter.exposure:
                break
            key = self._keys[self._done]
            if key >= 0 and key not in self._found:
                touching = [placed for placed in settled.back() if placed.first <= self._done]
                frame = self._proven(self._done, key, on, off, touching)
                if frame is not None:
                    self._found[key] = frame
                else:
                    self._before = None
                    if key not in self._queue and self._keys.count(key) < MOST_TURNS:
                        self._queue.append(key)
            self._done += 1
        first = next(placed.index for placed in settled.back() if placed.first < self._done or placed.before is None)
        for index in [index for index in self._frames if index < first - 1]:
            del self._frames[index]

    def _proven(self, show: int, key: int, on: float, off: float, frames: Sequence[Placed]) -> CameraFrame | None:
        """The picture, where each band of it is whole in a frame, and nothing in any frame speaks against it."""
        sights, whole = np.zeros(BANDS, int), dict[int, np.ndarray]()
        lit, doubtful = self._how.probes.lit, frozenset[int]().union(*(placed.doubtful for placed in frames))
        for placed in frames:
            place = show - placed.first
            held = placed.shares[:, place] > TOUCHED if place < placed.shares.shape[1] else np.zeros(BANDS, bool)
            if not held.any():
                continue
            if placed.index in doubtful or (held & lit & (placed.off > FITS)).any():
                return None
            sights += held
            if placed.index in self._frames:
                whole[placed.index] = self._how.shutter.whole(placed.number, self._how.probes.edges, on, off)
        if not whole or not np.any(list(whole.values()), axis=0).all() or (sights[lit] < FEWEST_SIGHTS).any():
            return None
        for one, other in combinations(sorted(whole), 2):
            both = whole[one] & whole[other]
            pair = grey_levels(self._frames[one].picture), grey_levels(self._frames[other].picture)
            if both.any() and (self._how.references.excesses(pair[0], pair[1])[both] > 1).any():
                return None
        order = sorted(whole, key=lambda index: -int(whole[index].sum()))
        picture = self._frames[order[0]].picture
        if not whole[order[0]].all():
            picture, missing = picture.copy(), ~whole[order[0]]
            rows = np.array_split(np.arange(len(picture)), BANDS)
            for index in order[1:]:
                for band in np.flatnonzero(missing & whole[index]):
                    picture[rows[band]] = self._frames[index].picture[rows[band]]
                missing &= ~whole[index]
        levels, before = grey_levels(picture), self._before
        if (
            before is not None
            and coarse_change(self._pictures[key], self._pictures[before[0]]) >= VISIBLE_CHANGE
            and not self._how.references.differ(levels, before[1], SHARE_OF_CHANGE)
        ):
            return None
        self._before = key, levels
        return CameraFrame(picture, self._frames[order[0]].at)
