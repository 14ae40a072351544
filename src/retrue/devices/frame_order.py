"""Which exposure each frame of a camera is of, told by what is in it, however late it comes and whatever is lost.

What was shown when, and the shutter, say how much of each picture is in each row of exposure n. A frame that is taken
for that exposure must be that mixture of what the frames before it tell of these pictures, of which nothing else is
known: per band a linear model with normal priors, whose likelihood a Kalman filter gives frame by frame. How late
frames come is learned on the way (a Polya urn). All numberings that are worth it are followed side by side; of those
that know the same of what is to come, the best (Viterbi).

A frame that holds a new picture is unlikely whatever it looks like, as nobody could know it. The numbering that is
right pays for the picture when it comes; one that takes the frame for a mixture with the picture before pays a frame
later. So one is given up only where the best also beats it in what frames are off, what was learned not counted.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from retrue.devices.probes import Probes
from retrue.devices.shutter import TOUCHED, Shutter
from retrue.geometry.arrays import FloatArray

SIGMA = 0.03  # of white over black: what a frame may be off the mixture, its noise apart
PRIOR = 0.5, 0.5  # mean and sigma of a pixel of a picture that is not known
KNOWN = 0.05  # sigma of one that is
INDEPENDENT = 3.0  # of the pixels of a band: neighbours tell the same
LOST = 3.0  # nats that each lost frame costs
UNUSUAL = 0.5  # nats for each frame by which all come later, or sooner, than they did
OTHER_LAG = 2.0  # frames that come as none did, to be counted with those that are told by how late they came
WORTH = 40.0  # nats behind the best numbering, up to which others are followed
MOST_ALIVE = 64  # of them
SURE = 15.0  # nats by which a numbering must beat any other one
MOST_LOST = 3  # frames in a row, beyond those that the arrivals tell of
FITS = 9.0  # mean square of what a frame is off, in sigmas, up to which it is what it is taken for


@dataclass(frozen=True, slots=True, eq=False)
class Looks:
    """What is known of a picture: (BANDS, PROBES) mean of its light, and (BANDS,) variance."""

    mean: FloatArray
    variance: FloatArray


@dataclass(slots=True)
class Shows:
    """What was shown, one after the other, and since when.

    Attributes
    ----------
    at : when each came on; the first, which nobody knows, before all.
    known : what it looks like, or None.
    same : whether it is the same as the one before it.
    """

    at: list[float] = field(default_factory=lambda: [-np.inf])
    known: list[Looks | None] = field(default_factory=lambda: [None])
    same: list[bool] = field(default_factory=lambda: [False])

    def add(self, at: float, known: Looks | None = None, same: bool = False) -> None:
        self.at.append(at)
        self.known.append(known)
        self.same.append(same)

    def off(self, index: int) -> float:
        """When the next one came on."""
        return self.at[index + 1] if index + 1 < len(self.at) else np.inf


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """A frame that is taken for one exposure, and those before it.

    Attributes
    ----------
    index : of the frame, from 0. `number` : of its exposure.
    first : the first picture that may be in it. `shares` : (BANDS, pictures) from that one on.
    off : (BANDS,) mean square of what it is off, in sigmas.
    mean, covariance : (BANDS, pictures, PROBES), (BANDS, pictures, pictures) what is known of these pictures now.
    doubts : of frames up to this one that another numbering, nearly as good, numbers otherwise, the nats between them.
    """

    index: int
    number: int
    first: int
    shares: FloatArray
    off: FloatArray
    mean: FloatArray
    covariance: FloatArray
    before: Placed | None
    doubts: Mapping[int, float] = field(default_factory=dict[int, float])

    def back(self) -> Iterator[Placed]:
        """This one, and all before it."""
        placed: Placed | None = self
        while placed is not None:
            yield placed
            placed = placed.before

    def looks(self, show: int) -> Looks:
        """What is known of one of its pictures."""
        place = show - self.first
        return Looks(self.mean[:, place], np.maximum(self.covariance[:, place, place], KNOWN**2))

    def is_touched(self, show: int) -> bool:
        """Whether the frame holds some of that."""
        place = show - self.first
        return 0 <= place < self.shares.shape[1] and bool((self.shares[:, place] > TOUCHED).any())

    def is_alone(self, show: int) -> bool:
        """Whether the frame holds nothing but that, as far as it tells."""
        place = show - self.first
        return 0 <= place < self.shares.shape[1] and bool((self.shares[:, place] >= 1 - TOUCHED).all())


@dataclass(frozen=True, slots=True, eq=False)
class _Numbering:
    """All frames so far, each taken for one exposure.

    Attributes
    ----------
    score : log likelihood. `fit` : what it would be, had the pictures been known.
    last : the last frame.
    lags : how many frames came so many periods late, the usual least lag apart.
    """

    score: float
    fit: float
    last: Placed
    lags: Mapping[int, int]

    def state(self) -> tuple[int, int, bytes]:
        """Where it is, and how well it knows the pictures there: what comes depends on nothing else before."""
        variance = np.diagonal(self.last.covariance, axis1=1, axis2=2)
        sigma = np.sqrt(np.maximum(variance, 0.0))  # it may round to less
        return self.last.number, self.last.first, np.round(sigma / SIGMA).tobytes()


class FrameOrder:
    """Takes the frames one by one."""

    def __init__(self, shutter: Shutter, probes: Probes, shows: Shows, noise: float, max_lag: int) -> None:
        self.shutter, self.probes, self.shows = shutter, probes, shows
        self._variance, self._max_lag = SIGMA**2 + noise**2, max_lag
        self._lags = Counter(self._late(lag) for lag in shutter.lags)
        self._alive: list[_Numbering] = []
        self._arrived = 0.0
        self._count = 0

    @property
    def best(self) -> Placed | None:
        """The last frame, as the best numbering has it."""
        return self._alive[0].last if self._alive else None

    @property
    def doubtful(self) -> frozenset[int]:
        """Frames that a numbering nearly as good as any numbers otherwise, whether it is still followed or not."""
        score, fit = (max(values) for values in zip(*((one.score, one.fit) for one in self._alive), strict=True))
        found = set[int]()
        for one in self._alive:
            behind = min(score - one.score, fit - one.fit)
            found |= {index for index, nats in one.last.doubts.items() if nats + behind < SURE}
        return frozenset(found)

    @property
    def undecided(self) -> frozenset[int]:
        """Those of them that what comes may decide: of the others it tells nothing."""
        return self.doubtful - self._alive[0].last.doubts.keys()

    def settled(self) -> tuple[Placed | None, int]:
        """The last frame that all numberings which are still followed share; and where the next one is at least."""
        if not self._alive:
            return None, 0
        heads = [numbering.last for numbering in self._alive]
        nexts = [head.number for head in heads]
        while any(head is not heads[0] for head in heads):
            latest = max(head.index for head in heads)
            for place, head in enumerate(heads):
                if head.index == latest:
                    if head.before is None:
                        return None, 0
                    heads[place], nexts[place] = head.before, head.number
        return heads[0], min(nexts)

    def add(self, levels: np.ndarray, arrival: float) -> None:
        """The next frame."""
        seen = self.probes.light(self.probes.of(levels), self.shutter.gamma)
        found = list[_Numbering]()
        if not self._count:
            latest = int(np.floor((arrival - self.shutter.start - self.shutter.lag[0]) / self.shutter.period + 0.5))
            for lag in range(-self._max_lag, self._max_lag + 1):  # later, or sooner, than when the shutter was told
                found.append(self._placed(None, latest - lag, arrival, UNUSUAL * abs(lag), seen))
        else:
            gap = (arrival - self._arrived) / self.shutter.period
            punctual = self._late(arrival - self.shutter.start)
            for numbering in self._alive:
                last = numbering.last.number
                steps = {round(gap), round(gap) + 1, *(punctual - late - last for late in numbering.lags)}
                for step in sorted({*range(1, 2 + MOST_LOST), *(step for step in steps if step > 0)}):
                    found.append(self._placed(numbering, last + step, arrival, LOST * min(step - 1, MOST_LOST), seen))
        found.sort(key=lambda one: -one.score)
        rivals = dict[tuple[int, int, bytes], list[_Numbering]]()
        for one in found:
            if one.score >= found[0].score - WORTH or one.fit >= found[0].fit - WORTH:
                rivals.setdefault(one.state(), []).append(one)
        self._alive = [_doubted(alike) for alike in list(rivals.values())[:MOST_ALIVE]]
        self._arrived = arrival
        self._count += 1

    def ended(self) -> tuple[Placed, int]:
        """As `settled`, where nothing that comes tells more: what numberings as good as the best deny is doubtful."""
        last = _doubted(self._alive).last
        return last, last.number + 1

    def all_show(self, show: int) -> bool:
        """Whether the last frame holds nothing but that, by each numbering that is followed."""
        return all(numbering.last.is_alone(show) for numbering in self._alive)

    def _late(self, lag: float) -> int:
        """In periods, beyond the usual least."""
        return round((lag - self.shutter.lag[0]) / self.shutter.period)

    def _placed(
        self, before: _Numbering | None, number: int, arrival: float, cost: float, seen: FloatArray
    ) -> _Numbering:
        """The filter's step: that frame taken for that exposure."""
        shutter, probes, shows = self.shutter, self.probes, self.shows
        lags = before.lags if before else self._lags
        lag = self._late(arrival - float(shutter.begins(number, np.zeros(1))[0]))
        if before:
            like = lags.get(lag, 0) + OTHER_LAG / (1 + self._max_lag)
            cost -= float(np.log(like / (sum(lags.values()) + OTHER_LAG)))
        lags = {**lags, lag: lags.get(lag, 0) + 1}
        begin = shutter.begins(number, probes.middle)
        at: FloatArray = np.array(shows.at)
        low = max(int(np.searchsorted(at, float(begin.min()), side="right")) - 1, before.last.first if before else 0)
        high = max(int(np.searchsorted(at, float(begin.max()) + shutter.exposure, side="left")), low + 1)
        if before is not None:
            high = max(high, before.last.first + before.last.mean.shape[1])
        shares = shutter.shares(number, probes.middle, at[low:high])
        if high < len(at):  # the last of them ends
            shares[:, -1] = shutter.shares(number, probes.middle, at[low : high + 1])[:, -2]
        mean, covariance = self._known(before.last if before else None, low, high)
        gained = np.einsum("bij,bj->bi", covariance, shares)
        variance = np.einsum("bi,bi->b", gained, shares) + self._variance
        error = seen - np.einsum("bi,bip->bp", shares, mean)
        off = np.square(error).mean(axis=1) / variance
        lit = probes.lit
        score = -0.5 * INDEPENDENT * float((np.log(variance[lit]) + np.minimum(off[lit], 100.0)).sum())
        learned = 0.5 * INDEPENDENT * float(np.log(variance[lit] / self._variance).sum())
        gain = gained / variance[:, None]
        return _Numbering(
            (before.score if before else 0.0) + score - cost,
            (before.fit if before else 0.0) + score + learned - cost,
            Placed(
                self._count,
                number,
                low,
                shares,
                off,
                mean + gain[:, :, None] * error[:, None, :],
                covariance - gain[:, :, None] * gained[:, None, :],
                before.last if before else None,
                before.last.doubts if before else {},
            ),
            lags,
        )

    def _known(self, before: Placed | None, low: int, high: int) -> tuple[FloatArray, FloatArray]:
        """What is known of the pictures from `low` to `high`."""
        bands, probes = self.probes.index.shape
        count, kept = high - low, 0
        mean = np.full((bands, count, probes), PRIOR[0])
        covariance = np.zeros((bands, count, count))
        covariance[:, range(count), range(count)] = PRIOR[1] ** 2
        for index in range(low, high):
            known = self.shows.known[index]
            if known is not None:
                mean[:, index - low] = known.mean
                covariance[:, index - low, index - low] = known.variance
        if before is not None and before.first + before.mean.shape[1] > low:
            kept = before.first + before.mean.shape[1] - low
            skip = low - before.first
            mean[:, :kept] = before.mean[:, skip:]
            covariance[:, :kept, :kept] = before.covariance[:, skip:, skip:]
        for new in range(max(kept, 1), count):
            if self.shows.same[low + new]:
                mean[:, new] = mean[:, new - 1]
                covariance[:, new] = covariance[:, new - 1]
                covariance[:, :, new] = covariance[:, :, new - 1]
                covariance[:, new, new] = covariance[:, new - 1, new - 1]
        return mean, covariance


def _doubted(rivals: Sequence[_Numbering]) -> _Numbering:
    """The first of them, sorted, with the frames marked that others, nearly as good, number otherwise."""
    best = rivals[0]
    doubts = dict(best.last.doubts)
    for rival in rivals[1:]:
        behind = best.score - rival.score
        if behind >= SURE:
            break
        found = {index: nats + behind for index, nats in rival.last.doubts.items()}
        for mine, theirs in zip(best.last.back(), rival.last.back(), strict=True):
            if mine is theirs:
                break
            if mine.number != theirs.number:
                found[mine.index] = behind
        for index, nats in found.items():
            doubts[index] = min(nats, doubts.get(index, SURE))
    return best if doubts == best.last.doubts else replace(best, last=replace(best.last, doubts=doubts))
