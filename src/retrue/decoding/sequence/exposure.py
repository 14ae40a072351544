"""What each picture's brightness was multiplied by, and the share of the picture before that it holds.

Pattern and inverse of every bit add up to the same; a bit without inverse is as bright as white or as dark as black.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from retrue.decoding.gray.faults import CAPTURE
from retrue.decoding.sequence.hypotheses import Sample, bits_of, corrected, take_sample
from retrue.errors import CaptureError
from retrue.geometry.arrays import FloatArray, Image
from retrue.patterns.sequence import AXES, Frame

SHARES = [0.05 * k for k in range(10)]
GAIN_ROUNDS = 40
MISFIT = 0.05
"""Of the contrast: pattern and inverse of good pictures add up to the same within less."""
BETTER = 0.6
"""Of that misfit is left by a correction that is believed."""
LEAST_GAIN = 0.1
FEWEST_PAIRS = 3
"""Pictures that add up to the same, from which gains are told."""
LIGHTS = ("white", "black")
ROUNDS = 4
GAINS = np.geomspace(0.25, 4.0, 81)
BRIGHT = 85
"""Percentile of a picture's pixels, each over its mean: about half of the pixels are bright."""
FEWEST = 0.05
"""Of the pixels, bright or dark: a picture all of whose pixels are one of them tells no gain."""
LEAST_CONTRAST = 1e-6


def fit_gains(sample: Sample, frames: Sequence[Frame]) -> FloatArray:
    """(pictures,) gain of each picture, by which pattern / gain + inverse / gain is the same for every pair.

    Least squares in turn of the pixels' sums and of the two reciprocal gains of each pair; 1 for pictures in no pair.
    Where hardly any is in a pair, each is as bright as white or as dark as black.
    """
    pairs = _pairs(frames)
    gains = np.ones(len(sample.here))
    if len(pairs) < FEWEST_PAIRS:
        return fit_unpaired_gains(sample.here, frames)
    reciprocal = gains.copy()
    for _ in range(GAIN_ROUNDS):
        sums = np.stack([sample.here[p] * reciprocal[p] + sample.here[q] * reciprocal[q] for p, q in pairs])
        total = _median_of_pictures(sums)
        for p, q in pairs:
            found = np.linalg.lstsq(sample.here[[p, q]].T, total, rcond=None)[0]
            if (found > LEAST_GAIN).all() and (found < 1 / LEAST_GAIN).all():
                reciprocal[[p, q]] = found
        reciprocal /= np.median(reciprocal)
    return 1 / reciprocal


def fit_share(sample: Sample, frames: Sequence[Frame]) -> float:
    """The share of the picture before it in each picture, that makes pattern and inverse add up best."""
    pairs = _pairs(frames)
    if not pairs:
        return 0.0
    misses = [_unlike(corrected(sample.here, np.ones(len(sample.here)), share), pairs) for share in SHARES]
    best = int(np.argmin(misses))
    if not misses[best] < 0.7 * misses[0]:
        return 0.0
    low, high = SHARES[max(best - 1, 0)], SHARES[min(best + 1, len(SHARES) - 1)]
    ones = np.ones(len(sample.here))
    finer = [low + (high - low) * k / 20 for k in range(21)]
    return min(finer, key=lambda share: _unlike(corrected(sample.here, ones, share), pairs))


def unlike(sample: Sample, frames: Sequence[Frame]) -> float:
    """How much pattern and inverse fail to add up to the same, or bits without inverses to white or black, of the
    contrast."""
    pairs = _pairs(frames)
    return _unlike(sample.here, pairs) if len(pairs) >= FEWEST_PAIRS else unpaired_misfit(sample.here, frames)


def _unlike(here: FloatArray, pairs: Sequence[tuple[int, int]]) -> float:
    sums = np.stack([here[p] + here[q] for p, q in pairs])
    contrast = _median_of_pictures(np.stack([np.abs(here[p] - here[q]) for p, q in pairs]))
    spread = np.abs(sums - _median_of_pictures(sums))
    return float(np.mean(np.median(spread / np.maximum(contrast, 1e-6), axis=1)))


def _median_of_pictures(seen: FloatArray) -> FloatArray:
    """(N,) of (pictures, N): sorted, which takes a tenth of the time of NumPy's partition."""
    ordered = np.sort(seen, axis=0)
    return (ordered[(len(seen) - 1) // 2] + ordered[len(seen) // 2]) / 2


def _pairs(frames: Sequence[Frame]) -> list[tuple[int, int]]:
    """Pictures that add up to white and black: patterns and inverses, and white and black themselves."""
    codes = [frame.code for frame in frames]
    found = [
        (pattern, inverse)
        for name in AXES
        for _, pattern, inverse, *_ in bits_of(frames, name)
        if pattern is not None and inverse is not None
    ]
    if "white" in codes and "black" in codes:
        found.append((codes.index("white"), codes.index("black")))
    return found


def require_white_or_black(frames: Sequence[Frame], grey: Sequence[Image]) -> None:
    """Raise where bits without inverses are neither, in most pictures, unless a gain of each is taken out: read as
    they are, they tell other codes."""
    if not unpaired_pictures(frames) or any(f.code == "phase" for f in frames):
        return
    sample = take_sample(grey, np.random.default_rng(0))
    if sample is None or not (misfit := unpaired_misfit(sample.here, frames)) > MISFIT:
        return
    gains = fit_unpaired_gains(sample.here, frames)
    if unpaired_misfit(sample.here / gains[:, None], frames) < BETTER * misfit:
        raise CaptureError(CAPTURE, "brightness changes from picture to picture: switch automatic exposure off")


def unpaired_pictures(frames: Sequence[Frame]) -> list[int]:
    """Where the bits are whose inverse, or pattern, the sequence lacks."""
    shown = [(f.axis, f.bit, f.inverse) if f.code == "gray" else None for f in frames]
    return [k for k, own in enumerate(shown) if own is not None and (own[0], own[1], not own[2]) not in shown]


def fit_unpaired_gains(here: FloatArray, frames: Sequence[Frame]) -> FloatArray:
    """(pictures,) gain of each picture, by which its pixels, of (pictures, N), are nearest to white or black.

    White and black are those of the sequence, else the brightest and darkest of each pixel over the gains; in turn with
    these. 1 of pictures that show other things, or hardly any white, or black.
    """
    gains, shown = np.ones(len(here)), unpaired_pictures(frames)
    if shown and not _has_lights(frames):
        gains[shown] = _levels(here[shown])
    for _ in range(ROUNDS if shown else 0):
        white, black = _lights(here / gains[:, None], frames)
        for k in shown:
            gain, bright = _gain(here[k], white, black)
            gains[k] = gain if FEWEST < bright < 1 - FEWEST else 1.0
        gains[shown] /= 1.0 if _has_lights(frames) else float(np.median(gains[shown]))
    return gains


def unordered_gains(here: FloatArray) -> FloatArray:
    """The same whatever the pictures show, bits, inverses, or white; 1 of those with hardly any white."""
    gains = _levels(here)
    for _ in range(ROUNDS):
        seen = here / gains[:, None]
        black, white = np.percentile(seen, (25, 75), axis=0)
        for k, own in enumerate(here):
            gain, bright = _gain(own, white, black)
            gains[k] = gain if bright > FEWEST else 1.0
        gains /= float(np.median(gains))
    return gains


def _levels(here: FloatArray) -> FloatArray:
    """Gains as the brighter pixels of each picture have them, beside their means."""
    level = np.percentile(here / np.maximum(here.mean(axis=0), 1.0), BRIGHT, axis=1)
    return np.maximum(level / np.median(level), GAINS[0])


def _gain(own: FloatArray, white: FloatArray, black: FloatArray) -> tuple[float, float]:
    """A picture's gain, and the share of its pixels that it makes bright."""
    scale = np.maximum(white - black, LEAST_CONTRAST)
    gain = float(GAINS[int(np.argmin(_near(own / GAINS[:, None], white, black, scale).mean(axis=1)))])
    return gain, float(np.mean(own / gain > (white + black) / 2))


def unpaired_misfit(here: FloatArray, frames: Sequence[Frame]) -> float:
    """How far pixels (pictures, N) are from white and black, of their contrast, in the median of the pictures with the
    wider stripes, since blur keeps the narrow ones from both; 0 where every bit has its inverse."""
    shown = unpaired_pictures(frames)
    if not shown:
        return 0.0
    shown = sorted(shown, key=lambda k: frames[k].bit or 0)[len(shown) // 2 :]
    white, black = _lights(here, frames)
    scale = np.maximum(white - black, LEAST_CONTRAST)
    return float(np.median([_near(here[k], white, black, scale).mean() for k in shown]))


def _has_lights(frames: Sequence[Frame]) -> bool:
    return any(f.code in LIGHTS for f in frames)


def _lights(here: FloatArray, frames: Sequence[Frame]) -> tuple[FloatArray, FloatArray]:
    """White and black of the sequence, else the means of what is bright, and what is dark, of its bits."""
    codes = [f.code for f in frames]
    bits = here[[k for k, code in enumerate(codes) if code == "gray"]]
    bright = bits > (bits.max(axis=0) + bits.min(axis=0)) / 2
    means = [np.sum(bits, axis=0, where=own) / np.maximum(own.sum(axis=0), 1) for own in (bright, ~bright)]
    seen = [here[codes.index(code)] if code in codes else mean for code, mean in zip(LIGHTS, means, strict=True)]
    return seen[0], seen[1]


def _near(seen: FloatArray, white: FloatArray, black: FloatArray, scale: FloatArray) -> FloatArray:
    """Distance to the nearer of both, of the contrast, at most 1."""
    return np.minimum(np.minimum(np.abs(seen - white), np.abs(seen - black)) / scale, 1.0)
