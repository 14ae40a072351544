"""Pictures shown one after another at the camera's pace, and of each the frame that shows it, some frames later.

Each stays until every row has been exposed to it alone, and once more to some of it: two frame times at most.
Where no frame has all its rows whole, its bands come from two frames in a row. Nothing is taken for what it should be
by its time alone: frames must be the mixtures of pictures that their place among them says, before and after, up to a
tag at either end, whose looks are known. A picture some rows of which were lost is shown again, for as long as those
rows need, and must look as it did.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from retrue.devices.frame_order import FITS, KNOWN, PRIOR, FrameOrder, Looks, Placed, Shows
from retrue.devices.probes import Probes
from retrue.devices.protocols import CameraDriver, CameraFrame, ProjectorDriver
from retrue.devices.references import BANDS, References, grey_levels
from retrue.devices.shown_pictures import Picture, coarse_change, tag_pictures
from retrue.devices.shutter import MARGIN, TOUCHED, Shutter
from retrue.geometry.arrays import Image

FEWEST_SIGHTS = 2  # frames that hold some of a picture, in each band
RECENT = 16  # frames by which lateness is judged
BAD_FRAMES = 3  # in a row that are not what they are taken for, after which nothing is
VISIBLE_CHANGE = 0.4  # of full scale: two pictures that differ so much must look different
SHARE_OF_CHANGE = 0.1  # of white over black by which they must, in some rows
MOST_TURNS = 8  # of one picture in a pass
LONGEST_DOUBT = 6  # frames after the last picture, for which a doubt may be resolved
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


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """What is proven of a picture that is not whole yet.

    Attributes
    ----------
    frame : the picture; where its rows come from, mostly. `whole` : (BANDS,) those that are right in it.
    sights : (BANDS,) frames that held some of it.
    looks : what it looks like, as far as they tell.
    """

    frame: CameraFrame
    whole: NDArray[np.bool_]
    sights: NDArray[np.intp]
    looks: Looks


class _Run:
    def __init__(self, how: Pass, pictures: Sequence[Picture], turn: int, past: Sequence[float]) -> None:
        self._how, self._pictures = how, pictures
        tags = tag_pictures(how.projector.size)
        self._tags = [tags[turn % 2], tags[2]]
        looks = [how.references.tags[turn % 2], how.references.tags[2]]
        self._looks = [
            Looks(how.probes.light(how.probes.of(look), how.shutter.gamma), np.full(BANDS, KNOWN**2)) for look in looks
        ]
        self._shows = Shows()
        for at in past:
            self._shows.add(at)
        self._keys = [-1] * (1 + len(past))  # of each show, which picture it is of; -1: none
        self._order = FrameOrder(how.shutter, how.probes, self._shows, how.noise, how.max_lag)
        self._queue = deque(range(len(pictures)))
        self._frames: dict[int, CameraFrame] = {}  # those that may still be needed
        self._lags = deque([how.shutter.lag[1]], RECENT)
        self._last: Picture | None = None
        self._done = self._before_all = len(self._keys)  # shows that are judged
        self._bad = 0
        self._found: dict[int, CameraFrame] = {}
        self._parts: dict[int, _Part] = {}
        self._before: tuple[int, Image] | None = None  # the picture before, and what it looked like

    def run(self) -> dict[int, CameraFrame]:
        self._show(self._tags[0], 0.0, -1, self._looks[0])
        self._take(self._how.camera.frame())
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
                self._judge(*self._order.ended(), waits=waited < LONGEST_DOUBT)
            if self._done == len(self._shows.at) - 1 and not self._queue and self._keys[-1] < 0:
                break
        self._judge(*self._order.ended(), waits=False)
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

    def _show(self, picture: Picture, at: float, key: int, looks: Looks | None = None) -> None:
        if key in self._parts:
            looks = self._parts[key].looks
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
        """When each row that lacks has been exposed to what is shown now alone, and once more to some of it."""
        shutter, on, part = self._how.shutter, self._shows.at[-1], self._parts.get(self._keys[-1])
        if self._how.hold_frames:
            return on + self._how.hold_frames * shutter.period
        lacks, sights = np.ones(BANDS, bool), np.full(BANDS, FEWEST_SIGHTS)
        if part is not None:
            lacks, sights = ~part.whole, np.maximum(FEWEST_SIGHTS - part.sights, 0)
        elif self._keys[-1] < 0:  # of a tag the looks are known
            sights[:] = 1
        sights[~self._how.probes.lit] = 0
        seen = shutter.seen_by(on, self._how.probes.edges, lacks, sights)
        if len(self._keys) > self._before_all + 1:
            return seen
        begin = shutter.start + min(shutter.readout, 0.0) - 2 * MARGIN * shutter.period
        return begin + np.ceil((seen - begin) / shutter.period) * shutter.period  # the first row of a frame is next

    def _judge(self, settled: Placed | None, following: int, *, waits: bool = True) -> None:
        """Take what is settled of each picture, up to the last frame that is; show again what is not proven.

        What later frames may yet decide is waited for.
        """
        if settled is None:
            return
        doubtful = self._order.doubtful | settled.doubts.keys()
        undecided = doubtful - (self._order.doubtful - self._order.undecided) if waits else frozenset[int]()
        while self._done < len(self._shows.at) - 1:
            on, off = self._shows.at[self._done], self._shows.at[self._done + 1]
            begin = self._how.shutter.begins(following, self._how.probes.middle).min()
            if begin < off - TOUCHED * self._how.shutter.exposure:
                break
            key = self._keys[self._done]
            if key >= 0 and key not in self._found:
                touching = [placed for placed in settled.back() if placed.first <= self._done]
                if any(placed.index in undecided and placed.is_touched(self._done) for placed in touching):
                    break
                frame = self._proven(self._done, key, on, off, touching, doubtful)
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

    def _proven(
        self, show: int, key: int, on: float, off: float, frames: Sequence[Placed], doubtful: frozenset[int]
    ) -> CameraFrame | None:
        """The picture, where each band of it is whole in a frame, and nothing in any frame speaks against it."""
        part, sure, last = self._parts.get(key), True, None
        sights = np.zeros(BANDS, np.intp) if part is None else part.sights
        sources = [] if part is None else [(part.whole, part.frame)]
        lit = self._how.probes.lit
        for placed in frames:
            place = show - placed.first
            held = placed.shares[:, place] > TOUCHED if place < placed.shares.shape[1] else np.zeros(BANDS, bool)
            if not held.any():
                continue
            if placed.index in doubtful:
                sure = False
                continue
            if (held & lit & (placed.off > FITS)).any():
                self._parts.pop(key, None)
                return None
            sights, last = sights + held, last or placed
            if placed.index in self._frames:
                whole = self._how.shutter.whole(placed.number, self._how.probes.edges, on, off)
                sources.append((whole, self._frames[placed.index]))
        if not sources:
            return None
        for (one, first), (other, second) in combinations(sources, 2):
            both, pair = one & other, (grey_levels(first.picture), grey_levels(second.picture))
            if both.any() and (self._how.references.excesses(pair[0], pair[1])[both] > 1).any():
                self._parts.pop(key, None)
                return None
        whole, frame = _composed(sources)
        levels = grey_levels(frame.picture)
        if not whole.all() or (sights[lit] < FEWEST_SIGHTS).any():
            if sure and last is not None:
                self._parts[key] = _Part(frame, whole, sights, last.looks(show))
            else:  # the frames that are sure tell what is whole in them, and no more
                probes, gamma = self._how.probes, self._how.shutter.gamma
                light = np.where(whole[:, None], probes.light(probes.of(levels), gamma), PRIOR[0])
                looks = Looks(light, np.where(whole, KNOWN, PRIOR[1]) ** 2)
                self._parts[key] = _Part(frame, whole, np.where(whole, sights, 0), looks)
            return None
        self._parts.pop(key, None)
        before = self._before
        if (
            before is not None
            and coarse_change(self._pictures[key], self._pictures[before[0]]) >= VISIBLE_CHANGE
            and not self._how.references.differ(levels, before[1], SHARE_OF_CHANGE)
        ):
            return None
        self._before = key, levels
        return frame


def _composed(sources: Sequence[tuple[NDArray[np.bool_], CameraFrame]]) -> tuple[NDArray[np.bool_], CameraFrame]:
    """One frame of the bands that are whole in any, most of them from one; and which they are."""
    order = sorted(sources, key=lambda source: -int(source[0].sum()))
    whole, frame = order[0]
    rows = np.array_split(np.arange(len(frame.picture)), BANDS)
    for other, second in order[1:]:
        new = other & ~whole
        if new.any():
            mine = np.concatenate([rows[band] for band in np.flatnonzero(new)])
            picture = frame.picture.copy()
            picture[mine] = second.picture[mine]
            whole, frame = whole | new, CameraFrame(picture, frame.at)
    return whole, frame
