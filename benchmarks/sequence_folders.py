"""Folders of pictures as people hand them in: read, or the right cause named, and never wrong points?

Beside `sequence_faults`, with which it shares nothing: a ball before a slanted wall, seen and lit by two devices; nine
layouts and ways of naming, cutting, turning and saving the files; then up to two things that go wrong with files.

    python benchmarks/sequence_folders.py [COUNT] [SEED]
"""

from __future__ import annotations

import re
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

import retrue
from retrue.patterns.layouts import layout_sequence

Array = NDArray[Any]
COUNT = r"expected \d+ pictures.*found \d+|is missing|are missing|no counterpart"
SIZES = r"pixels, the others|sizes differ"
SAID = {
    "one cut": SIZES,
    "one turned": SIZES,
    "one resized": SIZES,
    "one on its head": r"NAME",
    "exposures": r"brightness changes",
    "first missing": COUNT,
    "last missing": COUNT,
    "pair missing": COUNT,
    "copied": COUNT + r"|shows? the same|late by 1",  # where its name comes first
    "foreign": COUNT + r"|NAME|" + SIZES,
    "no white": COUNT,
    "low first": r"least significant|not in order",
    "inverses last": r"inverses",
    "rows first": r"row pictures come before",
    "lights moved": r"white and black are at the other end",
    "two": COUNT + r"|twice",
}
ALONE = {"one cut", "one turned", "one resized", "one on its head", "foreign", "two", "pair missing"}


@dataclass(eq=False)
class Shown:
    """What one picture shows: its values by projector pixel, and its role."""

    role: str
    axis: int
    bit: int
    inverse: bool
    line: Array


def gray(axis: int, side: int, bits: list[int], inverses: bool, offset: int = 0) -> list[Shown]:
    number = np.arange(side) + offset
    code = number ^ (number >> 1)
    made: list[Shown] = []
    for bit in bits:
        line = ((code >> bit) & 1).astype(float)
        made.append(Shown("gray", axis, bit, False, line))
        if inverses:
            made.append(Shown("gray", axis, bit, True, 1 - line))
    return made


def sines(axis: int, side: int, periods: int, steps: int) -> list[Shown]:
    turns = np.arange(side) * periods / side
    return [Shown("sine", axis, k, False, 0.5 + 0.5 * np.cos(2 * np.pi * (turns - k / steps))) for k in range(steps)]


def show(layout: str, size: tuple[int, int]) -> list[Shown]:
    """What the tool shows, by its description."""
    bits = [next(b for b in range(1, 20) if 2**b >= side) for side in size]
    lights = [Shown(role, 0, 0, False, np.full(size[0], value)) for role, value in (("white", 1.0), ("black", 0.0))]
    downwards = [list(range(b))[::-1] for b in bits]
    pairs = [s for axis in (0, 1) for s in gray(axis, size[axis], downwards[axis], True)]
    if layout in ("gray code", "opencv"):
        return [*pairs, *lights]
    if layout == "3dunderworld":
        return [*lights, *pairs]
    if layout == "sltk":
        return [s for axis in (0, 1) for s in gray(axis, size[axis], list(range(max(bits)))[::-1], True)]
    if layout == "scan3d-capture":
        few = min(bits)
        return [
            *lights,
            *(
                s
                for axis in (0, 1)
                for s in gray(axis, size[axis], downwards[axis][:few], True, (2 ** bits[axis] - size[axis]) // 2)
            ),
        ]
    if layout == "slstudio-gray":
        return [
            *lights,
            *(s for axis, most in ((0, 10), (1, 6)) for s in gray(axis, size[axis], downwards[axis][:most], False)),
        ]
    if layout == "structuredlight":
        return gray(0, size[0], downwards[0], False)
    periods, steps = (16, 3) if layout == "slstudio-2x3" else (8, 9)
    return [s for axis in (0, 1) for part in ((periods, steps), (1, 3)) for s in sines(axis, size[axis], *part)]


LAYOUTS = (
    "gray code",
    "gray code",
    "opencv",
    "3dunderworld",
    "sltk",
    "scan3d-capture",
    "slstudio-gray",
    "structuredlight",
    "slstudio-2x3",
    "slstudio-nstep",
)


def scene(
    rng: np.random.Generator, camera: tuple[int, int], size: tuple[int, int]
) -> tuple[Array, Array, Array, Array]:
    """Projector x and y, whether lit, and paint, of every camera pixel."""
    focal, throw = 1.2 * camera[0], 1.25 * size[0]
    x, y = np.meshgrid((np.arange(camera[0]) - camera[0] / 2) / focal, (np.arange(camera[1]) - camera[1] / 2) / focal)
    ray = np.stack([x, y, np.ones_like(x)], axis=-1)
    tilt = np.array([*rng.uniform(-0.35, 0.35, 2), 1.0])
    depth = 1.3 / (ray @ tilt)
    ball, radius = np.array([*rng.uniform(-0.12, 0.12, 2), 0.95]), rng.uniform(0.1, 0.18)
    aim, length = ray @ ball, (ray**2).sum(axis=-1)
    under = aim**2 - length * (ball @ ball - radius**2)
    near = np.where(under > 0, (aim - np.sqrt(np.maximum(under, 0))) / length, np.inf)
    paint = np.where((np.floor(7 * x) + np.floor(7 * y)) % 2 > 0, rng.uniform(0.3, 0.8), 0.8)
    paint = np.where(near < depth, 0.9, paint)
    seen = ray * np.minimum(depth, near)[..., None]
    turn = rng.uniform(0.1, 0.25) * rng.choice([-1, 1])
    there = np.array([-1.2 * np.tan(turn), rng.uniform(-0.06, 0.06), 0.0])
    away = seen - there
    side = np.cos(turn) * away[..., 0] - np.sin(turn) * away[..., 2]
    ahead = np.sin(turn) * away[..., 0] + np.cos(turn) * away[..., 2]
    u, v = throw * side / ahead + size[0] / 2, throw * away[..., 1] / ahead + size[1] / 2
    far = (away**2).sum(axis=-1)
    to_ball = away @ (ball - there)
    inside = to_ball**2 - far * ((ball - there) @ (ball - there) - radius**2)
    shadow = (inside > 0) & ((to_ball - np.sqrt(np.maximum(inside, 0))) / far < 0.98) & (near > depth)
    return u, v, ~shadow, paint


def photograph(
    rng: np.random.Generator, places: tuple[Array, Array, Array, Array], shown: list[Shown], size: tuple[int, int]
) -> list[Array]:
    """Light of every picture, 0 to about 1."""
    u, v, lit, paint = places
    blur, room = rng.choice([0.3, 0.7, 1.2]), rng.choice([0.0, 0.05, 0.2])
    pictures: list[Array] = []
    for own in shown:
        line = own.line if own.role != "gray" else own.line.astype(float)
        wide = np.repeat(line, 6)
        reach = np.arange(-24, 25)
        kernel = np.exp(-0.5 * (reach / (6 * blur)) ** 2)
        wide = np.convolve(np.pad(wide, 24, mode="edge"), kernel / kernel.sum(), mode="valid")
        at, other = (u, v) if own.axis == 0 else (v, u)
        sides = (len(line), size[1 - own.axis]) if own.role != "white" and own.role != "black" else size
        inside = lit & (at > -0.5) & (at < sides[0] - 0.5) & (other > -0.5) & (other < sides[1] - 0.5)
        light = np.interp(6 * at + 2.5, np.arange(len(wide)), wide) * inside
        pictures.append(paint * (room + light))
    return pictures


@dataclass(eq=False)
class File:
    name: str
    light: Array
    shown: Shown | None
    gain: float = 1.0
    same_as: str | None = None


NAMES: dict[str, Callable[[int], str]] = {
    "padded": lambda k: f"img_{k:03d}",
    "unpadded": lambda k: f"Frame {k}",
    "camera": lambda k: f"DSC_{4981 + k}",
    "bare": lambda k: f"{k + 1:02d}",
    "clock": lambda k: f"2024-03-01 12.{(7 * k) // 60:02d}.{(7 * k) % 60:02d}",
    "bracketed": lambda k: f"capture({k + 1})",
}
MAKE: dict[str, str] = {"png": "png", "jpg 95": "jpg", "jpg 70": "JPG", "bmp": "bmp", "tif": "tif"}


def spoil(
    files: list[File], fault: str, rng: np.random.Generator, name: Callable[[int], str]
) -> tuple[list[File], str]:
    """The files after one fault, and the name of what was done it to."""
    at = int(rng.integers(1, len(files) - 1))
    own = files[at]
    if fault == "one cut":
        own.light = own.light[:, : int(0.8 * own.light.shape[1])]
    elif fault == "one turned":
        own.light = np.rot90(own.light)
    elif fault == "one resized":
        own.light = cv2.resize(own.light, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    elif fault == "one on its head":
        own.light = own.light[::-1, ::-1]
    elif fault == "exposures":
        for file in files:
            file.gain = rng.uniform(0.55, 1.5)
    elif fault == "first missing":
        del files[0]
    elif fault == "last missing":
        del files[-1]
    elif fault == "pair missing":
        del files[at : at + 2]
    elif fault == "copied":
        more = rng.choice(["{} (1)", "{} copy", "Copy of {}", "{}_2"]).format(own.name)
        files.append(File(more, own.light, None, same_as=own.name))
    elif fault == "foreign":
        texture: Array = cv2.GaussianBlur(rng.random(own.light.shape), (0, 0), 5)
        texture = (texture - texture.min()) / np.ptp(texture)
        if rng.random() < 0.3:
            texture = cv2.resize(texture, None, fx=1.5, fy=1.5)
        what = str(rng.choice(["IMG_0001", "zz_scan", own.name + "b"]))
        files.append(File(what, texture, None))
        return files, what
    elif fault == "no white":
        keep = [
            f
            for f in files
            if f.shown is None or f.shown.role not in (("white",) if rng.random() < 0.5 else ("white", "black"))
        ]
        files = keep
    elif fault in ("low first", "inverses last", "rows first", "lights moved"):
        first_lit = files[0].shown is not None and files[0].shown.role == "white"
        order = sorted(range(len(files)), key=lambda k: _key(files[k].shown, fault, k, first_lit=first_lit))
        lights = [files[k].light for k in order]
        roles = [files[k].shown for k in order]
        for file, light, role in zip(files, lights, roles, strict=True):
            file.light, file.shown = light, role
    elif fault == "two":
        again = [File(f.name, f.light.copy(), f.shown) for f in files]
        if rng.random() < 0.5:
            for f in files:
                f.name = "a_" + f.name
            for f in again:
                f.name = "b_" + f.name
        else:
            for k, f in enumerate(again):
                f.name = name(len(files) + k)
        files = files + again
    return files, own.name


def _key(shown: Shown | None, fault: str, place: int, *, first_lit: bool) -> tuple[int, ...]:
    assert shown is not None
    light = shown.role in ("white", "black")
    if fault == "lights moved":
        return int(light == first_lit), place
    group = (0 if place < 2 else 9) if light else 1
    if fault == "low first":
        return group, shown.axis, shown.bit, int(shown.inverse), place
    if fault == "inverses last":
        return group, int(shown.inverse), place
    return group, -shown.axis, place


def one(seed: int) -> tuple[str, str, int, str]:
    """What was done, its outcome, how many points are wrong, and what was said."""
    rng = np.random.default_rng([seed, 77])
    layout = str(rng.choice(LAYOUTS))
    size = [(256, 192), (320, 200), (240, 320)][rng.integers(3)]
    camera = [(400, 300), (360, 360), (480, 270)][rng.integers(3)]
    shown = show(layout, size)
    possible = [f for f in SAID if _can(f, layout, shown, camera)]
    count = int(rng.choice([0, 1, 1, 1, 2]))
    faults = [str(f) for f in rng.choice(possible, count, replace=False)]
    if len(faults) == 2 and (set(faults) & ALONE or {"first missing", "last missing", "no white"} >= set(faults)):
        faults = faults[:1]
    places = scene(rng, camera, size)
    lights = photograph(rng, places, shown, size)
    if rng.random() < 0.25:
        left, top = (int(rng.uniform(0, 0.25) * side) for side in camera)
        cut = np.s_[top:, left:]
        lights, places = [p[cut] for p in lights], tuple(p[cut] for p in places)
    if rng.random() < 0.25 and "rows first" not in faults:  # together they are a mirrored picture
        turns = int(rng.integers(1, 4))
        lights, places = [np.rot90(p, turns) for p in lights], tuple(np.rot90(p, turns) for p in places)
    zoom = float(rng.choice([1, 1, 1, 0.75, 1.4]))
    if zoom != 1:
        lights = [
            cv2.resize(p, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_AREA if zoom < 1 else cv2.INTER_CUBIC)
            for p in lights
        ]
        places = tuple(cv2.resize(p.astype(np.float64), lights[0].shape[::-1]) for p in places)
    style = str(rng.choice(list(NAMES)))
    files = [File(NAMES[style](k), light, role) for k, (light, role) in enumerate(zip(lights, shown, strict=True))]
    about = ""
    for fault in sorted(
        faults,
        key=lambda f: f in ("first missing", "last missing", "no white", "copied", "two", "pair missing", "foreign"),
    ):
        files, about = spoil(files, fault, rng, NAMES[style])
    renumbered = (
        bool({"first missing", "last missing", "pair missing", "no white"} & set(faults)) and rng.random() < 0.5
    )
    renumbered &= "copied" not in faults  # a copy follows its original
    if renumbered:
        for k, file in enumerate(files):
            file.name = NAMES[style](k)
    make = str(rng.choice(list(MAKE)))
    deep = make in ("png", "tif") and rng.random() < 0.4
    channels = str(
        rng.choice(["grey", "colour", "tinted", "alpha"] if make in ("png", "tif") else ["grey", "colour", "tinted"])
    )
    what = " + ".join(faults) + (" renumbered" if renumbered else "") if faults else "nothing"
    how = f"{layout} {size} {camera} {style} {make} {16 if deep else 8} bit {channels} zoom {zoom}"
    done = f"{how}: {what} [{about}]"
    exposure, noise = rng.choice([0.5, 0.8]), rng.choice([0.5, 1.5, 3.0]) / (4 if layout == "slstudio-2x3" else 1)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "capture"
        folder.mkdir()
        for file in sorted(files, key=lambda f: f.same_as is not None):
            if file.same_as is not None:
                shutil.copy(folder / f"{file.same_as}.{MAKE[make]}", folder / f"{file.name}.{MAKE[make]}")
                continue
            grey: Array = 255 * exposure * file.gain * file.light
            grey = grey + rng.normal(0, noise, grey.shape) + rng.normal(0, 1, grey.shape) * np.sqrt(0.02 * np.abs(grey))
            _save(folder / f"{file.name}.{MAKE[make]}", grey, make, deep, channels)
        pattern = retrue.GrayCode(size) if layout == "gray code" else layout_sequence(layout, size)
        try:
            points = retrue.read_capture(folder, pattern)
        except retrue.RetrueError as error:
            said = str(error).replace(place, "")
            named = any(re.search(SAID[f].replace("NAME", re.escape(about)), said) for f in faults)
            return done, "named" if named else "not named", 0, said
    x, y = points.camera_px.astype(int).T
    off = [np.abs(points.projector_px[:, axis] - places[axis][y, x]) for axis in points.axes]
    wrong = int(np.count_nonzero(np.max(off, axis=0) > 2))
    assert points.card is not None
    said = f"{len(points)} points; {'; '.join(points.card.advice)}"
    return done, "read" if wrong <= 0.02 * len(points) else "read wrong", wrong, said


def _can(fault: str, layout: str, shown: list[Shown], camera: tuple[int, int]) -> bool:
    roles = {own.role for own in shown}
    if fault in ("no white", "lights moved"):
        return "white" in roles
    if fault == "low first":
        return "gray" in roles
    if fault == "inverses last":
        return any(own.inverse for own in shown)
    if fault == "rows first":
        return layout != "structuredlight"
    if fault == "pair missing":
        return len(shown) > 12
    return fault != "one turned" or camera[0] != camera[1]


def _save(path: Path, grey: Array, make: str, deep: bool, channels: str) -> None:
    most, kind = (65535, np.uint16) if deep else (255, np.uint8)
    picture = np.clip(np.rint(grey * (most / 255)), 0, most).astype(kind)
    if channels != "grey":
        tints = (0.7, 1.0, 0.85) if channels == "tinted" else (1.0, 1.0, 1.0)
        planes = [np.clip(np.rint(picture * tint), 0, most).astype(kind) for tint in tints]
        picture = cv2.merge([*planes, np.full_like(picture, most)] if channels == "alpha" else planes)
    quality = [cv2.IMWRITE_JPEG_QUALITY, int(make.split()[1])] if make.startswith("jpg") else []
    cv2.imwrite(str(path), picture, quality)


def main(count: int, first: int) -> None:
    outcomes: Counter[str] = Counter()
    for seed in range(first, first + count):
        done, outcome, wrong, said = one(seed)
        outcomes[outcome] += 1
        print(f"{seed}: {outcome}: {done}: {wrong} wrong: {said}", flush=True)
    good = outcomes["read"] + outcomes["named"]
    print(f"{good} of {count} read or named: {dict(outcomes)}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200, int(sys.argv[2]) if len(sys.argv) > 2 else 0)
