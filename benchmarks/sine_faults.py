"""Random combinations of what goes wrong with sines: read, or the right cause named, and never a wrong point?

Scenes and camera are those of `sequence_faults`, counted as there; the sines have 3 to 5 shifts, a period and a cue of
one. Shifts of both axes backwards are a projector on its head, which no picture tells apart: right is to say so.

    python benchmarks/sine_faults.py [COUNT] [SEED]
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from sequence_faults import SIZE, render, report, seen_places, surface, wrong_points

import retrue
from retrue.patterns.sequence import Frame, FrameSequence

WORDS = {
    "late": ("late",),
    "ghost": ("of the one before",),
    "gain": ("brightness changes",),
    "rows first": ("row pictures come before",),
    "cue first": ("coarse sines come before",),
    "backwards": ("shifts",),
    "cue backwards": ("shifts",),
    "mirrored": ("mirrored",),
    "repeated": ("show the same",),
    "missing": ("expected",),
    "wrong periods": ("periods",),
    "wrong steps": ("expected",),
}
ALONE = ("late", "repeated", "missing", "wrong periods", "wrong steps")


def one(seed: int) -> tuple[set[str], str, int, str]:
    """The faults of one capture, its outcome, how many correspondences are wrong, and what was said."""
    rng = np.random.default_rng(seed)
    if rng.random() < 0.5:
        faults = {str(rng.choice(ALONE))}
    else:
        free = [name for name in WORDS if name not in ALONE]
        faults = set(rng.choice(free, int(rng.integers(1, 3)), replace=False).tolist())
    if {"mirrored", "backwards"} <= faults or {"mirrored", "rows first"} <= faults:
        faults.discard("mirrored")  # together they are a device on its side, or on its head: nothing to find
    if {"cue backwards", "backwards"} <= faults:
        faults.discard("backwards")  # only the fine sines' shifts
    steps, periods = int(rng.integers(3, 6)), int(rng.choice([6, 8, 10]))
    spec = FrameSequence(SIZE, tuple(f for axis in (0, 1) for f in sines(axis, periods, steps)))
    count, more = periods + 2 * ("wrong periods" in faults), steps + ("wrong steps" in faults)
    shown = [sines(axis, count, more) for axis in (0, 1)]
    turned = [
        [
            Frame(
                "phase",
                f.axis,
                period_px=f.period_px,
                shift=-f.shift
                if "backwards" in faults or ("cue backwards" in faults and f.period_px == SIZE[axis])
                else f.shift,
            )
            for f in (sorted(own, key=lambda f: -f.period_px) if "cue first" in faults else own)
        ]
        for axis, own in enumerate(shown)
    ]
    frames = tuple(f for own in (turned[::-1] if "rows first" in faults else turned) for f in own)
    light = [picture / 255 for picture in FrameSequence(SIZE, frames).render()]
    if "mirrored" in faults:
        light = [picture[:, ::-1] for picture in light]
    where = surface(rng)
    taken = render(light, where, rng)
    if "late" in faults:
        late = int(rng.integers(1, 4))
        taken = [np.zeros_like(taken[0]) + 0.02] * late + taken[:-late]
    if "ghost" in faults:
        share = rng.uniform(0.15, 0.35)
        taken = [taken[0], *((1 - share) * now + share * before for before, now in pairwise(taken))]
    gains = rng.uniform(0.6, 1.6, len(taken)) if "gain" in faults else np.ones(len(taken))
    pictures = []
    for picture, gain in zip(taken, gains, strict=True):
        seen = 150 * gain * picture
        noisy = seen + rng.normal(0, np.sqrt(0.5 + 0.01 * np.abs(seen)))
        pictures.append(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
    index = int(rng.integers(1, len(pictures) - 1))
    if "repeated" in faults:
        pictures[index] = pictures[index - 1]
    if "missing" in faults:
        del pictures[index]
    try:
        points = retrue.decode(spec, pictures)
    except retrue.CaptureError as error:
        said = str(error)
        named = any(word in said for fault in faults for word in WORDS[fault])
        return faults, "named" if named else "other cause", 0, said
    places = seen_places(points, where, faults)
    wrong = wrong_points(points, places)
    said = "; ".join(points.card.advice)
    told = all(any(word in said for word in WORDS[fault]) for fault in faults & {"mirrored", "backwards", "rows first"})
    if "backwards" in faults and "on its head" in said:
        wrong = wrong_points(points, np.array(SIZE) - places)
        return faults, "named" if wrong <= 1e-2 * len(points) else "read wrong", wrong, said
    if wrong <= 1e-3 * len(points):
        return faults, "read" if told else "read, not told", wrong, said
    warned = any(word in said for fault in faults for word in WORDS[fault])
    return faults, "read wrong, cause told" if warned else "read wrong", wrong, said


def sines(axis: int, periods: int, steps: int) -> list[Frame]:
    """So many periods, and one, over the projector."""
    name = ("column", "row")[axis]
    return [
        Frame("phase", name, period_px=SIZE[axis] / count, shift=k / steps)
        for count in (periods, 1)
        for k in range(steps)
    ]


if __name__ == "__main__":
    report(one)
