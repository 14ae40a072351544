"""Lenses with terms that OpenCV's model lacks, fitted by the terms that it has, and how far the fit is off.

A foreign lens is a map of undistorted rays (X / Z, Y / Z) to distorted ones, before K. The fit is least squares over
the whole picture, in pixels, of focal lengths, principal point and the coefficients of a `Camera`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from warnings import warn

import numpy as np

from retrue.errors import FileError, InputError, RetrueWarning
from retrue.geometry.arrays import FloatArray
from retrue.geometry.camera import Camera

Size = tuple[int, int]
Distort = Callable[[FloatArray], FloatArray]
LARGEST_ERROR_PX = 1.0
"""Beyond it a fit is no rig: a pixel is many times what a pose is known to."""
GRID = (25, 19)
DENSE_GRID = (49, 37)
FAR_PX = 1e6
SMALL_PX = 1e-3
STEP = 1e-6  # of a ray, for the derivative of a foreign lens


def fitted_camera(
    path: Path, device: str, size: Size, K: FloatArray, distort: Distort, model: str, *, thin_prism: bool = False
) -> Camera:
    """`fit_lens` of a device in a file: warns of how far it is off. Raises `FileError` where no fit will do."""
    name = f"{device}: " if device else ""
    try:
        camera, error = fit_lens(size, K, distort, model, thin_prism=thin_prism)
    except InputError as problem:
        raise FileError(path, f"{name}{problem}") from problem
    message = f"{path}: {name}a lens with terms that OpenCV's model lacks ({model}), fitted to within {error:.2g} px"
    warn(message, RetrueWarning, stacklevel=2)
    return camera


def fit_lens(
    size: Size, K: FloatArray, distort: Distort, model: str, *, thin_prism: bool = False
) -> tuple[Camera, float]:
    """The `Camera` nearest to pixel = K distort(ray), and the largest distance in pixels between the two.

    Raises `InputError` where none is within a pixel of it.

    >>> K = np.array([[400.0, 0, 320], [0, 400, 240], [0, 0, 1]])
    >>> camera, error = fit_lens((640, 480), K, equidistant([0.0, 0, 0, 0]), "equidistant")
    >>> error < 0.01, camera.project([[1.0, 0, 1]]).round(1).tolist()  # 45 degrees: 400 pi / 4 from the middle
    (True, [[634.2, 240.0]])
    """
    from scipy.optimize import least_squares  # pyright: ignore[reportUnknownVariableType]

    linear = Camera(size, K)  # which refuses a hostile size or focal length before the work
    pixels = _picture(size, GRID)
    rays = _undistorted(distort, linear.normalise(pixels))
    if not np.isfinite(rays).all():
        raise InputError(
            f"the lens ({model}) folds inside its own picture, or sees parts of it at 90 degrees or more from its "
            "axis: no model of OpenCV's holds it; undistort the pictures with the tool that made the file, give their K"
        )
    scale = _scales(rays, max(size), 12 if thin_prism else 8)

    def camera_of(parameters: FloatArray) -> Camera:
        fx, fy, cx, cy = (parameters * scale)[:4]
        return Camera(size, np.array([[fx, K[0, 1], cx], [0, fy, cy], [0, 0, 1]]), (parameters * scale)[4:])

    def residuals(parameters: FloatArray) -> FloatArray:
        try:
            error = camera_of(parameters).pixels_from_rays(rays) - pixels
        except InputError:  # a focal length below zero
            error = np.full(pixels.shape, FAR_PX)
        error = np.clip(np.nan_to_num(error, nan=FAR_PX), -FAR_PX, FAR_PX)
        return np.append(error.ravel(), SMALL_PX * parameters[4:])  # which holds what the picture does not tell

    starts = [first / scale for first in _first_guesses(linear, distort, rays, pixels, len(scale))]
    fits: list[Any] = [
        least_squares(residuals, first, method="lm", max_nfev=800, xtol=1e-11, ftol=1e-11) for first in starts
    ]
    found = min(fits, key=lambda fit: float(fit.cost))
    camera = camera_of(np.asarray(found.x, dtype=np.float64))
    pixels = _picture(size, DENSE_GRID)
    there = camera.pixels_from_rays(_undistorted(distort, linear.normalise(pixels)))
    error = float(np.linalg.norm(there - pixels, axis=1).max())
    if not error <= LARGEST_ERROR_PX:
        raise InputError(
            f"the lens ({model}) has terms that OpenCV's model lacks, and the nearest of its lenses is {error:.3g} px "
            "off: undistort the pictures with the tool that made the file, and give their K"
        )
    return camera, error


def _scales(rays: FloatArray, side: int, coefficients: int) -> FloatArray:
    """What each of fx, fy, cx, cy, k1, k2, p1, p2, k3, ... is measured in, so that 1 is much of any."""
    farthest = float((rays**2).sum(axis=1).max())  # r^2
    k1, k2, k3, tangential = farthest, farthest**2, farthest**3, farthest**0.5
    prism = [tangential, farthest * tangential]
    unit = [k1, k2, tangential, tangential, k3, k1, k2, k3, *prism, *prism]
    return np.concatenate([np.full(4, float(side)), 1 / np.array(unit[:coefficients])])


def _first_guesses(
    linear: Camera, distort: Distort, rays: FloatArray, pixels: FloatArray, parameters: int
) -> Iterator[FloatArray]:
    """fx, fy, cx, cy as at the middle, and k by linear least squares of x_d (1 + k4 r^2 ...) = x (1 + k1 r^2 ...).

    All six; then the first three alone.
    """
    middle = np.zeros((1, 2))
    J, shift = _jacobian(distort, middle)[0], distort(middle)[0]
    fx, fy = linear.K[0, 0] * J[0, 0], linear.K[1, 1] * J[1, 1]
    cx, cy = linear.K[:2, :2] @ shift + linear.K[:2, 2]
    distorted = (pixels - [cx, cy]) / [fx, fy]
    powers = (rays**2).sum(axis=1)[:, None] ** np.array([1, 2, 3])
    terms = np.concatenate([np.hstack([powers * rays[:, [axis]], -powers * distorted[:, [axis]]]) for axis in (0, 1)])
    weight = 1 / (1 + np.tile(powers[:, [2]], (2, 1)))
    right = ((distorted - rays).T.reshape(-1, 1) * weight).ravel()
    for count in (6, 3):
        found = np.linalg.lstsq((terms * weight)[:, :count], right, rcond=1e-10)[0]
        k = np.append(found, np.zeros(6 - count))
        yield np.concatenate([[fx, fy, cx, cy, k[0], k[1], 0, 0, k[2], *k[3:]], np.zeros(parameters - 12)])


def radial_tangential(radial: list[float], t1: float = 0.0, t2: float = 0.0) -> Distort:
    """1 + k1 r^2 + k2 r^4 + ..., as many terms as there are, and Brown's tangential ones (BoofCV, Kalibr's omni)."""

    def distort(rays: FloatArray) -> FloatArray:
        x, y = rays.T
        r2 = x * x + y * y
        factor = 1 + sum((k * r2 ** (power + 1) for power, k in enumerate(radial)), np.zeros_like(r2))
        return np.stack(
            [
                x * factor + 2 * t1 * x * y + t2 * (r2 + 2 * x * x),
                y * factor + t1 * (r2 + 2 * y * y) + 2 * t2 * x * y,
            ],
            axis=-1,
        )

    return distort


def equidistant(k: list[float]) -> Distort:
    """theta (1 + k1 theta^2 + ...): OpenCV's fisheye, Kalibr's equidistant, Kannala and Brandt 2006."""

    def distort(rays: FloatArray) -> FloatArray:
        r = np.linalg.norm(rays, axis=-1)
        theta = np.arctan(r)
        bent = theta * (1 + sum((c * theta ** (2 * power + 2) for power, c in enumerate(k)), np.zeros_like(theta)))
        return rays * _ratio(bent, r)[:, None]

    return distort


def field_of_view(w: float) -> Distort:
    """atan(2 r tan(w / 2)) / w: Devernay and Faugeras 2001."""

    def distort(rays: FloatArray) -> FloatArray:
        r = np.linalg.norm(rays, axis=-1)
        return rays * _ratio(np.arctan(2 * r * np.tan(w / 2)) / w, r, 2 * np.tan(w / 2) / w)[:, None]

    return distort


def unified(xi: float, after: Distort) -> Distort:
    """By a sphere whose centre is xi from the pinhole (Mei and Rives 2007), then the other lens."""
    return lambda rays: after(rays / (1 + xi * _slant(rays)))


def extended_unified(alpha: float, beta: float) -> Distort:
    """Khomutenko, Garcia, Martinet 2016."""
    return lambda rays: rays / (alpha * _slant(rays, beta) + 1 - alpha)


def double_sphere(xi: float, alpha: float) -> Distort:
    """Usenko, Demmel, Cremers 2018."""

    def distort(rays: FloatArray) -> FloatArray:
        forward = xi * _slant(rays) + 1
        second = np.sqrt((rays**2).sum(axis=-1, keepdims=True) + forward**2)
        return rays / (alpha * second + (1 - alpha) * forward)

    return distort


def tilted(coefficients: FloatArray) -> Distort:
    """OpenCV's fourteen coefficients: twelve, then the tilt of the sensor by two angles."""
    (tau_x, tau_y), bare = coefficients[12:], Camera((2, 2), np.eye(3), coefficients[:12])
    about_x = np.array([[1, 0, 0], [0, np.cos(tau_x), np.sin(tau_x)], [0, -np.sin(tau_x), np.cos(tau_x)]])
    about_y = np.array([[np.cos(tau_y), 0, -np.sin(tau_y)], [0, 1, 0], [np.sin(tau_y), 0, np.cos(tau_y)]])
    R = about_y @ about_x
    tilt = np.array([[R[2, 2], 0, -R[0, 2]], [0, R[2, 2], -R[1, 2]], [0, 0, 1]]) @ R

    def distort(rays: FloatArray) -> FloatArray:
        mapped = np.column_stack([bare.distort(rays), np.ones(len(rays))]) @ tilt.T
        return mapped[:, :2] / mapped[:, 2:]

    return distort


def _slant(rays: FloatArray, beta: float = 1.0) -> FloatArray:
    """Length of (x, y, 1), squares of x and y times beta; (N, 1)."""
    return np.sqrt(1 + beta * (rays**2).sum(axis=-1, keepdims=True))


def _ratio(bent: FloatArray, r: FloatArray, middle: float = 1.0) -> FloatArray:
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(r > 1e-9, bent / r, middle)


def _picture(size: Size, grid: tuple[int, int]) -> FloatArray:
    """Pixels (N, 2) all over the picture, its edges too."""
    x, y = np.meshgrid(*(np.linspace(-0.5, side - 0.5, count) for side, count in zip(size, grid, strict=True)))
    return np.stack([x.ravel(), y.ravel()], axis=-1)


def _undistorted(distort: Distort, distorted: FloatArray) -> FloatArray:
    """Rays (N, 2) that the lens maps there, by Newton; NaN where it maps none, or folded before."""
    rays = distorted.copy()
    with np.errstate(all="ignore"):
        for _ in range(60):
            error = distort(rays) - distorted
            J = _jacobian(distort, rays)
            determinant = J[:, 0, 0] * J[:, 1, 1] - J[:, 0, 1] * J[:, 1, 0]
            step = np.stack(
                [
                    (J[:, 1, 1] * error[:, 0] - J[:, 0, 1] * error[:, 1]) / determinant,
                    (J[:, 0, 0] * error[:, 1] - J[:, 1, 0] * error[:, 0]) / determinant,
                ],
                axis=-1,
            )
            rays = rays - step
            if not (np.abs(step) > 1e-12 * (1 + np.abs(rays))).any():
                break
        J = _jacobian(distort, rays)
        sound = (np.abs(distort(rays) - distorted).max(axis=1) < 1e-9) & (np.linalg.norm(rays, axis=1) < 50)
        sound &= (J[:, 0, 0] > 0) & (J[:, 1, 1] > 0) & (J[:, 0, 0] * J[:, 1, 1] > J[:, 0, 1] * J[:, 1, 0])
    return np.where(sound[:, None], rays, np.nan)


def _jacobian(distort: Distort, rays: FloatArray) -> FloatArray:
    """d distorted / d ray (N, 2, 2)."""
    columns = [(distort(rays + step) - distort(rays - step)) / (2 * STEP) for step in np.eye(2) * STEP]
    return np.stack(columns, axis=-1)
