"""An acceptance test after VDI/VDE 2634 part 2: what a rig measures on an artefact that is known better than it can."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from retrue.acceptance.artefact import Artefact
from retrue.acceptance.fits import Element, fit_plane, fit_sphere
from retrue.acceptance.options import AcceptOptions
from retrue.acceptance.search import dense_distance, find_balls, find_plane
from retrue.answers import Reason
from retrue.errors import InputError, require_kind, require_kinds, require_names
from retrue.geometry.arrays import FloatArray, IntArray
from retrue.reconstruction.cloud import Cloud
from retrue.shown import ShortRepr, Shown, counted, figures, figures_beside
from retrue.values import ByValue

COVERAGE_FACTOR = 2.0
Quantity = Literal["form", "size", "spacing", "flatness"]
Decision = Literal["passed", "failed", "undecided", "measured"]
SYMBOLS: dict[Quantity, str] = {"form": "PF", "size": "PS", "spacing": "SD", "flatness": "F"}
SMALLEST_BALL, SHORTEST_BAR, SMALLEST_PLANE = 0.02, 0.3, 0.5
"""Of the measuring volume's diagonal, as the guideline is quoted."""
LEAST_SURE = 0.1  # expanded uncertainty of a diameter, of the diameter
SIDEWAYS = 0.2  # noise across a ray, of that along it, where only this is known: about the baseline over the distance
NEAR_LENGTH = 0.2  # of a bar's length: what two balls may be off to be its own


@dataclass(frozen=True, slots=True)
class Value:
    """One reported value.

    Attributes
    ----------
    quantity : "form" (PF), "size" (PS), "spacing" (SD) or "flatness" (F).
    part : which ball, where there are two; else empty.
    value : in the unit of the test; of size and spacing measured less calibrated.
    expanded : its uncertainty, k = 2: of the artefact's calibration and of the points' noise.
    limit : the largest that is accepted, either way; None: only measured.
    """

    quantity: Quantity
    part: str
    value: float
    expanded: float
    limit: float | None

    @property
    def decision(self) -> Decision:
        """Source: ISO 14253-1: passed, or failed, only where the uncertainty leaves no doubt.

        >>> [Value("size", "", value, 2.0, 10.0).decision for value in (-7.0, 9.0, 13.0)]
        ['passed', 'undecided', 'failed']
        """
        if self.limit is None:
            return "measured"
        if abs(self.value) + self.expanded <= self.limit:
            return "passed"
        return "failed" if abs(self.value) - self.expanded > self.limit else "undecided"


@dataclass(frozen=True, slots=True, eq=False)
class Position(ByValue):
    """What was measured in one capture.

    Attributes
    ----------
    name : of the capture.
    values : what is reported.
    centre : (3,) middle of the artefact in the camera frame.
    camera_px, residuals : (N, 2) and (N,) where the camera sees each point of the artefact, and its distance from the
        fitted element, positive on the camera's side.
    cause : why nothing was reported; None where something was.
    """

    name: str
    values: tuple[Value, ...]
    centre: FloatArray
    camera_px: FloatArray
    residuals: FloatArray
    cause: Reason | None = None


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Acceptance(ByValue, ShortRepr):
    """The answer.

    Attributes
    ----------
    verdict : "passed", "failed", "undecided" (a value's uncertainty straddles its limit, or a position is missing),
        "measured" (no limits given), or "refused".
    artefact : in `unit`. positions : one for each capture. options : with the limits.
    cause : why it did not pass, for programs; None where it did, or was only measured.
    reason : a sentence.
    """

    verdict: Literal["passed", "failed", "undecided", "measured", "refused"]
    artefact: Artefact
    positions: tuple[Position, ...]
    options: AcceptOptions
    unit: str
    cause: Reason | None
    reason: str

    def worst(self) -> dict[Quantity, Value]:
        """Of each quantity the largest value, either way, over all positions and balls."""
        found: dict[Quantity, Value] = {}
        for value in (value for position in self.positions for value in position.values):
            if value.quantity not in found or abs(value.value) > abs(found[value.quantity].value):
                found[value.quantity] = value
        return found

    def _shown(self) -> Shown:
        rows = {
            f"{SYMBOLS[name]}, {name}": (
                f"{figures_beside(value.value, value.expanded)} +- {figures(value.expanded)} {self.unit}"
            )
            for name, value in self.worst().items()
        }
        return f"{self.verdict}, {counted(len(self.positions), 'position')}: {self.reason}", rows


@dataclass(frozen=True, slots=True)
class ArtefactNotFound(Reason):
    """Nothing of its shape and size is in the cloud.

    Attributes
    ----------
    points : that a ball would have, as far apart as they are; None where these are enough to find one by.
    """

    artefact: str
    points: int | None = None

    def __str__(self) -> str:
        if self.points is not None:
            few = f"only some {self.points} points would lie on a ball, as far apart as they are"
            return f"found no {self.artefact} in the cloud: {few}; take it nearer, or a denser pattern"
        return f"found no {self.artefact} in the cloud: is it in view, dull and white, with no hand before it?"


@dataclass(frozen=True, slots=True)
class FewPoints(Reason):
    """Too few points lie on it."""

    found: int
    fewest: int

    def __str__(self) -> str:
        return f"{self.found} points on the artefact, expected {self.fewest}: take it nearer, or a denser pattern"


@dataclass(frozen=True, slots=True)
class TooSmall(Reason):
    """It tells too little about this measuring volume, or at this noise."""

    what: str
    length: float
    least: float
    unit: str

    def __str__(self) -> str:
        return (
            f"too small an artefact: {self.what} is {figures(self.length, 4)} {self.unit}, "
            f"expected {figures(self.least, 4)} {self.unit} or more"
        )


@dataclass(frozen=True, slots=True)
class BeyondLimit(Reason):
    """Values exceed their limits by more than their uncertainty."""

    count: int

    def __str__(self) -> str:
        return f"{counted(self.count, 'value')} beyond the limit by more than the uncertainty"


@dataclass(frozen=True, slots=True)
class NoDecision(Reason):
    """Some values are so near their limits that their uncertainty leaves them undecided, or positions are missing."""

    straddling: int
    missing: int

    def __str__(self) -> str:
        parts = [f"{counted(self.straddling, 'value')} nearer to the limit than the uncertainty"] * (
            self.straddling > 0
        )
        parts += [f"nothing measured in {counted(self.missing, 'position')}"] * (self.missing > 0)
        return "; ".join(parts)


def accept(
    clouds: Sequence[Cloud], artefact: Artefact, options: AcceptOptions | None = None, *, names: Sequence[str] = ()
) -> Acceptance:
    """Measure an artefact in several positions, and compare with limits.

    PF, the probing error of form, is the range of the points' distances from the Gaussian sphere, PS that of size its
    diameter less the calibrated one; SD is the distance of two balls' centres less the calibrated one; F, flatness,
    is the range of the distances from the Gaussian plane. PF and F leave out three in a thousand points.

    Parameters
    ----------
    clouds : one of each position, with the artefact anywhere in it.
    artefact : `parse_artefact` makes one; its lengths are converted to the clouds' unit.
    names : of the positions; numbers, unless given.

    Raises
    ------
    InputError : no cloud, clouds of several units, or a unit whose length is not known.

    Source: VDI/VDE 2634 part 2 (2012); ISO 14253-1 for the decisions.
    """
    require_kinds(clouds, Cloud, "clouds", "retrue.reconstruct makes them")
    require_kind(artefact, Artefact, "artefact", "retrue.parse_artefact makes one")
    options = AcceptOptions() if options is None else options
    require_kind(options, AcceptOptions, "options")
    if not clouds:
        raise InputError("clouds: expected at least one position, found none")
    units = sorted({cloud.unit for cloud in clouds})
    if len(units) > 1:
        raise InputError(f"clouds: expected one unit of length, found {', '.join(units)}")
    require_names(names, len(clouds))
    names = names or [str(number) for number in range(1, len(clouds) + 1)]
    artefact = artefact.converted(units[0])
    positions = tuple(_position(name, cloud, artefact, options) for name, cloud in zip(names, clouds, strict=True))
    return _judged(positions, artefact, options, units[0])


def _judged(positions: tuple[Position, ...], artefact: Artefact, options: AcceptOptions, unit: str) -> Acceptance:
    values = [value for position in positions for value in position.values]
    decisions = [value.decision for value in values]
    missing = [position for position in positions if position.cause is not None]
    answer = Acceptance("measured", artefact, positions, options, unit, None, "no limits were given")
    if len(missing) == len(positions):
        cause = missing[0].cause
        return replace(answer, verdict="refused", cause=cause, reason=f"{missing[0].name}: {cause}")
    if "failed" in decisions:
        cause = BeyondLimit(decisions.count("failed"))
        return replace(answer, verdict="failed", cause=cause, reason=str(cause))
    if "undecided" in decisions or (missing and set(decisions) != {"measured"}):
        cause = NoDecision(decisions.count("undecided"), len(missing))
        return replace(answer, verdict="undecided", cause=cause, reason=str(cause))
    if "passed" in decisions:
        return replace(answer, verdict="passed", reason=f"{counted(decisions.count('passed'), 'value')} within limits")
    return answer


def _position(name: str, cloud: Cloud, artefact: Artefact, options: AcceptOptions) -> Position:
    cause = _too_small(artefact, options)
    if cause is not None:
        return _refused(name, cause)
    measure = {"sphere": _measured_ball, "spheres": _measured_bar, "plane": _measured_plane}[artefact.kind]
    return measure(name, cloud, artefact, options)


def _refused(name: str, cause: Reason) -> Position:
    return Position(name, (), np.full(3, np.nan), np.empty((0, 2)), np.empty(0), cause)


def _too_small(artefact: Artefact, options: AcceptOptions) -> Reason | None:
    """The proportions that are quoted of the guideline; of a plane they are those of what is found."""
    if options.diagonal is None:
        return None
    for what, length, share in (
        ("the diameter", artefact.diameter, SMALLEST_BALL),
        ("the distance of the balls", artefact.distance, SHORTEST_BAR),
    ):
        if length is not None and not length.value >= share * options.diagonal:
            return TooSmall(what, length.value, share * options.diagonal, artefact.unit)
    return None


def _measured_ball(name: str, cloud: Cloud, artefact: Artefact, options: AcceptOptions) -> Position:
    balls = _balls(cloud, artefact, options)
    if not balls:
        return _refused(name, _not_found(cloud, artefact, options))
    _, rows = balls[0]
    fitted = _fitted_ball(cloud, rows, artefact, options)
    if isinstance(fitted, Reason):
        return _refused(name, fitted)
    values = _ball_values(fitted, artefact, options, "")
    return Position(name, values, fitted.parameters[:3], cloud.camera_px[rows], fitted.residuals)


def _measured_bar(name: str, cloud: Cloud, artefact: Artefact, options: AcceptOptions) -> Position:
    assert artefact.distance is not None
    balls = _balls(cloud, artefact, options)
    pairs = [
        (first, second)
        for number, first in enumerate(balls)
        for second in balls[number + 1 :]
        if abs(np.linalg.norm(first[0] - second[0]) / artefact.distance.value - 1) < NEAR_LENGTH
    ]
    if not pairs:
        return _refused(name, _not_found(cloud, artefact, options))
    pair = sorted(max(pairs, key=lambda pair: len(pair[0][1]) + len(pair[1][1])), key=lambda ball: float(ball[0][0]))
    fitted = [_fitted_ball(cloud, rows, artefact, options) for _, rows in pair]
    elements = [element for element in fitted if isinstance(element, Element)]
    if len(elements) < 2:
        return _refused(name, next(cause for cause in fitted if isinstance(cause, Reason)))
    first, second = elements
    apart = second.parameters[:3] - first.parameters[:3]
    length = float(np.linalg.norm(apart))
    along = apart / length
    variance = float(along @ (first.covariance[:3, :3] + second.covariance[:3, :3]) @ along)
    expanded = float(np.hypot(COVERAGE_FACTOR * np.sqrt(variance), artefact.distance.expanded))
    spacing = Value("spacing", "", length - artefact.distance.value, expanded, options.max_spacing)
    balls_values = [
        value
        for number, element in enumerate(elements, 1)
        for value in _ball_values(element, artefact, options, f"ball {number}")
    ]
    rows = np.concatenate([rows for _, rows in pair])
    residuals = np.concatenate([element.residuals for element in elements])
    centre = (first.parameters[:3] + second.parameters[:3]) / 2
    return Position(name, (spacing, *balls_values), centre, cloud.camera_px[rows], residuals)


def _not_found(cloud: Cloud, artefact: Artefact, options: AcceptOptions) -> ArtefactNotFound:
    assert artefact.diameter is not None
    cap = artefact.diameter.value / 2 * np.sin(np.radians(options.cap_deg))
    points = int(np.pi * (cap / dense_distance(cloud.points)) ** 2)
    return ArtefactNotFound(str(artefact), points if points < options.fewest_points / 2 else None)


def _measured_plane(name: str, cloud: Cloud, artefact: Artefact, options: AcceptOptions) -> Position:
    rows = find_plane(cloud.points)
    if not len(rows):
        return _refused(name, ArtefactNotFound("plane"))
    if not len(rows) >= options.fewest_points:
        return _refused(name, FewPoints(len(rows), options.fewest_points))
    points = cloud.points[rows]
    fitted = fit_plane(points, _noise(cloud, rows), options.outliers_permille / 1000)
    _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    length = float(np.ptp(points @ axes[0]))
    if options.diagonal is not None and not length >= SMALLEST_PLANE * options.diagonal:
        return _refused(name, TooSmall("the plane's length", length, SMALLEST_PLANE * options.diagonal, artefact.unit))
    expanded = COVERAGE_FACTOR * fitted.form_sigma
    value = Value("flatness", "", fitted.form, expanded, options.max_flatness)
    return Position(name, (value,), points.mean(axis=0), cloud.camera_px[rows], fitted.residuals)


def _noise(cloud: Cloud, rows: IntArray) -> FloatArray:
    """(N, 3, 3) covariance of those points' own noise, up to a common factor.

    Of a cloud that only knows each point's sigma along its ray, or not even that: longest there, as the square of the
    distance.
    """
    points = cloud.points[rows]
    if cloud.uncertainty is not None:
        noise = cloud.uncertainty.select(rows).covariance(points, "own")
        if np.isfinite(noise).all() and (np.trace(noise, axis1=1, axis2=2) > 0).all():
            return noise
    distance = np.linalg.norm(points, axis=1)
    sigma = distance**2 if cloud.sigma is None else cloud.sigma[rows]
    if not (np.isfinite(sigma).all() and (sigma > 0).all()):
        sigma = distance**2
    rays = points / distance[:, None]
    return sigma[:, None, None] ** 2 * (rays[:, :, None] * rays[:, None] + SIDEWAYS**2 * np.eye(3))


def _balls(cloud: Cloud, artefact: Artefact, options: AcceptOptions) -> list[tuple[FloatArray, IntArray]]:
    assert artefact.diameter is not None
    return find_balls(cloud.points, artefact.diameter.value / 2, options.cap_deg, lambda rows: _noise(cloud, rows))


def _fitted_ball(cloud: Cloud, rows: IntArray, artefact: Artefact, options: AcceptOptions) -> Element | Reason:
    assert artefact.diameter is not None
    if not len(rows) >= options.fewest_points:
        return FewPoints(len(rows), options.fewest_points)
    element = fit_sphere(cloud.points[rows], _noise(cloud, rows), options.outliers_permille / 1000)
    expanded = 2 * COVERAGE_FACTOR * _radius_sigma(element)
    if not expanded <= LEAST_SURE * artefact.diameter.value:
        return TooSmall("at this noise the diameter", artefact.diameter.value, expanded / LEAST_SURE, artefact.unit)
    return element


def _ball_values(element: Element, artefact: Artefact, options: AcceptOptions, part: str) -> tuple[Value, Value]:
    assert artefact.diameter is not None
    size = 2 * float(element.parameters[3]) - artefact.diameter.value
    expanded = float(np.hypot(2 * COVERAGE_FACTOR * _radius_sigma(element), artefact.diameter.expanded))
    return (
        Value("form", part, element.form, COVERAGE_FACTOR * element.form_sigma, options.max_form),
        Value("size", part, size, expanded, options.max_size),
    )


def _radius_sigma(element: Element) -> float:
    return float(np.sqrt(element.covariance[3, 3]))
