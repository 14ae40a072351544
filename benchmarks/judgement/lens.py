"""A pinhole with a lens before it (k1 k2 p1 p2 k3), as a map of the complex plane q = x + iy.

    bent(q) = q (1 + k1 r + k2 r^2 + k3 r^3 + 2 Re(p* q)) + p r,    r = |q|^2, p = p2 + i p1

Its differential is a dq + b dq*, so that its Jacobian is |a|^2 - |b|^2 and Newton's step has a closed form.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

import retrue

Array = np.ndarray
Generator = np.random.Generator


@dataclass(frozen=True)
class Lens:
    """A camera or a projector.

    Attributes
    ----------
    size : (width, height) in pixels.
    focal, centre : (2,) focal lengths and principal point in pixels.
    bend : k1 k2 p1 p2 k3.
    """

    size: tuple[int, int]
    focal: Array
    centre: Array
    bend: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    def project(self, points: Array) -> Array:
        """Pixels (N, 2) of points (N, 3) in the frame of this device; NaN behind it and beyond the lens's fold."""
        with np.errstate(all="ignore"):
            q = (points[:, 0] + 1j * points[:, 1]) / np.where(points[:, 2] > 0, points[:, 2], np.nan)
            q = np.where(np.abs(q) < self.fold(), q, np.nan)
        return self._pixels(self._bent(q)[0])

    def rays(self, pixels: Array) -> Array:
        """Rays (N, 3) with z = 1 of pixels (N, 2); NaN where the lens lets none through."""
        target = self._plane(pixels)
        q = target.copy()
        if any(self.bend):
            with np.errstate(all="ignore"):
                for _ in range(12):
                    bent, a, b = self._bent(q)
                    miss = target - bent
                    q = q + (a.conj() * miss - b * miss.conj()) / (np.abs(a) ** 2 - np.abs(b) ** 2)
                    if not (np.abs(miss) > 1e-12).any():
                        break
                bent = self._bent(q)[0]
                q = np.where((np.abs(bent - target) < 1e-10) & (np.abs(q) < self.fold()), q, np.nan)
        return np.stack([q.real, q.imag, np.ones(len(q))], axis=1)

    def pixel_area(self, rays: Array) -> Array:
        """(N,) area of a pixel in the plane z = 1."""
        _, a, b = self._bent(rays[:, 0] + 1j * rays[:, 1])
        return 1 / (self.focal.prod() * (np.abs(a) ** 2 - np.abs(b) ** 2))

    def inside(self, pixels: Array) -> Array:
        """(N,) which pixels lie in the picture."""
        with np.errstate(invalid="ignore"):
            return ((pixels > -0.5) & (pixels < np.array(self.size) - 0.5)).all(axis=1)

    def fold(self) -> float:
        """The radius up to which the lens is one-to-one, with a little to spare."""
        k1, k2, _, _, k3 = self.bend
        roots = np.roots([7 * k3, 5 * k2, 3 * k1, 1.0]) if k1 or k2 or k3 else np.empty(0)
        real = roots[(np.abs(roots.imag) < 1e-9) & (roots.real > 0)].real
        return 0.93 * float(np.sqrt(real.min())) if len(real) else np.inf

    def covers_its_picture(self) -> bool:
        """Whether every pixel of the picture has a ray."""
        w, h = self.size
        edge = np.array([[x, y] for x in (0, w / 2, w - 1) for y in (0, h / 2, h - 1)], dtype=float)
        return bool(np.isfinite(self.rays(edge)).all())

    def public(self) -> retrue.Camera:
        """The same for `retrue`."""
        (fx, fy), (cx, cy) = self.focal, self.centre
        return retrue.Camera(self.size, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], self.bend)

    def other(self, zoom: float = 1.0, shift: Array | tuple[float, float] = (0.0, 0.0), k1: float = 0.0) -> Lens:
        """With another focal length, principal point and k1."""
        bend = (self.bend[0] + k1, *self.bend[1:])
        return replace(self, focal=self.focal * zoom, centre=self.centre + np.asarray(shift), bend=bend)

    def _plane(self, pixels: Array) -> Array:
        scaled = (pixels - self.centre) / self.focal
        return scaled[:, 0] + 1j * scaled[:, 1]

    def _pixels(self, q: Array) -> Array:
        return np.stack([q.real, q.imag], axis=1) * self.focal + self.centre

    def _bent(self, q: Array) -> tuple[Array, Array, Array]:
        """bent(q), and a and b of its differential."""
        k1, k2, p1, p2, k3 = self.bend
        p, r = p2 + 1j * p1, np.abs(q) ** 2
        gain = 1 + r * (k1 + r * (k2 + r * k3)) + 2 * (p.conjugate() * q).real
        slope = k1 + r * (2 * k2 + r * 3 * k3)
        a = gain + q * (slope * q.conj() + p.conjugate()) + p * q.conj()
        b = q * (slope * q + p) + p * q
        return q * gain + p * r, a, b


@dataclass(frozen=True)
class Prior:
    """How well a calibration knows a lens, as it states itself: one standard deviation each."""

    focal: float = 2e-3
    centre_px: float = 1.0
    k1: float = 1e-3

    def draw(self, rng: Generator, lens: Lens) -> Lens:
        """What such a calibration would have written of this lens."""
        shift = rng.normal(0, self.centre_px, 2)
        return lens.other(float(np.exp(rng.normal(0, self.focal))), shift, float(rng.normal(0, self.k1)))


PRIORS = {"foreign": Prior(), "tight": Prior(2e-4, 0.1, 1e-4), "exact": Prior(0.0, 0.0, 0.0)}


def random_camera(rng: Generator) -> Lens:
    """640 to 2000 pixels wide, focal length 0.8 to 3 widths, half of them with a lens that bends."""
    while True:
        width = int(rng.integers(640, 2001))
        height = int(width * rng.choice([3 / 4, 9 / 16, 2 / 3, 4 / 5]))
        focal = width * float(np.exp(rng.uniform(np.log(0.8), np.log(3))))
        centre = (np.array([width, height]) - 1) / 2 + rng.normal(0, 0.015 * width, 2)
        bend = (0.0,) * 5
        if rng.random() < 0.5:
            k1 = rng.uniform(-0.3, 0.1)
            bend = (k1, rng.uniform(-0.3, 0.6) * abs(k1), *rng.normal(0, 1e-3, 2), rng.normal(0, 0.02))
        lens = Lens((width, height), np.array([focal, focal * rng.uniform(0.998, 1.002)]), centre, bend)
        if lens.covers_its_picture():
            return lens


def random_projector(rng: Generator) -> Lens:
    """800 to 1920 pixels wide; two of three with lens shift, one of three with a lens that bends."""
    while True:
        width, height = [(800, 600), (912, 1140), (1024, 768), (1280, 720), (1280, 800), (1920, 1080)][rng.integers(6)]
        focal = width * rng.uniform(1.0, 2.4)
        centre = (np.array([width, height]) - 1) / 2 + rng.normal(0, 0.01 * width, 2)
        if rng.random() < 2 / 3:
            centre[1] += height * rng.uniform(0.2, 0.65) * rng.choice([-1, 1], p=[0.2, 0.8])
            centre[0] += width * rng.uniform(-0.15, 0.15) * (rng.random() < 0.3)
        bend = (0.0,) * 5
        if rng.random() < 1 / 3:
            bend = (rng.uniform(-0.1, 0.1), rng.uniform(-0.05, 0.05), *rng.normal(0, 1e-3, 2), 0.0)
        lens = Lens((width, height), np.array([focal, focal]), centre, bend)
        if lens.covers_its_picture():
            return lens
