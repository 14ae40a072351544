"""Random combinations of what goes wrong with a sequence: read, or the right cause named?

Its own renderer, which shares no code with the decoder: a bowed surface with print on it, a projector that blurs, a
camera with noise; then one to three faults. Counted are captures that are read right, refused with the right cause,
refused with another, and wrong correspondences (more than two projector pixels off).

    python benchmarks/sequence_faults.py [COUNT] [SEED]
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Sequence
from itertools import pairwise

import cv2
import numpy as np

import retrue

SIZE, CAMERA = (128, 96), (320, 220)
WORDS = {
    "late": ("late", "shows the same"),
    "ghost": ("of the one before",),
    "gain": ("brightness changes",),
    "rows first": ("row pictures come before",),
    "low first": ("least significant bits come first", "not in order"),
    "inverse first": ("inverses come before", "swapped", "not in order"),
    "exchanged": ("white and black are",),
    "mirrored": ("mirrored",),
    "repeated": ("shows the same", "number of pictures", "expected"),
    "missing": ("missing", "no counterpart", "expected"),
    "wrong size": ("exceed", "step", "size"),
}
ALONE = ("repeated", "missing", "wrong size")


def code_pictures(size: tuple[int, int]) -> list[np.ndarray]:
    """Columns and rows, most significant first, pattern and inverse; white, black."""
    width, height = size
    shown = []
    for axis, side in enumerate((width, height)):
        place = np.arange(side)
        reflected = place ^ (place >> 1)
        for bit in range((side - 1).bit_length() - 1, -1, -1):
            line = ((reflected >> bit) & 1).astype(float)
            picture = np.tile(line, (height, 1)) if axis == 0 else np.tile(line[:, None], (1, width))
            shown += [picture, 1 - picture]
    return [*shown, np.ones((height, width)), np.zeros((height, width))]


def surface(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Projector coordinates (height, width) that each camera pixel sees."""
    x, y = np.meshgrid(np.arange(CAMERA[0], dtype=float), np.arange(CAMERA[1], dtype=float))
    angle, scale = rng.uniform(-0.15, 0.15), rng.uniform(0.36, 0.46)
    a, b = x - CAMERA[0] / 2, y - CAMERA[1] / 2
    bow = rng.uniform(-1, 1, 3) * 2e-4
    u = SIZE[0] / 2 + scale * (np.cos(angle) * a + np.sin(angle) * b) + bow[0] * a * a + bow[1] * a * b
    v = SIZE[1] / 2 + scale * (np.cos(angle) * b - np.sin(angle) * a) + bow[2] * b * b
    return u, v


def render(shown: list[np.ndarray], where: tuple[np.ndarray, np.ndarray], rng: np.random.Generator) -> list[np.ndarray]:
    """Light in each camera pixel, 0 to 1."""
    u, v = (part.astype(np.float32) for part in where)
    print_ = 0.25 + 0.7 * (cv2.GaussianBlur(rng.random(CAMERA[::-1]), (0, 0), 6) > 0.5)
    ambient = rng.uniform(0.01, 0.08)
    blur = rng.uniform(0.25, 0.5)
    lit = []
    for picture in shown:
        large = cv2.resize(picture.astype(np.float32), None, fx=8, fy=8, interpolation=cv2.INTER_NEAREST)
        large = cv2.GaussianBlur(large, (0, 0), 8 * blur)
        seen = cv2.remap(large, 8 * u + 3.5, 8 * v + 3.5, cv2.INTER_LINEAR, borderValue=0.0)
        lit.append(print_ * (ambient + (1 - ambient) * seen))
    return lit


def spoil(light: list[np.ndarray], faults: set[str], rng: np.random.Generator) -> list[np.ndarray]:
    """The pictures in the order and brightness that the faults make of them."""
    columns, rows, ends = light[:14], light[14:28], light[28:]
    if "low first" in faults:
        columns, rows = ([p for k in range(12, -1, -2) for p in axis[k : k + 2]] for axis in (columns, rows))
    if "inverse first" in faults:
        columns, rows = ([p for k in range(0, 14, 2) for p in (axis[k + 1], axis[k])] for axis in (columns, rows))
    if "exchanged" in faults:
        ends = ends[::-1]
    taken = [*rows, *columns, *ends] if "rows first" in faults else [*columns, *rows, *ends]
    if "late" in faults:
        late = int(rng.integers(1, 4))
        taken = [np.zeros_like(light[0]) + 0.02] * late + taken[:-late]
    if "ghost" in faults:
        share = rng.uniform(0.15, 0.35)
        taken = [taken[0], *((1 - share) * now + share * before for before, now in pairwise(taken))]
    exposure = np.full(len(taken), 0.85)
    if "gain" in faults:
        metered = rng.choice(["left", "middle", "all"])
        part = {"left": np.s_[:, :160], "middle": np.s_[70:150, 100:220], "all": np.s_[:, :]}[metered]
        exposure = np.array([np.clip(0.3 / max(p[part].mean(), 1e-3), 0.4, 6) for p in taken])
    pictures = []
    for picture, gain in zip(taken, exposure, strict=True):
        seen = 235 * gain * picture
        noisy = seen + rng.normal(0, np.sqrt(0.5 + 0.01 * np.abs(seen)))
        pictures.append(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
    return pictures


def one(seed: int) -> tuple[set[str], str, int, str]:
    """The faults of one capture, its outcome, how many correspondences are wrong, and what was said."""
    rng = np.random.default_rng(seed)
    if rng.random() < 0.2:
        faults = {str(rng.choice(ALONE))}
    else:
        free = [name for name in WORDS if name not in ALONE]
        faults = set(rng.choice(free, int(rng.integers(1, 4)), replace=False).tolist())
    where = surface(rng)
    size = (SIZE[0] - int(rng.integers(20, 50)), SIZE[1]) if "wrong size" in faults else SIZE
    shown = code_pictures(SIZE)
    if "mirrored" in faults:
        shown = [picture[:, ::-1] for picture in shown]
    pictures = spoil(render(shown, where, rng), faults, rng)
    names = [f"img_{number:02d}.png" for number in range(len(pictures))]
    index = int(rng.integers(1, 27))
    if "repeated" in faults:
        pictures[index] = pictures[index - 1]
    if "missing" in faults:
        del pictures[index], names[index]
    try:
        points = retrue.decode(retrue.GrayCode(size), pictures, names=names)
    except retrue.CaptureError as error:
        said = str(error)
        named = any(word in said for fault in faults for word in WORDS[fault])
        return faults, "named" if named else "other cause", 0, said
    wrong = wrong_points(points, seen_places(points, where, faults))
    said = "; ".join(points.card.advice)
    right = wrong <= 1e-3 * len(points) and ("mirrored" not in faults or "mirrored" in said)
    return faults, "read" if right else "read wrong", wrong, said


def seen_places(points: retrue.Correspondences, where: Sequence[np.ndarray], faults: set[str]) -> np.ndarray:
    """(N, 2) projector pixels that those camera pixels see, of `where`, (height, width) of both axes."""
    x, y = points.camera_px.astype(int).T
    u = SIZE[0] - 1 - where[0] if "mirrored" in faults else where[0]
    return np.stack([u[y, x], where[1][y, x]], axis=1)


def wrong_points(points: retrue.Correspondences, places: np.ndarray) -> int:
    """How many are more than two pixels off."""
    return int(np.count_nonzero(np.abs(points.projector_px - places).max(axis=1) > 2))


def report(one: Callable[[int], tuple[set[str], str, int, str]]) -> None:
    """Of [COUNT] captures from [SEED] on: those neither read nor named, and how many were."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    outcomes: Counter[str] = Counter()
    for seed in range(first, first + count):
        faults, outcome, wrong, said = one(seed)
        outcomes[outcome] += 1
        if outcome not in ("read", "named"):
            print(f"{seed}: {', '.join(sorted(faults))}: {outcome}, {wrong} wrong: {said}")
    good = outcomes["read"] + outcomes["named"]
    print(f"{CAMERA[0]} x {CAMERA[1]}: {good} of {count} read or named: {dict(outcomes)}")


if __name__ == "__main__":
    report(one)
