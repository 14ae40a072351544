"""Why a sequence does not decode as expected; and, where the pictures can be read all the same, what they hold."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from retrue.decoding.gray.faults import CAPTURE, FOLDED, require_complements, require_light
from retrue.decoding.light import FULL
from retrue.decoding.sequence.arrange import ArrangedSequence, frames_of, grey_pictures, pair_starts, scene_lights
from retrue.decoding.sequence.exposure import BETTER, MISFIT, fit_gains, fit_share, unlike, unordered_gains
from retrue.decoding.sequence.hypotheses import (
    FEWEST_CHANGES,
    Hypothesis,
    Judgement,
    Sample,
    doubled_light,
    hypotheses,
    judge,
    repeated_pictures,
    take_sample,
)
from retrue.errors import CaptureError, InputError
from retrue.geometry.arrays import FloatArray, Image
from retrue.patterns.gray_code import GrayCode
from retrue.patterns.layouts import LAYOUTS, layout_sequence
from retrue.patterns.sequence import AXES, Code, Frame, FrameSequence

LEAST_SCORE = 0.55
"""Of a hypothesis that is believed."""
CLEAR_SCORE = 0.8
"""Of one that leaves nothing to ask."""
EVIDENT_SCORE = 0.97
"""Of one whose pictures need not be asked for faults of their light."""
BRIGHT, DARK = 90, 0.2
"""Percentile of the pixels of a picture, and below which share of the usual it shows no light."""
ALIKE_LIGHTS = 0.8
"""Of the contrast, by which white less black falls short, whatever the exposure of each."""
LEFT = 0.5
"""Of what does not fit, at most, is left by a picture turned half round that is believed to stand on its head."""
LEAST_GAIN = 0.03
"""By which it must fit better than what was expected."""
SURPRISE = 0.01
"""Of score that each cause must earn, and every two pictures that it leaves unexplained."""
AS_GOOD = 1.5
"""Times the misfit of the best correction: a simpler one that leaves no more is believed."""
LEAST_SHARE, LEAST_SPREAD = 0.04, 1.08
HEADROOM = 1.3
SINUSOIDAL = 0.3
"""Share of pixels between dark and bright in a picture, beyond which it shows a sine."""
MIDDLE = (0.2, 0.8)
"""Of a pixel's brightness: a sine passes here, a bit does not."""
DARK_AND_BRIGHT = (10, 90)
"""Percentiles of a picture's pixels."""
LEAST_RANGE = 0.3
"""Of a pixel's brightness, between these, of a picture that shows both."""
LEAST_TOLD = 0.5
"""Of the lit pixels: so many must be below the end of the scale to tell sines from bits."""


@dataclass(frozen=True, slots=True, eq=False)
class Diagnosis:
    """The hypothesis that fits a sequence best.

    Attributes
    ----------
    causes : what happened, a clause each; nothing where all is as expected.
    sequence : the pictures as that makes them, to be decoded; None where they cannot be read.
    figures : by name, for the card.
    """

    causes: tuple[str, ...]
    sequence: ArrangedSequence | None
    figures: dict[str, float]


def diagnose(pattern: GrayCode | FrameSequence, images: Sequence[Image], names: Sequence[str]) -> Diagnosis | None:
    """Fit what may have happened to all pictures together; None where nothing fits, or all is as expected.

    First the order: which frames the pictures show, whatever their brightness. Then what each picture's brightness was
    multiplied by, and which share of the picture before it each holds.
    """
    frames = frames_of(pattern, len(images))
    if frames is None:
        return None
    grey = grey_pictures(images)
    sample = take_sample(grey, np.random.default_rng(0))
    if sample is None:
        return None
    found = _order(sample, frames, pattern.projector_size)
    if found is None:
        return None
    order, judgement = found
    gains, share = _light(sample, order)
    causes = list(order.causes)
    figures = {"continuous": judgement.continuous, "inside": judgement.inside}
    if share:
        causes.append(f"every picture holds {100 * share:.0f} % of the one before it: synchronise, or wait longer")
        figures["share_of_picture_before"] = share
    spread = _spread(sample, gains)
    if spread > 1:
        causes.append(
            f"brightness changes from picture to picture, by a factor of up to {spread:.2f}: switch automatic "
            "exposure off"
        )
        figures["gain_spread"] = spread
    if not causes:
        return None
    try:
        spec = FrameSequence(pattern.projector_size, order.frames)
    except InputError:
        return Diagnosis(tuple(causes), None, figures)
    pictures = list(grey) if spread == 1 and not share else without_light_faults(grey, gains, share)
    white, black, color = scene_lights(spec, pictures, pictures)
    arranged = ArrangedSequence(spec, pictures, list(names), white, black, color, not isinstance(pattern, GrayCode))
    try:
        require_complements(pictures, names, pair_starts(spec.frames))
    except CaptureError as error:
        told = not repeated_pictures(sample) and len(causes) > len(order.causes)
        return Diagnosis((*causes, error.problem), None, figures) if told else None  # else it explains nothing
    return Diagnosis(tuple(causes), arranged, figures)


def require_like_pictures(
    frames: Sequence[Frame], projector_size: tuple[int, int], images: Sequence[Image], names: Sequence[str]
) -> None:
    """Raise where one picture stands on its head beside the others, nothing is lit, or a pair is none."""
    grey = grey_pictures(images)
    require_light(grey)

    def fits(turned: int) -> float:
        pictures = [image[::-1, ::-1] if k == turned else image for k, image in enumerate(grey)]
        sample = take_sample(pictures, np.random.default_rng(0))
        if sample is None:
            return 0.0
        totals: list[FloatArray] = [
            (sample.here[k] + sample.here[k + 1]) / sample.contrast for k in pair_starts(frames)
        ]
        worst = max((float(np.mean(np.abs(total - np.median(total)))) for total in totals), default=0.0)
        own = judge(sample, frames, projector_size)  # codes beyond the projector say something of its size
        return own.continuous * (own.one_way > FOLDED) - worst

    sample = take_sample(grey, np.random.default_rng(0))
    repeated = sample is not None and bool(repeated_pictures(sample))  # the first bit twice is half its inverse's turn
    scores = {k: fits(k) for k, frame in enumerate(frames) if frame.code == "gray" and not repeated}
    best = max(scores, key=lambda k: scores[k], default=-1)
    if best >= 0 and scores[best] > CLEAR_SCORE and 1 - scores[best] < LEFT * (1 - fits(-1)):
        raise CaptureError(CAPTURE, f"{names[best]} stands on its head beside the others: take the capture again")
    require_complements(grey, names, pair_starts(frames))


def looks_like(images: Sequence[Image], projector_size: tuple[int, int] = (1024, 768)) -> str:
    """What a folder of pictures seems to be, and what to try."""
    sines = show_sines(images)
    count = f"{len(images)} pictures"
    if sines is None:
        return count
    what = "sinusoidal: phase shift?" if sines else "bright or dark: Gray code?"
    made = "`retrue pattern sequence --layout ...` makes one"
    if not sines and (fitting := fitting_layouts(images, projector_size)):
        return f"{count}, {what}; they fit the layout {' or '.join(fitting)}; {made}"
    having = [name for name in LAYOUTS if _made(name, projector_size, len(images), "phase" if sines else "gray")]
    tried = f"; a pattern of the layout {' or '.join(having)} has as many" if having else ""
    return f"{count}, {what}{tried}; {made}"


def found_instead(spec: FrameSequence, images: Sequence[Image], names: Sequence[str]) -> str:
    """What is there in place of the pictures of `spec`, whose number is another.

    Where they show the same code, and no other layout fits them, pictures are missing or too many: which are too many,
    where what they show tells.
    """
    count = f"{len(images)} pictures"
    codes = {frame.code for frame in spec.frames} & {"gray", "phase"}
    sines = show_sines(images)
    alike = sines is None or ("phase" if sines else "gray") in codes
    if not alike or fitting_layouts(images, spec.projector_size):
        return looks_like(images, spec.projector_size)
    sample = take_sample(grey_pictures(images), np.random.default_rng(0)) if len(images) > spec.picture_count else None
    repeated = [] if sample is None else repeated_pictures(sample)
    if repeated:
        return f"{count}: {names[repeated[0]]} shows the same as {names[repeated[0] - 1]} before it"
    return count


def fitting_layouts(images: Sequence[Image], projector_size: tuple[int, int]) -> list[str]:
    """Names of layouts of bits by which the pictures decode to codes that go on from pixel to pixel; of equals, all."""
    sample = take_sample(grey_pictures(images), np.random.default_rng(0)) if images else None
    if sample is None:
        return []
    judged = {
        name: max((own for spec in specs if (own := _fit(sample, spec)) is not None), default=0.0)
        for name in LAYOUTS
        if (specs := _made(name, projector_size, len(images), "gray"))
    }
    best = max(judged.values(), default=0.0)
    return [name for name, score in judged.items() if score > CLEAR_SCORE and score > best - LEAST_GAIN]


def _fit(sample: Sample, spec: FrameSequence) -> float | None:
    """How well; None where too little changes to tell."""
    found = judge(sample, spec.frames, spec.projector_size)
    return found.score if found.changes >= FEWEST_CHANGES else None


def show_sines(images: Sequence[Image]) -> bool | None:
    """Whether a sequence shows sines, and not bits; None where its pictures are too few, small, dark or bright to tell.

    Of the pixels that no picture shows at the end of its scale, where a sine looks like a bit, those of most contrast,
    since noise puts bits between dark and bright; in most pictures, since blur does so to the finest stripes; between
    what is dark and bright in that picture, which the exposure may have changed. A pixel's own darkest and brightest
    picture tell nothing, nor does a picture that shows one of them almost everywhere.
    """
    grey = grey_pictures(images)
    sample = take_sample(grey, np.random.default_rng(0)) if len(images) > 2 else None
    if sample is None:
        return None
    seen = sample.here[:, ~(sample.here >= FULL * np.iinfo(grey[0].dtype).max).any(axis=0)]
    if seen.shape[1] < LEAST_TOLD * sample.here.shape[1]:
        return None
    contrast = np.ptp(seen, axis=0)
    seen = seen[:, contrast >= np.percentile(contrast, 75)]
    scaled = (seen - seen.min(axis=0)) / np.maximum(np.ptp(seen, axis=0), 1e-6)
    dark, bright = np.percentile(scaled, DARK_AND_BRIGHT, axis=1)
    told = bright - dark > LEAST_RANGE
    if not told.any():
        return None
    scaled = (scaled[told] - dark[told, None]) / (bright - dark)[told, None]
    between = np.mean((scaled > MIDDLE[0]) & (scaled < MIDDLE[1]), axis=1)
    return float(np.median(between)) * len(images) / (len(images) - 2) > SINUSOIDAL


def overexposed(images: Sequence[Image]) -> float:
    """Share of the lit pixels that some picture shows at the end of its scale; 0 where there is nothing to tell."""
    if len({image.shape[:2] for image in images}) != 1 or len({image.dtype for image in images}) != 1:
        return 0.0
    grey = grey_pictures(images)
    sample = take_sample(grey, np.random.default_rng(0))
    if sample is None:
        return 0.0
    return float(np.mean((sample.here >= FULL * np.iinfo(grey[0].dtype).max).any(axis=0)))


def shows_another_code(pattern: GrayCode | FrameSequence, images: Sequence[Image]) -> bool:
    """Whether the pictures show sines where the pattern has bits, or bits where it has sines.

    False of a sequence of another number of pictures: `found_instead` has told what they are.
    """
    frames = frames_of(pattern, len(images))
    if frames is None:
        return isinstance(pattern, GrayCode) and show_sines(images) is True
    codes = {frame.code for frame in frames} & {"gray", "phase"}
    return any(
        show_sines([image for image, frame in zip(images, frames, strict=True) if frame.code not in codes - {code}])
        is (code == "gray")
        for code in codes
    )


def _made(layout: str, size: tuple[int, int], count: int, code: Code) -> list[FrameSequence]:
    """A layout's sequence, of both axes or one, where it has so many pictures and shows that code."""
    made: list[FrameSequence] = []
    for axes in (None, *((axis,) for axis in AXES)):
        try:
            made.append(layout_sequence(layout, size, axes))
        except InputError:  # too fine for so small a projector
            continue
    return [own for own in made if own.picture_count == count and any(f.code == code for f in own.frames)]


def _order(
    sample: Sample, frames: Sequence[Frame], projector_size: tuple[int, int]
) -> tuple[Hypothesis, Judgement] | None:
    """The order that fits clearly best; the expected one where it fits as well.

    Pictures of unlike brightness, or a share of the picture before, may hide their bits, so that another order fits
    better: where none leaves nothing to ask they are judged again without that share, and without their gains, as told
    by that order and by none. The view counts by which some order fits best.
    """
    asked = list(hypotheses(frames, doubled=doubled_light(sample, frames)))
    judged, fits = list[tuple[Hypothesis, Judgement]](), -1.0
    as_they_are: list[float] = []
    for view, alike in _views(sample, frames):
        seen = [(own, judge(view, own.frames, projector_size)) for own in asked]
        as_they_are = as_they_are or [found.dark for _, found in seen]
        if not alike:  # only that white outshines black is told, and not by gains that make it so
            seen = [
                (own, replace(found, dark=float(dark > ALIKE_LIGHTS)))
                for (own, found), dark in zip(seen, as_they_are, strict=True)
            ]
        best_of_view = max((_plausible(pair) for pair in seen), default=0.0) - SURPRISE * (view is not sample)
        if best_of_view > fits:
            judged, fits = seen, best_of_view
        if fits > EVIDENT_SCORE:
            break
    expected = judged[0]
    best = max(judged, key=_plausible)
    if not best[1].score > expected[1].score + LEAST_GAIN:
        best = expected
    if best[1].changes < FEWEST_CHANGES or not best[1].score > LEAST_SCORE:
        return None
    return best


def _views(sample: Sample, frames: Sequence[Frame]) -> Iterator[tuple[Sample, bool]]:
    """Without faults of light; and whether the pictures are taken to be alike in brightness."""
    yield sample, True
    if share := fit_share(sample, frames):
        yield sample.corrected(np.ones(len(sample.here)), share), True
    yield sample.corrected(fit_gains(sample, frames), 0.0), False
    yield sample.corrected(unordered_gains(sample.here), 0.0), False


def _plausible(judged: tuple[Hypothesis, Judgement]) -> float:
    """How well an order fits, less what its causes, and what it leaves unexplained, must earn; 0 where too little
    changes to tell."""
    order, found = judged
    unexpected = len(order.causes) + sum(frame.code == "ignore" for frame in order.frames) / 2
    return found.score - SURPRISE * unexpected if found.changes >= FEWEST_CHANGES else 0.0


def _light(sample: Sample, order: Hypothesis) -> tuple[FloatArray, float]:
    """Gains of the pictures, and the share of the one before; ones and 0 where they explain nothing."""
    ones = np.ones(len(sample.here))
    misfit = unlike(sample, order.frames)
    if not misfit > MISFIT:
        return ones, 0.0
    share = fit_share(sample, order.frames)
    gains = fit_gains(sample, order.frames)
    both = fit_gains(sample.corrected(ones, share), order.frames) if share else ones
    tried = [(ones, share), (gains, 0.0), (gains, fit_share(sample.corrected(gains, 0.0), order.frames)), (both, share)]
    left = [unlike(sample.corrected(*own), order.frames) for own in tried]
    best = next(index for index in range(len(tried)) if left[index] <= AS_GOOD * min(left))
    if not left[best] < BETTER * misfit:
        return ones, 0.0
    gains, share = tried[best]
    spread = _spread(sample, gains)
    return gains if spread > LEAST_SPREAD else ones, share if share > LEAST_SHARE else 0.0


def _spread(sample: Sample, gains: FloatArray) -> float:
    """Largest over smallest gain, of the pictures that show light: of a black one it is anything."""
    level = np.percentile(sample.here / sample.contrast, BRIGHT, axis=1)
    own = gains[level > DARK * np.median(level)]
    return float(own.max() / own.min())


def without_light_faults(grey: Sequence[Image], gains: FloatArray, share: float) -> list[Image]:
    """The pictures over their gains, less the share of the one before, 16 bit."""
    full = float(np.iinfo(grey[0].dtype).max) * HEADROOM / float(gains.min())
    scale = np.float32(np.iinfo(np.uint16).max / full)
    made: list[Image] = []
    before = None
    for picture, gain in zip(grey, gains, strict=True):
        own = picture.astype(np.float32) * np.float32(scale / gain)
        if share and before is not None:
            own = (own - np.float32(share) * before) / np.float32(1 - share)
        before = own
        made.append(np.clip(np.rint(own), 0, np.iinfo(np.uint16).max).astype(np.uint16))
    return made
