"""Surfaces that a patch can lie on, in the camera frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.arrays import FloatArray
from retrue.geometry.sphere import sphere_through
from retrue.geometry.transform import skew
from retrue.values import ByValue

Kind = Literal["plane", "sphere", "b-spline"]


class Surface(Protocol):
    """A surface that camera rays meet once, with parameters (u, v) on it."""

    @property
    def kind(self) -> Kind: ...

    def distances(self, points: FloatArray) -> FloatArray:
        """Signed distance (N,) of points (N, 3), positive on the camera's side."""
        ...

    def parameters(self, rays: FloatArray) -> FloatArray:
        """(u, v) (N, 2) where rays (N, 2), X / Z and Y / Z, meet the surface; NaN where they do not."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class PlaneSurface(ByValue):
    """normal . X = distance; (u, v) are lengths along two axes from the point nearest to the camera.

    Attributes
    ----------
    normal : (3,) unit vector, towards the camera, so that the distance is negative.
    distance : in the cloud's unit.
    """

    normal: FloatArray
    distance: float

    @property
    def kind(self) -> Kind:
        return "plane"

    @property
    def origin(self) -> FloatArray:
        """(3,) where u = v = 0."""
        return self.normal * self.distance

    @property
    def axes(self) -> tuple[FloatArray, FloatArray]:
        """Unit vectors of u and of v; u, v, normal are right-handed."""
        sideways = np.eye(3)[np.argmin(np.abs(self.normal))]
        u = np.cross(sideways, self.normal)
        u /= np.linalg.norm(u)
        return u, np.cross(self.normal, u)

    def distances(self, points: FloatArray) -> FloatArray:
        return points @ self.normal - self.distance

    def parameters(self, rays: FloatArray) -> FloatArray:
        directions = np.column_stack([rays, np.ones(len(rays))])
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = self.distance / (directions @ self.normal)
        depth = np.where(depth > 0, depth, np.nan)
        return (directions * depth[:, None] - self.origin) @ np.column_stack(self.axes)


@dataclass(frozen=True, slots=True, eq=False)
class SphereSurface(ByValue):
    """|X - centre| = radius, seen from outside or from inside; (u, v) are longitude and latitude in radians.

    The x axis of the sphere points away from what the camera sees of it, so that u is about pi there, and v about 0:
    far from the seam and from the poles.

    Attributes
    ----------
    centre : (3,) in the cloud's unit.
    radius : positive.
    hollow : whether the camera sees the inside.
    """

    centre: FloatArray
    radius: float
    hollow: bool = False

    @property
    def kind(self) -> Kind:
        return "sphere"

    @property
    def axes(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Unit vectors: x, y and the one through the poles, right-handed."""
        x = self.centre / np.linalg.norm(self.centre) * (-1.0 if self.hollow else 1.0)
        pole = np.array([0.0, 1.0, 0.0]) - x[1] * x
        if not np.linalg.norm(pole) > 1e-3:
            pole = np.array([1.0, 0.0, 0.0]) - x[0] * x
        pole = pole / np.linalg.norm(pole)
        return x, skew(pole) @ x, pole

    def distances(self, points: FloatArray) -> FloatArray:
        outwards = np.linalg.norm(points - self.centre, axis=1) - self.radius
        return -outwards if self.hollow else outwards

    def parameters(self, rays: FloatArray) -> FloatArray:
        directions = np.column_stack([rays, np.ones(len(rays))])
        a = (directions**2).sum(axis=1)
        b = directions @ self.centre
        c = float(self.centre @ self.centre) - self.radius**2
        with np.errstate(invalid="ignore"):
            root = np.sqrt(b * b - a * c)
        depth = (b + root if self.hollow else b - root) / a
        x, y, z = ((directions * depth[:, None] - self.centre) @ np.column_stack(self.axes)).T
        return np.column_stack([np.arctan2(y, x) % (2 * np.pi), np.arcsin(np.clip(z / self.radius, -1, 1))])


def fit_plane(points: FloatArray) -> PlaneSurface | None:
    """Least squares of the distances of points (N, 3); None where they are on a line.

    >>> plane = fit_plane(np.array([[0, 0, 2.0], [1, 0, 2.0], [0, 1, 2.0], [1, 1, 2.0]]))
    >>> plane.normal.round(9).tolist(), round(plane.distance, 9)
    ([0.0, 0.0, -1.0], -2.0)
    """
    if len(points) < 3:
        return None
    middle = points.mean(axis=0)
    values, vectors = np.linalg.eigh((points - middle).T @ (points - middle))
    if not values[1] > 1e-12 * values[2]:
        return None
    normal = vectors[:, 0] * (-1.0 if vectors[:, 0] @ middle > 0 else 1.0) + 0.0
    return PlaneSurface(normal, float(normal @ middle))


def fit_sphere(points: FloatArray, rounds: int = 10) -> SphereSurface | None:
    """Least squares of the distances of points (N, 3); None where they are flat.

    >>> angles = np.linspace(0, 2, 9)
    >>> ring = np.column_stack([np.cos(angles), np.sin(angles), 0.2 * angles**2])
    >>> ball = fit_sphere(3 * ring / np.linalg.norm(ring, axis=1)[:, None] + [0, 0, 50])
    >>> ball.centre.round(6).tolist(), round(ball.radius, 6)
    ([0.0, 0.0, 50.0], 3.0)
    """
    try:
        fitted = sphere_through(points, rounds=rounds)
    except DegenerateError:
        return None
    inwards = points.mean(axis=0) - fitted.centre
    return SphereSurface(fitted.centre, fitted.radius, hollow=bool(inwards @ points.mean(axis=0) > 0))
