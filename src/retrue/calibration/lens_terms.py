"""Which distortion terms the data support: each must pay for itself (Bayesian information criterion).

The normal equations of one fit tell both what chi-square would lose by a term that is absent, g' M^-1 g (the score
test), and what it would gain without one that is there, k' C^-1 k (Wald's). A term stays, or comes, if that exceeds
ln(number of observations) a coefficient.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from retrue.calibration.bundle import Adjusted, adjust
from retrue.calibration.jacobians import INTRINSICS, Setup
from retrue.calibration.observations import Group
from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.geometry.camera import Camera

TERMS: tuple[tuple[str, ...], ...] = (("k1",), ("k2",), ("p1", "p2"), ("k3",))
NEEDS = {"k2": "k1", "k3": "k2"}
"""A higher radial power only on top of the lower."""
UNSEEN = {"k1": 0.3, "k2": 0.2, "k3": 0.1, "p1": 1e-3, "p2": 1e-3}
"""How large a coefficient may be in truth that the data do not show: common lenses have no larger ones."""


@dataclass(frozen=True, slots=True)
class LensChoice:
    """What was decided for one device.

    Attributes
    ----------
    kept : names of the coefficients.
    gain : of every term that was weighed, the fall of chi-square that it brings or would bring.
    needed : the fall at which one coefficient pays for itself.
    """

    kept: tuple[str, ...]
    gain: dict[str, float]
    needed: float


def fit_with_lens(setup: Setup, groups: tuple[Group, ...], fixed: tuple[bool, ...], terms: tuple[str, ...]) -> Adjusted:
    """Bundle adjustment with these terms in every device that is not fixed."""
    active = np.zeros(setup.globals, dtype=bool)
    active[18:] = True
    for device in np.flatnonzero(~np.array(fixed)):
        active[9 * device : 9 * device + 4] = True
        active[[9 * device + INTRINSICS.index(term) for term in terms]] = True
    return adjust(setup, groups, active)


def choose_lens(
    fit: Adjusted, groups: tuple[Group, ...], fixed: tuple[bool, ...]
) -> tuple[Adjusted, tuple[LensChoice, ...]]:
    """From that fit, drop and add terms, one at a time, as long as one is worth it."""
    needed = float(np.log(sum(2 * len(group.view) for group in groups)))
    gains: tuple[dict[str, float], ...] = tuple({} for _ in fixed)
    settled: set[int] = set()  # terms that were dropped or that made no lens: they do not come back
    while True:
        moves: list[tuple[float, list[int], bool]] = []
        for columns in _terms(fixed):
            present = bool(fit.active[columns[0]])
            if not _may_change(fit.active, columns, present):
                continue
            gain = _loss(fit, columns) if present else _gain(fit, columns)
            device, first = divmod(columns[0], 9)
            gains[device][INTRINSICS[first]] = gain
            worth = needed * len(columns) - gain if present else gain - needed * len(columns)
            if worth > 0 and columns[0] not in settled:
                moves.append((worth, columns, present))
        if not moves:
            break
        # What is there without need goes first: it may stand in the way of what is needed.
        _, columns, present = max(moves, key=lambda move: (move[2], move[0]))
        active = fit.active.copy()
        active[columns] = not present
        changed = adjust(_pinned(fit.setup, columns) if present else fit.setup, groups, active, scales=fit.scales)
        if present or _is_lens(changed.setup.devices[columns[0] // 9]):
            fit = changed
        if present or fit is not changed:
            settled.add(columns[0])
    fit = replace(fit, covariance=_honest_covariance(fit, fixed))
    choices = tuple(
        LensChoice(tuple(name for i, name in enumerate(INTRINSICS[4:]) if fit.active[9 * device + 4 + i]), gain, needed)
        for device, gain in enumerate(gains)
    )
    return fit, choices


def _honest_covariance(fit: Adjusted, fixed: tuple[bool, ...]) -> FloatArray:
    """Of the free parameters, as wide as the terms that were left out, but may be there, make it."""
    left_out = [c for columns in _terms(fixed) for c in columns if not fit.active[c]]
    if not left_out:
        return fit.covariance
    chosen = [*np.flatnonzero(fit.active).tolist(), *left_out]
    precision = fit.normal[np.ix_(chosen, chosen)].copy()
    for place in range(len(chosen) - len(left_out), len(chosen)):
        precision[place, place] += 1 / UNSEEN[INTRINSICS[chosen[place] % 9]] ** 2
    root = np.sqrt(np.diag(precision))
    free = len(chosen) - len(left_out)
    return (np.linalg.inv(precision / np.outer(root, root)) / np.outer(root, root))[:free, :free]


def _terms(fixed: tuple[bool, ...]) -> list[list[int]]:
    """Columns of each term of the devices that are estimated."""
    devices = [device for device, known in enumerate(fixed) if not known]
    return [[9 * device + INTRINSICS.index(name) for name in names] for device in devices for names in TERMS]


def _may_change(active: BoolArray, columns: list[int], present: bool) -> bool:
    """A higher radial power stands only on the lower one."""
    device, first = divmod(columns[0], 9)
    name = INTRINSICS[first]
    if present:
        return not any(need == name and active[9 * device + INTRINSICS.index(over)] for over, need in NEEDS.items())
    return name not in NEEDS or bool(active[9 * device + INTRINSICS.index(NEEDS[name])])


def _pinned(setup: Setup, columns: list[int]) -> Setup:
    """The same, with those coefficients zero."""
    device = columns[0] // 9
    camera = setup.devices[device]
    distortion = camera.distortion.copy()
    distortion[[column % 9 - 4 for column in columns]] = 0
    devices = list(setup.devices)
    devices[device] = Camera(camera.size, camera.K, distortion)
    return replace(setup, devices=tuple(devices))


def _loss(fit: Adjusted, columns: list[int]) -> float:
    """The rise of chi-square without those columns."""
    place = [int(np.flatnonzero(np.flatnonzero(fit.active) == column)[0]) for column in columns]
    device, first = divmod(columns[0], 9)
    value = fit.setup.devices[device].distortion[first - 4 : first - 4 + len(columns)]
    return float(value @ np.linalg.solve(fit.covariance[np.ix_(place, place)], value))


def _gain(fit: Adjusted, columns: list[int]) -> float:
    """The fall of chi-square that those columns would bring."""
    chosen = np.flatnonzero(fit.active).tolist() + columns
    matrix, vector = fit.normal[np.ix_(chosen, chosen)], fit.gradient[chosen]
    root = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    step = np.linalg.lstsq(matrix / np.outer(root, root), vector / root, rcond=1e-12)[0]
    return float(step @ (vector / root))


def _is_lens(camera: Camera) -> bool:
    """Whether the lens model can be undone all over the picture, corners included."""
    width, height = camera.size
    x, y = np.meshgrid(np.linspace(0, width - 1, 9), np.linspace(0, height - 1, 9))
    return bool(np.isfinite(camera.unproject(np.stack([x, y], axis=-1))).all())
