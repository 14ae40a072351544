"""A rig's scale from something in its view whose size is known: two points, a ball, or the two balls of a bar."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from retrue.errors import DegenerateError, InputError, require_kind
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray, finite_array
from retrue.geometry.robust import MAD_TO_SIGMA
from retrue.geometry.sphere import sphere_through
from retrue.ranges import require_number
from retrue.reconstruction.cloud import Cloud, require_cloud
from retrue.rig import Rig, require_rig
from retrue.rig_evidence import rescaled

FARTHEST_PX = 30.0  # that a click may lie from the next point
NEAREST = 12  # points about a click that tell where it lies
SEED = 40  # points about a click that a ball is first fitted to
FEWEST = 30  # points on a ball
WITHIN = 5.0  # sigmas from a ball that its points lie
ROUNDS = 30
LEAST_KNOWN = 0.05  # one sigma of a ball's radius, relative
LEAST_CAP = 0.12
"""Of the radius: depth of the part of a ball that is seen; of less, centre and radius are hardly told apart."""


@dataclass(frozen=True, slots=True)
class Scale:
    """What to multiply all lengths with.

    Attributes
    ----------
    factor : true length over the one that the cloud shows.
    sigma : one standard deviation of it, relative.
    measured, true : the length as the cloud shows it, and as it is, in the rig's unit.
    how : what was measured, for people.
    """

    factor: float
    sigma: float
    measured: float
    true: float
    how: str


def scale_from_points(
    cloud: Cloud, first_px: ArrayLike, second_px: ArrayLike, length: float, sigma: float = 0
) -> Scale:
    """From two camera pixels, as clicked, and the distance between what they show.

    Each place is the mean of the points nearest to its click, each weighted by its own sigma, on the click's ray.

    Parameters
    ----------
    first_px, second_px : (2,) (x, y) in the camera's picture.
    length, sigma : of the distance, in the rig's unit.

    Raises
    ------
    InputError : the length is not positive, or both clicks show one place.
    DegenerateError : no point is near a click.
    """
    _require_length(length, sigma)
    ends = [_clicked(cloud, pixel) for pixel in (first_px, second_px)]
    (a, near), (b, far) = ends
    if near[0] == far[0]:
        raise InputError("scale: expected two places, found one point nearest to both clicks")
    apart = a - b
    measured = float(np.linalg.norm(apart))
    if not measured > 0:
        raise InputError("scale: expected two places, found both clicks on one")
    variance = 0.0
    if cloud.uncertainty is not None:
        u = apart / measured
        own = [float(u @ cloud.select(rows).covariance("own").mean(axis=0) @ u) / len(rows) for rows in (near, far)]
        known = cloud.uncertainty  # all that they share but the scale, which is measured here
        known = replace(known, rig=scaled_rig(known.rig, Scale(1.0, 0.0, 1.0, 1.0, "")))
        shifts = [known.shifts(cloud.points[rows]).mean(axis=0) for rows in (near, far)]
        variance = sum(own) + float(np.sum((u @ (shifts[0] - shifts[1])) ** 2))
    return _scale(measured, length, np.sqrt(variance), sigma, "two points that were clicked")


def scale_from_ball(cloud: Cloud, click_px: ArrayLike, diameter: float, sigma: float = 0) -> Scale:
    """From a ball of that diameter, clicked anywhere on it; its sigma holds the points' own errors only.

    Raises
    ------
    InputError : the diameter is not positive.
    DegenerateError : what is there is no ball, or too little of one is seen.
    """
    _require_length(diameter, sigma)
    ball = find_ball(cloud, click_px)
    return _scale(2 * ball.radius, diameter, 2 * ball.radius_sigma, sigma, f"a ball, {ball.points} points")


def scale_from_ball_bar(
    cloud: Cloud, first_px: ArrayLike, second_px: ArrayLike, distance: float, sigma: float = 0
) -> Scale:
    """From two balls, each clicked anywhere on it, and the distance of their centres.

    Raises
    ------
    InputError, DegenerateError : as `scale_from_ball`.
    """
    _require_length(distance, sigma)
    first, second = find_ball(cloud, first_px), find_ball(cloud, second_px)
    apart = first.centre - second.centre
    measured = float(np.linalg.norm(apart))
    if not measured > max(first.radius, second.radius):
        raise InputError("scale: expected clicks on two balls, found both on one")
    u = apart / measured
    variance = float(u @ (first.centre_covariance + second.centre_covariance) @ u)
    return _scale(measured, distance, np.sqrt(variance), sigma, f"two balls, {first.points} and {second.points} points")


def scaled_rig(rig: Rig, scale: Scale) -> Rig:
    """The rig with its t as long as the scale says; its evidence tells how well that is known.

    >>> from retrue import Camera, RigidTransform
    >>> camera = Camera((640, 480), [[500, 0, 320], [0, 500, 240], [0, 0, 1]])
    >>> rig = Rig(camera, camera, RigidTransform(np.eye(3), [-100.0, 0, 0]))
    >>> longer = scaled_rig(rig, Scale(1.25, 0.002, 80.0, 100.0, "a ball, 900 points"))
    >>> longer.projector_from_camera.t.tolist(), longer.evidence["scale_sigma"]
    ([-125.0, 0.0, 0.0], 0.002)
    """
    require_rig(rig)
    require_kind(scale, Scale, "scale", "retrue.scale_from_points makes one")
    return rescaled(rig, scale.factor, scale.how, scale.sigma)


@dataclass(frozen=True, slots=True, eq=False)
class Ball:
    """A ball in a cloud: least squares of distances, weighted by each point's own sigma."""

    centre: FloatArray
    radius: float
    centre_covariance: FloatArray
    radius_sigma: float
    points: int


def find_ball(cloud: Cloud, click_px: ArrayLike) -> Ball:
    """The ball that a clicked camera pixel lies on.

    A sphere through the points about the click grows to all points that lie on it, again and again.
    """
    order = _by_distance(cloud, click_px)
    members = order[:SEED]
    sigma = _sigmas(cloud)
    count = 0
    for _ in range(ROUNDS):
        ball = sphere_through(cloud.points[members], rounds=0)
        off = np.abs(np.linalg.norm(cloud.points - ball.centre, axis=1) - ball.radius)
        usual = sigma if cloud.sigma is not None else MAD_TO_SIGMA * float(np.median(off[members]))
        reach = np.linalg.norm(cloud.camera_px - cloud.camera_px[order[0]], axis=1)
        allowed = 1.3 * float(reach[members].max())
        members = np.flatnonzero((off <= WITHIN * usual) & (reach <= allowed))
        if len(members) < FEWEST:
            raise DegenerateError(f"ball: expected {FEWEST} points on one where it was clicked, found {len(members)}")
        if len(members) == count:
            break
        count = len(members)
    return _adjusted(cloud.points[members], sigma[members])


def _adjusted(X: FloatArray, sigma: FloatArray) -> Ball:
    fitted = sphere_through(X, sigma)
    J, off = fitted.design / sigma[:, None], fitted.residuals / sigma
    covariance = cast(FloatArray, np.linalg.pinv(J.T @ J)) * max(1.0, float(off @ off) / max(len(X) - 4, 1))
    outwards = fitted.design[:, :3]
    facing = outwards @ (outwards.mean(axis=0) / np.linalg.norm(outwards.mean(axis=0)))
    radius_sigma = float(np.sqrt(covariance[3, 3]))
    if not (radius_sigma <= LEAST_KNOWN * fitted.radius and 1 - np.quantile(facing, 0.02) > LEAST_CAP):
        raise DegenerateError("ball: expected one where it was clicked, found a surface that is nearly flat there")
    return Ball(fitted.centre, fitted.radius, covariance[:3, :3], radius_sigma, len(X))


def _sigmas(cloud: Cloud) -> FloatArray:
    """(N,) own sigma of each point; where unknown all weigh alike."""
    if cloud.sigma is None:
        return np.full(len(cloud), 1e-6 * float(np.median(cloud.points[:, 2])))
    known: BoolArray = np.isfinite(cloud.sigma) & (cloud.sigma > 0)
    usual = float(np.median(cloud.sigma[known])) if known.any() else 1.0
    return np.where(known, np.nan_to_num(cloud.sigma), usual)


def _clicked(cloud: Cloud, pixel: ArrayLike) -> tuple[FloatArray, IntArray]:
    """(3,) the place, and the rows that it is the mean of."""
    rows = _by_distance(cloud, pixel)[:NEAREST]
    rows = rows[np.abs(cloud.points[rows, 2] - cloud.points[rows[0], 2]) <= 0.02 * cloud.points[rows[0], 2]]
    weight = _sigmas(cloud)[rows] ** -2.0
    rays = cloud.camera_px[rows] - finite_array(pixel, (2,), "pixel")
    place: FloatArray = weight @ cloud.points[rows] / weight.sum()
    ray: FloatArray = weight @ rays / weight.sum()
    if len(rows) < 6:
        return place, rows
    # Centred, what points on one line do not tell of the slope across it is none.
    root = np.sqrt(weight)[:, None]
    inverse = cast("FloatArray", np.linalg.pinv((rays - ray) * root, 1e-6))
    slope: FloatArray = inverse @ ((cloud.points[rows] - place) * root)
    return place - ray @ slope, rows


def _by_distance(cloud: Cloud, pixel: ArrayLike) -> IntArray:
    """Rows of the points, those nearest to a camera pixel first."""
    require_cloud(cloud)
    away = np.linalg.norm(cloud.camera_px - finite_array(pixel, (2,), "pixel"), axis=1)
    known = np.flatnonzero(np.isfinite(away))
    if not len(known):
        raise DegenerateError("scale: expected a cloud that knows where the camera sees its points, found none")
    order = known[np.argsort(away[known], kind="stable")]
    if not away[order[0]] <= FARTHEST_PX:
        raise DegenerateError(f"scale: no point near that pixel, the next is {away[order[0]]:.0f} px away")
    return order


def _require_length(length: float, sigma: float) -> None:
    require_number(length, "scale: length", 0, above=True)
    require_number(sigma, "scale: sigma", 0)
    if not sigma < length:
        raise InputError(f"scale: expected a sigma from 0 to the length, found {sigma:g}")


def _scale(measured: float, true: float, sigma: float, stated: float, how: str) -> Scale:
    relative = float(np.hypot(sigma / measured, stated / true))
    return Scale(true / measured, relative, measured, true, how)
