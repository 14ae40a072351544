"""The kinds of case that are judged, by name and in groups: a scene, what is wrong with it, the rig as handed in."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from . import faults
from .capture import Capture, Noise, capture, heavy_tails, uneven_noise
from .lens import PRIORS, Generator, Lens, Prior
from .light import hostile_paint, plain_paint, shine
from .rig import Rig, moved, random_rig, turn
from .scene import NO_PLANE, RICH, SCENES, Scene, across

ATTEMPTS = 400
FEWEST_POINTS = 60
MOST_SLANT = np.radians(60)

Spoil = Callable[[Generator, Rig, Capture], Capture | None]
Mislead = Callable[[Generator, Rig], tuple[Rig, dict[str, float]]]
PAINTS = {"plain": plain_paint, "hostile": hostile_paint}


@dataclass(frozen=True)
class Case:
    """What `retrue` is asked, and what is right.

    Attributes
    ----------
    truths : the rigs that took the captures; a pose is right that is one of theirs.
    told : the rig as handed in: lenses by a calibration of that `prior`, and the old pose.
    evidence : of the rig handed in.
    facts : what a reader of a failure wants to know.
    """

    truths: tuple[Rig, ...]
    told: Rig
    captures: tuple[Capture, ...]
    prior: Prior
    facts: dict[str, Any]
    evidence: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Kind:
    """How to make a case. `job` is "recalibrate", "verify" or "reconstruct".

    Attributes
    ----------
    scenes : one is drawn.
    span : share of the camera's picture that may be lit, from and to; `least` that must be, and then no surface is
        seen under more than 60 degrees (median).
    old : how far the old pose is off, at most, in degrees; `drift` exactly so, of a rig to be verified.
    captures : how many, of one pose; `poses` 2: of two poses.
    noise : draws that of the matches; None: as of decoders, see `random_noise`.
    """

    scenes: Sequence[str]
    job: str = "recalibrate"
    span: tuple[float, float] = (0.3, 1.0)
    old: float = 10.0
    drift: float | None = None
    captures: int = 1
    poses: int = 1
    mixed: bool = False
    along: bool = False
    noise: Callable[[Generator], Noise] | None = None
    spoil: Spoil | None = None
    mislead: Mislead | None = None
    paint: str = "any"
    stated: bool = False
    fewest: int = FEWEST_POINTS
    least: float = 0.0


def make(rng: Generator, kind: Kind, prior: Prior) -> Case:
    """Draw until the devices see enough in common."""
    for _ in range(ATTEMPTS):
        case = _attempt(rng, kind, prior)
        if case is not None:
            return case
    raise RuntimeError(f"{kind}: no case in {ATTEMPTS} attempts; this is a fault of the bench")


def _attempt(rng: Generator, kind: Kind, prior: Prior) -> Case | None:
    distance = 10 ** rng.uniform(2, 3.5)
    rig = random_rig(rng, distance, along=0.8 if kind.along else None)
    other = moved(rng, rig, rng.uniform(1, 8), rng.uniform(1, 8))
    rigs = [rig, other] if kind.poses == 2 else [rig] * kind.captures
    name = kind.scenes[rng.integers(len(kind.scenes))]
    paint_name = kind.paint if kind.paint in PAINTS else str(rng.choice(list(PAINTS)))
    taken: list[Capture] = []
    scene = _scene(rng, kind, name, rig, distance)
    for one in rigs:
        if taken and not kind.mixed and rng.random() < 0.5:
            scene = _scene(rng, kind, name, one, distance)
        span, noise = rng.uniform(*kind.span), kind.noise(rng) if kind.noise else None
        seen = capture(rng, one, scene, span, noise=noise)
        if seen is None or len(seen) < kind.fewest or seen.span() < kind.least:
            return None
        if kind.least and seen.slant() > MOST_SLANT:
            return None
        seen = shine(rng, one, seen, PAINTS[paint_name](rng))
        spoiled = kind.spoil(rng, one, seen) if kind.spoil else seen
        if spoiled is None or len(spoiled) < kind.fewest:
            return None
        taken.append(spoiled)
    if kind.mixed:
        taken = [faults.interleaved(rng, *taken)]
    facts: dict[str, Any] = {"scene": name, "paint": paint_name, "points": len(taken[0]), "span": taken[0].span()}
    facts |= {"noise": taken[0].noise.sigma, "tails": taken[0].noise.tails, "slow": taken[0].noise.slow}
    facts |= {"uneven": taken[0].noise.uneven}
    facts["baseline"] = float(np.linalg.norm(rig.t) / distance)
    told, off = kind.mislead(rng, rig) if kind.mislead else (rig, {})
    told = replace(told, camera=_drawn(rng, prior, told.camera), projector=_drawn(rng, prior, told.projector))
    told, evidence = _posed(rng, kind, told)
    return Case(_distinct(rigs), told, tuple(taken), prior, facts | off, evidence)


def _scene(rng: Generator, kind: Kind, name: str, rig: Rig, distance: float) -> Scene:
    if kind.along:
        return across(rng, distance, rig.place / np.linalg.norm(rig.place))
    return SCENES[name](rng, distance)


def _distinct(rigs: Sequence[Rig]) -> tuple[Rig, ...]:
    return tuple(rig for k, rig in enumerate(rigs) if all(rig is not other for other in rigs[:k]))


def _drawn(rng: Generator, prior: Prior, lens: Lens) -> Lens:
    while True:
        drawn = prior.draw(rng, lens)
        if drawn.covers_its_picture() or not lens.covers_its_picture():
            return drawn


def _posed(rng: Generator, kind: Kind, told: Rig) -> tuple[Rig, dict[str, Any]]:
    """The pose that is handed in: an old one, or one to be verified with what its calibration left uncertain."""
    keep = bool(rng.random() < 0.5)
    if kind.drift is None:
        return moved(rng, told, rng.uniform(0, kind.old), rng.uniform(0, kind.old), keep), {}
    rotation, translation = np.radians([0.01, 0.02] if kind.stated else [0.02, 0.05])
    told = moved(rng, told, kind.drift, kind.drift)
    R = turn(rng.normal(0, rotation, 3)) @ told.R
    t = told.t + np.linalg.norm(told.t) * rng.normal(0, translation, 2) @ np.linalg.svd(told.t[None])[2][1:]
    covariance = np.diag([rotation**2] * 3 + [translation**2] * 2)
    return replace(told, R=R, t=t), {"covariance": covariance.tolist()} if kind.stated else {}


def _wrong(share: float, clustered: bool = False) -> Spoil:
    return lambda rng, rig, seen: faults.wrong_matches(rng, seen, share, clustered=clustered)


def _any_wrong(rng: Generator, rig: Rig, seen: Capture) -> Capture:
    return faults.wrong_matches(rng, seen, rng.uniform(0, 0.5), clustered=bool(rng.random() < 0.3))


def _mirror(rng: Generator, rig: Rig, seen: Capture) -> Capture | None:
    return faults.mirror(rng, rig, seen, rng.uniform(0.05, 0.4))


def _copy(rng: Generator, rig: Rig, seen: Capture) -> Capture:
    return faults.shifted_copy(rng, seen, rng.uniform(0.05, 0.4))


def _moved_object(rng: Generator, rig: Rig, seen: Capture) -> Capture:
    return faults.moved_object(rng, rig, seen, rng.uniform(0.05, 0.4))


EVERY = tuple(SCENES)
WITH_PLANE = ("wall", *RICH)
TELLING = (*RICH, *NO_PLANE)  # a pose can be told from these alone


def _scenes_alone() -> dict[str, Kind]:
    return {name: Kind((name,)) for name in EVERY}


def _lens_kinds() -> dict[str, Kind]:
    kinds = {}
    for device in ("camera", "projector", "both"):
        mislead = partial(faults.other_focal, device=device)
        for where, scenes in (("wall", ("wall",)), ("rich", RICH), ("no plane", NO_PLANE)):
            kinds[f"focal {device}, {where}"] = Kind(scenes, mislead=mislead)
    kinds["principal point"] = Kind(EVERY, mislead=faults.other_centre)
    kinds["k1"] = Kind(EVERY, mislead=faults.other_k1)
    kinds["cropped"] = Kind(EVERY, spoil=lambda rng, rig, seen: faults.cropped(rng, seen))
    kinds["binned"] = Kind(EVERY, spoil=lambda rng, rig, seen: faults.binned(seen))
    return kinds


def _walls() -> dict[str, Kind]:
    kinds = {}
    for paint in PAINTS:
        for old in (10, 60):
            kinds[f"wall, {paint}, old {old}"] = Kind(("wall",), old=old, paint=paint, least=0.3)
        kinds[f"small wall, {paint}"] = Kind(("wall",), old=60, paint=paint, span=(0.1, 0.3), least=0.1)
    return kinds


COPIES = {
    "mirror": Kind(TELLING, spoil=_mirror),
    "mirror, wall": Kind(("wall",), spoil=_mirror),
    "shifted copy": Kind(TELLING, spoil=_copy),
    "shifted copy, wall": Kind(("wall",), spoil=_copy),
    "moved object": Kind(TELLING, spoil=_moved_object),
}
MATCHES = {
    "wrong 10 %": Kind(WITH_PLANE, spoil=_wrong(0.1)),
    "wrong 30 %": Kind(WITH_PLANE, spoil=_wrong(0.3)),
    "wrong 50 %": Kind(WITH_PLANE, spoil=_wrong(0.5)),
    "wrong 20 %, clustered": Kind(WITH_PLANE, spoil=_wrong(0.2, clustered=True)),
    "wrong 0-50 %, no plane": Kind(NO_PLANE, spoil=_any_wrong),
}
NOISE = {
    "uneven noise, wall": Kind(("wall",), noise=uneven_noise),
    "uneven noise, rich": Kind(RICH, noise=uneven_noise),
    "uneven noise, no plane": Kind(NO_PLANE, noise=uneven_noise),
    "uneven noise, wrong 30 %": Kind(("wall",), noise=uneven_noise, spoil=_wrong(0.3)),
    "heavy tails, wall": Kind(("wall",), noise=heavy_tails),
    "heavy tails, rich": Kind(RICH, noise=heavy_tails),
}
POSES = {
    "three captures": Kind(WITH_PLANE, captures=3),
    "no shared pose": Kind(EVERY, poses=2),
    "interleaved": Kind(EVERY, poses=2, mixed=True),
    "swapped": Kind(EVERY, spoil=lambda rng, rig, seen: faults.swapped(seen)),
    "other pattern": Kind(EVERY, spoil=lambda rng, rig, seen: faults.permuted(rng, seen)),
    "t along normal": Kind(("wall",), along=True),
    "tiny patch": Kind(("wall",), span=(0.03, 0.07), fewest=40),
    "old pose 60": Kind(TELLING, old=60),
}
VERIFY = {
    "holds": Kind(EVERY, "verify", drift=0.0),
    "holds, stated": Kind(EVERY, "verify", drift=0.0, stated=True),
    **{f"drift {d}": Kind(EVERY, "verify", drift=d) for d in (0.1, 0.3, 1.0, 5.0)},
    **{f"drift {d}, stated": Kind(EVERY, "verify", drift=d, stated=True) for d in (0.1, 0.3)},
    "verify, focal": Kind(EVERY, "verify", drift=0.0, mislead=partial(faults.other_focal, device="both")),
    "verify, pattern": Kind(EVERY, "verify", drift=0.0, spoil=lambda rng, rig, seen: faults.permuted(rng, seen)),
}
RECONSTRUCT = {
    "cloud, holds": Kind(EVERY, "reconstruct", drift=0.0),
    "cloud, drift 5": Kind(EVERY, "reconstruct", drift=5.0),
    "cloud, focal": Kind(EVERY, "reconstruct", drift=0.0, mislead=partial(faults.other_focal, device="both")),
    "cloud, pattern": Kind(EVERY, "reconstruct", drift=0.0, spoil=lambda rng, rig, seen: faults.permuted(rng, seen)),
}

GROUPS: dict[str, dict[str, Kind]] = {
    "no-lens-faults": {**_scenes_alone(), **MATCHES, **NOISE, **COPIES, **POSES},
    "lens": _lens_kinds(),
    "bare-walls": _walls(),
    "no-plane": {name: Kind((name,)) for name in NO_PLANE},
    "copies": COPIES,
    "sigma": _scenes_alone(),
    "verify": VERIFY,
    "reconstruct": RECONSTRUCT,
}
KINDS: dict[str, Kind] = {name: kind for group in GROUPS.values() for name, kind in group.items()}
GROUPS["all"] = KINDS


def draw(name: str, seed: int, prior: str = "foreign", old: float | None = None) -> Case:
    """The case of that kind and seed, always the same."""
    kind = KINDS[name] if old is None else replace(KINDS[name], old=old)
    return make(np.random.default_rng([seed, *name.encode()]), kind, PRIORS[prior])
