"""Which terms the data support, of the lenses and of the board's bend: each must pay for itself (Bayesian criterion).

The normal equations of one fit tell both what chi-square would lose by a term that is absent, g' M^-1 g (the score
test), and what it would gain without one that is there, k' C^-1 k (Wald's). A term stays, or comes, if that exceeds
ln(number of observations) a coefficient.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from retrue.calibration.bundle import Adjusted, adjust
from retrue.calibration.neighbours import gradient_covariance
from retrue.calibration.observations import CornerObservations, Group
from retrue.calibration.setup import BEND, Setup
from retrue.errors import DegenerateError
from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.geometry.camera import Camera

LENS_TERMS: tuple[tuple[str, ...], ...] = (("k1",), ("k2",), ("p1", "p2"), ("k3",))
NEEDS = {"k2": "k1", "k3": "k2"}
"""A higher radial power only on top of the lower."""
UNSEEN = {"k1": 0.3, "k2": 0.2, "k3": 0.1, "p1": 1e-3, "p2": 1e-3}
"""How large a coefficient may be in truth that the data do not show: common lenses have no larger ones."""
UNSEEN_SAG = 1e-3
"""The same of the board: how far it may be from flat, over its length."""


@dataclass(frozen=True, slots=True)
class Term:
    """Coefficients that come and go together.

    Attributes
    ----------
    names, columns : of the coefficients.
    device : the lens's, or the number of devices for the board.
    needs : the column that must be free, or None.
    unseen : how large one may be that the data do not show.
    """

    names: tuple[str, ...]
    columns: tuple[int, ...]
    device: int
    needs: int | None
    unseen: tuple[float, ...]

    def kept(self, active: BoolArray) -> bool:
        """Whether it is in the fit."""
        return bool(active[self.columns[0]])


@dataclass(frozen=True, slots=True)
class Choice:
    """What was decided for the lens of one device, or for the board.

    Attributes
    ----------
    kept : names of the coefficients.
    gain : of every term that was weighed, the fall of chi-square that it brings or would bring.
    needed : the fall at which one coefficient pays for itself.
    """

    kept: tuple[str, ...]
    gain: dict[str, float]
    needed: float


def fit_with_lens(
    setup: Setup,
    groups: tuple[Group, ...],
    fixed: tuple[bool, ...],
    terms: tuple[str, ...],
    unknown: Sequence[int] = (),
) -> Adjusted:
    """Bundle adjustment with these terms in every device that is not fixed, and a flat board.

    Of the second device's `unknown` coordinates (0, x; 1, y), focal length, principal point and position are held: what
    it sees of the other one does not depend on them, but for the middle of its lens.
    """
    columns = setup.columns
    active = np.zeros(columns.shared, dtype=bool)
    active[columns.pose] = True
    for device in (device for device, known in enumerate(fixed) if not known):
        active[columns.pinhole(device)] = True
        active[[columns.intrinsic(device, term) for term in terms]] = True
    for axis in unknown:
        active[[columns.intrinsic(1, name) for name in (("fx", "cx"), ("fy", "cy"))[axis]]] = False
        active[columns.translation.start + axis] = False
    return adjust(setup, groups, active)


def choose_terms(
    fit: Adjusted, groups: tuple[Group, ...], fixed: tuple[bool, ...]
) -> tuple[Adjusted, tuple[Choice, ...]]:
    """From that fit, drop and add terms as long as one is worth it; a choice a device, and the board's.

    They are dropped one at a time, and added one of every lens and of the board at a time.
    """
    needed = float(np.log(sum(2 * len(group.view) for group in groups)))
    terms = _terms(fit.setup, groups, fixed)
    gains: tuple[dict[str, float], ...] = tuple({} for _ in (*fixed, "board"))
    settled: set[Term] = set()  # terms that were dropped or that made no lens: they do not come back
    while True:
        moves: list[tuple[float, Term]] = []
        for term in terms:
            present, columns = term.kept(fit.active), list(term.columns)
            if not _may_change(fit.active, term, terms):
                continue
            gain = _loss(fit, columns) if present else _gain(fit, columns)
            gains[term.device][term.names[0]] = gain
            worth = needed * len(columns) - gain if present else gain - needed * len(columns)
            if worth > 0 and term not in settled:
                moves.append((worth, term))
        if not moves:
            break
        # What is there without need goes first: it may stand in the way of what is needed.
        idle = [move for move in moves if move[1].kept(fit.active)]
        if idle:
            term = max(idle, key=_worth)[1]
            fit = adjust(_pinned(fit.setup, term), groups, _switched(fit.active, [term]), scales=fit.scales)
            settled.add(term)
            continue
        best = [max(own, key=_worth)[1] for own in _by_device(moves)]
        changed = adjust(fit.setup, groups, _switched(fit.active, best), scales=fit.scales)
        broken = [device for device, camera in enumerate(changed.setup.devices) if not _is_lens(camera)]
        if broken:
            settled.update(term for term in best if term.device in broken)
        else:
            fit = changed
    kept: tuple[list[str], ...] = tuple([] for _ in gains)
    for term in terms:
        kept[term.device].extend(term.names if term.kept(fit.active) else ())
    return fit, tuple(Choice(tuple(names), gain, needed) for names, gain in zip(kept, gains, strict=True))


def with_honest_covariance(fit: Adjusted, groups: tuple[Group, ...], fixed: tuple[bool, ...]) -> Adjusted:
    """The covariance of the free parameters and of the terms that were left out, but may be there.

    C G C + s s^T: C the inverse of the normal matrix with what is known of those terms beforehand, G the covariance of
    the gradient, in which neighbours err alike, and s the step that the fit would take if those terms were free.
    """
    left_out = [term for term in _terms(fit.setup, groups, fixed) if not term.kept(fit.active)]
    free = np.flatnonzero(fit.active)
    chosen = [*free.tolist(), *(column for term in left_out for column in term.columns)]
    unseen = np.array([size for term in left_out for size in term.unseen])
    prior = np.diag([*np.zeros(len(free)), *unseen**-2.0])
    precision = fit.normal[np.ix_(chosen, chosen)] + prior
    root = np.sqrt(np.diag(precision))
    try:
        inverse = np.linalg.inv(precision / np.outer(root, root)) / np.outer(root, root)
    except np.linalg.LinAlgError as error:
        raise DegenerateError("calibration: the views do not determine the unknowns") from error
    covariance = np.zeros_like(fit.covariance)
    step = -inverse @ fit.gradient[chosen]
    scatter = gradient_covariance(fit, groups)[np.ix_(chosen, chosen)] + prior
    covariance[np.ix_(chosen, chosen)] = inverse @ scatter @ inverse + np.outer(step, step)
    return replace(fit, covariance=covariance)


def _terms(setup: Setup, groups: tuple[Group, ...], fixed: tuple[bool, ...]) -> list[Term]:
    """Those of the devices that are estimated, and of the board."""
    terms: list[Term] = []
    for device in (device for device, known in enumerate(fixed) if not known):
        for names in LENS_TERMS:
            needs = setup.columns.intrinsic(device, NEEDS[names[0]]) if names[0] in NEEDS else None
            columns = tuple(setup.columns.intrinsic(device, name) for name in names)
            terms.append(Term(names, columns, device, needs, tuple(UNSEEN[name] for name in names)))
    corners = [group.board_points for group in groups if isinstance(group, CornerObservations)]
    bend = 4 * UNSEEN_SAG / float(np.ptp(np.concatenate(corners), axis=0).max())
    columns = tuple(range(setup.columns.shared)[setup.columns.bend])
    return [*terms, Term(BEND, columns, len(fixed), None, (bend,) * len(BEND))]


def _worth(move: tuple[float, Term]) -> float:
    return move[0]


def _by_device(moves: list[tuple[float, Term]]) -> list[list[tuple[float, Term]]]:
    owners = {term.device for _, term in moves}
    return [[move for move in moves if move[1].device == owner] for owner in sorted(owners)]


def _switched(active: BoolArray, terms: list[Term]) -> BoolArray:
    """With those terms out that were in, and in that were out."""
    switched = active.copy()
    columns = [column for term in terms for column in term.columns]
    switched[columns] = ~switched[columns]
    return switched


def _may_change(active: BoolArray, term: Term, terms: list[Term]) -> bool:
    """A higher radial power stands only on the lower one."""
    if term.kept(active):
        return not any(other.needs == term.columns[0] and other.kept(active) for other in terms)
    return term.needs is None or bool(active[term.needs])


def _values(setup: Setup, columns: list[int]) -> FloatArray:
    values = np.zeros(setup.columns.shared)
    for device, camera in enumerate(setup.devices):
        values[setup.columns.lens(device)] = camera.distortion[:5]
    values[setup.columns.bend] = setup.bend
    return values[columns]


def _pinned(setup: Setup, term: Term) -> Setup:
    """The same, with those coefficients zero."""
    columns = list(term.columns)
    change = np.zeros(setup.columns.shared)
    change[columns] = -_values(setup, columns)
    pinned = setup.moved(change)
    return pinned if pinned is not None else setup


def _loss(fit: Adjusted, columns: list[int]) -> float:
    """The rise of chi-square without those columns."""
    value = _values(fit.setup, columns)
    return float(value @ np.linalg.solve(fit.covariance[np.ix_(columns, columns)], value))


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
