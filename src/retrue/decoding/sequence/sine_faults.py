"""What is wrong with pictures of sines, asked before they are read: wrong phases look like any others.

Of a sample of lit pixels. All sines of an axis tell one place, so a coarse one foretells the phase of the next finer;
and all pictures share the scene, so every sine has the same mean and much the same modulation. Where that does not
hold, what people do to a sequence is tried, and what makes it hold is told. Of orders that hold alike, the simplest
counts, and that by which the projector's picture stands upright; where neither stands better, none is read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from retrue.decoding.gray.faults import CAPTURE
from retrue.decoding.light import FULL
from retrue.decoding.sequence.hypotheses import LATEST, Sample, repeated_pictures, take_sample
from retrue.decoding.sequence.noise import measure_noise
from retrue.decoding.sequence.sine_gains import brightness, fit_sine_gains, fit_sine_share, odd_pictures, sine_misfit
from retrue.errors import CaptureError, InputError
from retrue.geometry.arrays import BoolArray, FloatArray, Image
from retrue.patterns.sequence import AXES, Frame, FrameSequence, Sine

NEAR = 1 / 6
"""Turns of the finer sine that a coarse one may be off; one pixel in three is so near by chance."""
ALIKE_MEAN, ALIKE_MODULATION = 0.35, (0.4, 2.5)
"""Of the modulation, by which means may differ, and the ratio of modulations."""
HOLDS, CLEAR = 0.7, 0.15
"""Share of pixels at which all agree in a sequence that is as expected; by how much another order must hold better."""
SURE = 2.0
"""Sigmas: where noise moves what a coarse sine foretells by `NEAR` at so many, it still tells."""
LEAST_TELLING = 0.02
"""Of the lit pixels: fewer that noise leaves able to tell cannot tell what is wrong."""
DARK = 0.2
"""Of the usual brightness: pictures before the first."""
GAMMAS = (0.45, 0.6, 0.75, 1.4, 1.8, 2.2, 2.6)
LEAST_SPREAD = 1.15
"""Of gains that cannot be told, to be named."""
LEAST_GAINS = 1.03
"""Of gains that are taken out."""
BETTER = 0.5
"""Of what no scene explains, that gains which are believed leave."""
MOST_PERIODS = 64
COARSE_FIRST = "the coarse sines come before the fine ones"
ROWS_FIRST = "the row pictures come before the column pictures"
ON_ITS_HEAD = "the projector's picture stands on its head, or the shifts of both axes run the other way"


@dataclass(frozen=True, slots=True)
class SineFault:
    """What was found: `causes`, and the sequence as it truly is, None where that cannot be read.

    `share` of the picture before in each, `gains` (pictures,) of each, None where they are all alike.
    """

    causes: tuple[str, ...]
    spec: FrameSequence | None
    share: float
    gains: FloatArray | None
    figures: dict[str, float]


def find_sine_fault(spec: FrameSequence, grey: Sequence[Image], names: Sequence[str]) -> SineFault | None:
    """None where the pictures are as expected, or too few pixels are lit to tell.

    Raises `CaptureError` where they are not, and nothing explains them.
    """
    if not any(_told(spec, axis) for axis in spec.axes):
        return None
    sample = take_sample(grey, np.random.default_rng(0))
    if sample is None:
        return None
    level = np.median(sample.here, axis=1)
    if dark := int(np.argmax(level > DARK * np.median(level))):
        return _unreadable(f"every picture shows what belongs {dark} earlier: the camera is late by {dark}")
    if same := _repeated(sample, spec):
        return _unreadable(
            f"{names[same[0]]} and {names[same[1]]} show the same, but should not: take the capture again"
        )
    causes, found = list[str](), spec
    ended = np.asarray((sample.here >= FULL * np.iinfo(grey[0].dtype).max).any(axis=0))
    share, gains = _light(sample, spec, ended)
    as_it_was = sample.corrected(np.ones(len(grey)) if gains is None else gains, share)
    here = as_it_was.here
    odd = odd_pictures(sample.here, spec, here)
    if not odd and (share or gains is not None):
        odd = odd_pictures(here, spec, here)
    if odd:
        return _without_odd(odd, spec, grey, names)
    held = agreement(here, spec)
    if not held > HOLDS:
        as_it_was = _telling(as_it_was, spec, grey)
        here = as_it_was.here
        held = agreement(here, spec)
    if not held > HOLDS and any(agreement(_straight(here, gamma), spec) > HOLDS for gamma in GAMMAS):
        return None  # reading measures that, and takes it out
    if not held > HOLDS:
        tried = [(agreement(here, made), what, made) for what, made in _orders(spec)]
        most = max((own[0] for own in tried), default=0.0)
        if most > max(held + CLEAR, HOLDS):
            alike = [own for own in tried if own[0] > most - CLEAR / 3]
            fewest = min(len(own[1]) for own in alike)
            simplest = [(_upright(_turning(as_it_was, own[2])), own) for own in alike if len(own[1]) == fewest]
            upright = [own for score, own in simplest if score == max(score for score, _ in simplest)]
            if len(upright) > 1:
                return _unreadable(_either([own[1] for own in upright], _turning(as_it_was, upright[0][2])))
            held, what, found = upright[0]
            causes += what
    if held > HOLDS:
        turning = _turning(as_it_was, found)
        aside = _aside(turning)
        if len(spec.axes) == 2 and np.linalg.det(turning) < 0 and aside:
            exchanged = list(_valid((ROWS_FIRST,), found, _axes_exchanged(found.frames)))
            if exchanged and ROWS_FIRST not in causes:
                causes.append(ROWS_FIRST)
                found = exchanged[0][1]
                turning, aside = _turning(as_it_was, found), False
        if len(spec.axes) == 2 and not aside and turning[0, 0] < 0 and turning[1, 1] < 0:
            causes.append(ON_ITS_HEAD)
        if share:
            causes.append(f"every picture holds {100 * share:.0f} % of the one before it: synchronise, or wait longer")
        if gains is not None:
            causes.append(f"{_unlike(float(gains.max() / gains.min()))}: switch automatic exposure off")
        figures = {
            "agreement": held,
            **({"share_of_picture_before": share} if share else {}),
            **({} if gains is None else {"gain_spread": float(gains.max() / gains.min())}),
        }
        return SineFault(tuple(causes), found, share, gains, figures) if causes else None
    for late in range(1, LATEST + 1):
        shown = [*range(late, len(grey))]
        part = _agreement_of(sample.here[shown], spec.frames[: len(shown)], spec)
        if part is not None and part > max(held + CLEAR, HOLDS):
            return _unreadable(f"every picture shows what belongs {late} earlier: the camera is late by {late}")
    if turned := _on_its_head(range(len(grey)), spec, grey, names):
        return _unreadable(turned)
    if periods := _periods(sample.here, spec):
        return _unreadable(periods)
    spread = brightness(sample.here, spec)
    if spread > LEAST_SPREAD:
        return _unreadable(f"{_unlike(spread)}: switch automatic exposure off")
    raise CaptureError(
        CAPTURE,
        f"coarse and fine sines agree at {100 * held:.0f} % of the lit pixels (one in three by chance): "
        "are order, shifts, periods and projector size those that were shown?",
    )


def _unreadable(cause: str) -> SineFault:
    return SineFault((cause,), None, 0.0, None, {})


def _unlike(spread: float) -> str:
    return f"brightness changes from picture to picture, by a factor of {spread:.2f}"


def _light(sample: Sample, spec: FrameSequence, ended: BoolArray) -> tuple[float, FloatArray | None]:
    """The share of the picture before in each, and the gains of the pictures; 0 and None where they explain nothing."""
    ones = np.ones(len(sample.here))
    share = fit_sine_share(sample, spec)
    mixed = sample.corrected(ones, share)
    if share and agreement(mixed.here, spec) < agreement(sample.here, spec) - CLEAR / 3:
        share, mixed = 0.0, sample
    gains = fit_sine_gains(sample, spec, ended)
    if not gains.max() > LEAST_GAINS * gains.min():
        return share, None
    left = [sine_misfit(seen.here[:, ~ended], spec) for seen in (mixed, sample.corrected(gains, 0.0))]
    return (0.0, gains) if left[1] < BETTER * left[0] else (share, None)


def _straight(here: FloatArray, gamma: float) -> FloatArray:
    """As a projector without that gamma would show it, of a pixel's contrast."""
    low = here.min(axis=0)
    return ((here - low) / np.maximum(np.ptp(here, axis=0), 1e-6)) ** (1 / gamma)


def _turning(sample: Sample, spec: FrameSequence) -> FloatArray:
    """(2, 2) how the phase of each axis' finest sine goes on to the pixel on the right and below; its median."""
    found = np.zeros((2, 2))
    for axis in spec.axes:
        if spec.sines(axis):
            sine = spec.sines(axis)[0]
            here = _fit(sample.here, sine)[1]
            for side, beside in enumerate((sample.right, sample.below)):
                gone = _fit(beside, sine)[1] - here
                found[axis, side] = sine.period_px * float(np.median(gone - np.rint(gone)))
    return found


def _aside(turning: FloatArray) -> bool:
    """Whether columns go on downwards, and rows to the right."""
    return bool(abs(turning[0, 1]) + abs(turning[1, 0]) > abs(turning[0, 0]) + abs(turning[1, 1]))


def _upright(turning: FloatArray) -> int:
    """How many axes run as they would upright, less those that run the other way; the axes exchanged where they are."""
    if not _aside(turning):
        return int(np.sign(np.diagonal(turning)).sum())
    return int(np.sign(np.diagonal(turning[::-1])).sum()) if turning.any(axis=1).all() else 0


def _either(orders: Sequence[Sequence[str]], turning: FloatArray) -> str:
    """That the pictures fit each of these orders, which would tell other places."""
    aside = "lies on its side" if _aside(turning) else "is mirrored"
    either = ", or ".join(" and ".join(order) for order in orders)
    return (
        f"{either}: these pictures fit either, since the projector's picture {aside}; set that right, or give the "
        "shifts as they were shown"
    )


def _telling(sample: Sample, spec: FrameSequence, grey: Sequence[Image]) -> Sample:
    """The pixels whose noise leaves a coarse sine able to foretell the next finer, all where they are most.

    Raises `CaptureError` where hardly any is: noise, not order, is then why sines disagree.
    """
    noise = measure_noise(grey, [spec.sines(axis) for axis in spec.axes if spec.sines(axis)])
    largest = np.zeros(sample.here.shape[1])
    modulations: list[float] = []
    for axis in spec.axes:
        for fine, coarse in pairwise(spec.sines(axis)):
            variance = np.zeros(sample.here.shape[1])
            for sine, turns in ((fine, 1.0), (coarse, coarse.period_px / fine.period_px)):
                mean, _, size = _fit(sample.here, sine)
                seen = len(sine.pictures) * (2 * np.pi * size) ** 2
                variance += np.asarray(2 * turns**2 * noise.at(mean) / np.maximum(seen, 1e-12), np.float64)
                modulations.append(float(np.median(size)))
            np.maximum(largest, variance, out=largest)
    told = np.flatnonzero(largest < (NEAR / SURE) ** 2)
    if len(told) < LEAST_TELLING * len(largest):
        usual = noise.floor + noise.gain * float(np.median(sample.here))
        raise CaptureError(
            CAPTURE,
            f"too noisy for these sines: {np.sqrt(usual):.1f} grey levels (sigma) beside a modulation of "
            f"{min(modulations):.1f}; a coarse sine cannot tell the turns of the next finer one: expose longer, or "
            "brighten the projector",
        )
    return Sample(sample.here[:, told], sample.right[:, told], sample.below[:, told])


def agreement(here: FloatArray, spec: FrameSequence) -> float:
    """Share of the pixels (pictures, N) at which the sines of every axis tell one place, of one scene."""
    shares = [
        own
        for axis in spec.axes
        if (own := _axis_agreement(here, spec.sines(axis), spec.projector_size[axis])) is not None
    ]
    return min(shares, default=1.0)


def _agreement_of(here: FloatArray, frames: Sequence[Frame], spec: FrameSequence) -> float | None:
    """The same of the first frames alone, by the sines that they show wholly; None where they tell nothing."""
    shares: list[float] = []
    for axis in spec.axes:
        whole = [sine for sine in spec.sines(axis) if max(sine.pictures) < len(frames)]
        if (own := _axis_agreement(here, whole, spec.projector_size[axis])) is not None:
            shares.append(own)
    return min(shares, default=None)


def _axis_agreement(here: FloatArray, sines: Sequence[Sine], side: int) -> float | None:
    if len(sines) < 2:
        return None
    seen = [_fit(here, sine) for sine in sines]
    good = np.ones(here.shape[1], np.bool_)
    for (fine, coarse), (a, b) in zip(pairwise(sines), pairwise(seen), strict=True):
        size = np.maximum(np.minimum(a[2], b[2]), 1e-6)
        ratio = a[2] / np.maximum(b[2], 1e-6)
        good &= np.abs(a[0] - b[0]) < ALIKE_MEAN * size
        good &= (ratio > ALIKE_MODULATION[0]) & (ratio < ALIKE_MODULATION[1])
        turns = coarse.period_px / fine.period_px
        repeats = max(side / coarse.period_px, 1) - 1
        if abs(turns - round(turns)) * repeats < NEAR / 2:  # else the coarse one's own turns matter
            off = b[1] % 1 * turns - a[1]
            good &= np.abs(off - np.rint(off)) < NEAR
    return float(np.mean(good))


def _fit(here: FloatArray, sine: Sine) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean, phase in turns, and modulation of each pixel."""
    angles = 2 * np.pi * np.array(sine.shifts)
    design = np.stack([np.ones_like(angles), np.cos(angles), np.sin(angles)], axis=1)
    mean, c, s = np.linalg.pinv(design) @ here[list(sine.pictures)]
    return mean, np.arctan2(s, c) / (2 * np.pi) + sine.offset_px / sine.period_px, np.hypot(c, s)


def _told(spec: FrameSequence, axis: int) -> bool:
    """Whether sines alone tell that axis, several of them."""
    return spec.gray(axis) is None and len(spec.sines(axis)) > 1


def _orders(spec: FrameSequence) -> Iterator[tuple[tuple[str, ...], FrameSequence]]:
    """What people do to the order of pictures and shifts, alone and together."""
    frames = spec.frames
    moved: dict[tuple[str, ...], list[Frame]] = {(): list(frames), (COARSE_FIRST,): _groups_reversed(frames)}
    if len(spec.axes) == 2:
        moved |= {(*what, ROWS_FIRST): _axes_exchanged(made) for what, made in moved.items()}
    longest = [max(sine.period_px for sine in spec.sines(axis)) for axis in spec.axes if spec.sines(axis)]
    for order, made in moved.items():
        if order:
            yield from _valid(order, spec, made)
        fine, coarse = (_backwards(made, lambda f, c=c: (f.period_px in longest) == c) for c in (False, True))
        yield from _valid((*order, "the shifts of the finer sines run the other way"), spec, fine)
        yield from _valid((*order, "the shifts of the coarsest sines run the other way"), spec, coarse)


def _valid(
    causes: tuple[str, ...], spec: FrameSequence, frames: Sequence[Frame]
) -> Iterator[tuple[tuple[str, ...], FrameSequence]]:
    try:
        yield causes, replace(spec, frames=tuple(frames), layout=None)
    except InputError:
        return


def _groups_reversed(frames: Sequence[Frame]) -> list[Frame]:
    """The sines of each axis in the opposite order, each with its shifts as they were."""
    made = list(frames)
    for axis in AXES:
        places = [k for k, frame in enumerate(frames) if frame.code == "phase" and frame.axis == axis]
        periods = list(dict.fromkeys(frames[k].period_px for k in places))
        order = [k for period in reversed(periods) for k in places if frames[k].period_px == period]
        for place, k in zip(places, order, strict=True):
            made[place] = frames[k]
    return made


def _axes_exchanged(frames: Sequence[Frame]) -> list[Frame]:
    places = [k for k, frame in enumerate(frames) if frame.axis is not None]
    order = sorted(places, key=lambda k: (frames[k].axis == "column") == (frames[places[0]].axis == "column"))
    made = list(frames)
    for place, k in zip(places, order, strict=True):
        made[place] = frames[k]
    return made


def _backwards(frames: Sequence[Frame], which: Callable[[Frame], bool]) -> list[Frame]:
    """Those sines' shifts the other way."""
    return [replace(f, shift=-f.shift) if f.shift is not None and which(f) else f for f in frames]


def _repeated(sample: Sample, spec: FrameSequence) -> tuple[int, int] | None:
    """The first two neighbours that show the same, though their frames differ."""
    for index in repeated_pictures(sample):
        a, b = spec.frames[index - 1], spec.frames[index]
        if a.code == b.code == "phase" and a != b:
            return index - 1, index
    return None


def _without_odd(odd: Sequence[int], spec: FrameSequence, grey: Sequence[Image], names: Sequence[str]) -> SineFault:
    """Of pictures of which one shows something else: left out where it is known, else named."""
    if len(odd) > 1:
        shows = f"one of {', '.join(names[k] for k in odd)} shows something else than its sine: take the capture again"
        return _unreadable(_on_its_head(odd, spec, grey, names) or shows)
    left = replace(
        spec, frames=tuple(Frame("ignore") if k in odd else f for k, f in enumerate(spec.frames)), layout=None
    )
    rest = find_sine_fault(left, grey, names) or SineFault((), left, 0.0, None, {})
    shows = f"{names[odd[0]]} shows something else than the others of its sine, and is left out"
    return replace(rest, causes=(shows, *rest.causes))


def _on_its_head(asked: Sequence[int], spec: FrameSequence, grey: Sequence[Image], names: Sequence[str]) -> str:
    """Which of those pictures, turned half round, makes all agree; nothing where none does."""

    def agreed(turned: int) -> float:
        pictures = [image[::-1, ::-1] if k == turned else image for k, image in enumerate(grey)]
        sample = take_sample(pictures, np.random.default_rng(0))
        return 0.0 if sample is None else agreement(sample.here, spec)

    fits = {k: agreed(k) for k in asked}
    best = max(fits, key=lambda k: fits[k])
    told = fits[best] > max(agreed(-1) + CLEAR, HOLDS)
    return f"{names[best]} stands on its head beside the others: take the capture again" if told else ""


def _periods(here: FloatArray, spec: FrameSequence) -> str:
    """That the finer sine has another number of periods within the coarse one; nothing where none fits."""
    for axis in spec.axes:
        sines = spec.sines(axis)
        if len(sines) < 2:
            continue
        fine, coarse = sines[-2:]
        expected = round(coarse.period_px / fine.period_px)
        fits = {
            count: _axis_agreement(
                here, [replace(fine, period_px=coarse.period_px / count), coarse], spec.projector_size[axis]
            )
            or 0.0
            for count in range(2, MOST_PERIODS + 1)
        }
        best = max(fits, key=lambda count: fits[count])
        if best != expected and fits[best] > max(HOLDS, fits.get(expected, 0.0) + CLEAR):
            return f"the {AXES[axis]} sines have {best} periods in one of the next coarser, the pattern says {expected}"
    return ""
