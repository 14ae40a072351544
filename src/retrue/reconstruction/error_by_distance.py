"""How sure a rig is of a point, at any distance: without a capture, from what the rig's own numbers rest on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from retrue.geometry.arrays import FloatArray, finite_array
from retrue.ranges import require_number
from retrue.reconstruction.uncertainty import Uncertainty
from retrue.rig import Rig, require_rig

RAYS = (13, 10)  # across and down the camera's picture
FROM, TO, STEPS = 0.5, 2.0, 7
"""Distances where nobody names any: of the rig's working distance, or of BASELINES."""
BASELINES = 5.0


@dataclass(frozen=True, slots=True)
class DistanceError:
    """One standard deviation of points at one distance, RMS over what both devices see; lengths in the rig's unit.

    Attributes
    ----------
    distance : Z in the camera frame.
    seen : share of the camera's picture that the projector reaches there; 0: all else is NaN.
    own : of each point by itself, along the camera's ray.
    common : of all points together, along the camera's ray.
    along : of both.
    aside : of both across the camera's ray, in the direction where it is largest.
    """

    distance: float
    seen: float
    own: float
    common: float
    along: float
    aside: float


def error_by_distance(
    rig: Rig, distances: Sequence[float] | None = None, noise_px: float = 0.1
) -> tuple[DistanceError, ...]:
    """How sure a point is, at each distance, from the rig's covariances and noise of its pixels.

    Parameters
    ----------
    rig : its evidence tells how well its pose, scale and lenses are known (`unstated` names what it does not tell).
    distances : in its unit; by default from half to twice its working distance, or of five baselines.
    noise_px : one sigma of a projector pixel, per axis.

    Raises
    ------
    InputError : a distance or the noise is not positive, or the evidence holds what is no covariance.

    >>> from retrue import Camera, RigidTransform
    >>> camera = Camera((640, 480), [[500, 0, 320], [0, 500, 240], [0, 0, 1]])
    >>> rig = Rig(camera, camera, RigidTransform(np.eye(3), [-100.0, 0, 0]), evidence={"scale_sigma": 0.001})
    >>> [(round(row.own, 2), round(row.common, 2)) for row in error_by_distance(rig, [500.0, 1000.0])]
    [(0.55, 0.55), (2.22, 1.11)]
    """
    require_rig(rig)
    require_number(noise_px, "noise_px", 0, above=True)
    asked: list[float] = finite_array(() if distances is None else distances, (None,), "distances").tolist()
    for distance in asked:
        require_number(distance, "distances", 0, above=True)
    return tuple(_at(rig, distance, noise_px) for distance in (asked or usual_distances(rig)))


def usual_distances(rig: Rig) -> list[float]:
    """From half to twice the distance that the rig works at."""
    stated = rig.evidence.get("working_distance")
    middle = float(stated) if isinstance(stated, int | float) and stated > 0 else None
    if middle is None:
        middle = BASELINES * float(np.linalg.norm(rig.projector_from_camera.t))
    return np.geomspace(FROM * middle, TO * middle, STEPS).tolist()


def _at(rig: Rig, distance: float, noise_px: float) -> DistanceError:
    across, down = (np.linspace(0, side - 1, count) for side, count in zip(rig.camera.size, RAYS, strict=True))
    rays = rig.camera.unproject(np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2))
    points = np.column_stack([rays, np.ones(len(rays))])[np.isfinite(rays).all(axis=1)] * distance
    lit = rig.projector.sees(rig.projector_from_camera.apply(points))
    seen = points[lit]
    if not len(seen):
        return DistanceError(distance, 0.0, *(float("nan"),) * 4)
    known = Uncertainty(rig, (0, 1), np.zeros(len(seen)), np.full(len(seen), noise_px))
    with np.errstate(over="ignore", invalid="ignore"):
        own, common = known.covariance(seen, "own"), known.covariance(seen, "common")
    if not (np.isfinite(own) & np.isfinite(common)).all():  # so far away that numbers end
        return DistanceError(distance, float(lit.mean()), *(float("nan"),) * 4)
    ray = seen / np.linalg.norm(seen, axis=1, keepdims=True)
    side = np.eye(3) - ray[:, :, None] * ray[:, None]
    widest = np.linalg.eigvalsh(side @ (own + common) @ side)[:, -1]
    along = [float(np.mean(_along(ray, part))) for part in (own, common)]
    return DistanceError(distance, float(lit.mean()), *np.sqrt([*along, sum(along), float(np.mean(widest))]).tolist())


def common_sigma(known: Uncertainty, points: FloatArray) -> float:
    """RMS along the camera's ray of what the rig makes points (N, 3) err by together."""
    ray = points / np.linalg.norm(points, axis=1, keepdims=True)
    return float(np.sqrt(np.mean(_along(ray, known.covariance(points, "common")))))


def _along(rays: FloatArray, covariances: FloatArray) -> FloatArray:
    """(N,) variance along each unit ray (N, 3), of covariances (N, 3, 3)."""
    return np.einsum("ni,nij,nj->n", rays, covariances, rays)
