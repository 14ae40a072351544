"""What the projector's light leaves in the camera's picture at each matched point.

Each projector pixel sends the same flux into its own solid angle, so that on a surface

    irradiance = cos(theta) / (d^2 w),   w = cos^3(alpha) (area of the pixel in the plane z = 1)

theta between the ray and the normal, d the distance from the projector, alpha between the ray and its axis. The surface
sends on a diffuse part and a Phong lobe; the camera's picture falls off with cos^4; its curve bends what it stores.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .capture import Capture
from .lens import Array, Generator
from .rig import Rig

COLORS = 7


@dataclass(frozen=True)
class Paint:
    """What makes light hard to read.

    Attributes
    ----------
    gamma : of the camera: it stores light^gamma.
    uneven : how much darker the projector is at one edge.
    gloss : height of the highlight, relative to white paint's diffuse light; `shine` its exponent.
    print : number of pieces of paint of albedo 0.2 to 1; 0 for plain paint.
    noise : relative.
    exposure : the brightest hundredth of the picture, full scale being 1.
    ambient : other light, relative to the projector's median; `removed` by a picture without the projector.
    """

    gamma: float = 1.0
    uneven: float = 0.0
    gloss: float = 0.0
    shine: float = 10.0
    print: int = 0
    noise: float = 0.01
    exposure: float = 0.9
    ambient: float = 0.0
    removed: bool = True
    colored: bool = True


def plain_paint(rng: Generator) -> Paint:
    """White paint, a projector up to 10 % uneven."""
    return Paint(
        gamma=float(rng.choice([1.0, 0.45])),
        uneven=rng.uniform(0, 0.1),
        noise=0.01,
        ambient=rng.uniform(0, 0.3),
        colored=bool(rng.random() < 0.5),
    )


def hostile_paint(rng: Generator) -> Paint:
    """Bold print, gloss to 50 %, up to 40 % darker at one edge, 3 % noise; some saturated, some with ambient light."""
    return Paint(
        gamma=float(rng.choice([1.0, 0.45])),
        uneven=rng.uniform(0, 0.4),
        gloss=rng.uniform(0, 0.5),
        shine=float(np.exp(rng.uniform(np.log(4), np.log(60)))),
        print=int(rng.integers(5, 60)),
        noise=0.03,
        exposure=rng.uniform(0.6, 1.0) if rng.random() < 0.7 else rng.uniform(1.0, 1.5),
        ambient=rng.uniform(0, 0.5),
        removed=bool(rng.random() < 0.8),
        colored=bool(rng.random() < 0.5),
    )


def irradiance(rig: Rig, points: Array, normals: Array) -> Array:
    """(N,) flux per area of the surface that a projector of one unit of flux a pixel leaves."""
    local = rig.in_projector(points)
    distance = np.linalg.norm(local, axis=1)
    cos_theta = -(normals * (points - rig.place)).sum(axis=1) / distance
    rays = local / local[:, 2:]
    solid_angle = rig.projector.pixel_area(rays) / np.linalg.norm(rays, axis=1) ** 3
    return cos_theta / (distance**2 * solid_angle)


def radiance(rng: Generator, rig: Rig, capture: Capture, paint: Paint) -> Array:
    """(N,) what each point sends to the camera, lens fall-off included, in any unit."""
    points, normals = capture.points, capture.normals
    across = rig.projector.project(rig.in_projector(points)) / np.array(rig.projector.size) - 0.5
    angle = rng.uniform(0, 2 * np.pi)
    ramp = across @ [np.cos(angle), np.sin(angle)] / (np.abs([np.cos(angle), np.sin(angle)]).sum())
    sent = irradiance(rig, points, normals) * (1 - paint.uneven * (ramp + 0.5))
    to_projector, to_camera = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (rig.place - points, -points))
    mirrored = 2 * (normals * to_projector).sum(axis=1, keepdims=True) * normals - to_projector
    lobe = np.maximum((mirrored * to_camera).sum(axis=1), 0) ** paint.shine
    reflected = _albedo(rng, points, paint.print) + paint.gloss * lobe
    return sent * reflected * (points[:, 2] / np.linalg.norm(points, axis=1)) ** 4


def shine(rng: Generator, rig: Rig, capture: Capture, paint: Paint) -> Capture:
    """The capture with `light`, and with `light_class` where its blocks are coloured."""
    glow = radiance(rng, rig, capture, paint)
    classes = None
    if paint.colored:
        classes = rng.integers(0, COLORS, len(capture))
        glow = glow * rng.uniform(0.35, 1.0, COLORS)[classes]
    glow = glow * (paint.exposure / np.percentile(glow, 99) / (1 + paint.ambient))
    other = paint.ambient * np.median(glow)
    light = _stored(rng, glow + other, paint)
    if paint.removed:
        light = light - _stored(rng, np.full_like(glow, other), paint)
    return replace(capture, light=light, light_class=classes)


def _stored(rng: Generator, light: Array, paint: Paint) -> Array:
    """By a camera of 8 bits, 0 to 255."""
    noisy = light * (1 + rng.normal(0, paint.noise, light.shape)) + rng.normal(0, 0.002, light.shape)
    return np.round(255 * np.clip(noisy, 0, 1) ** paint.gamma)


def _albedo(rng: Generator, points: Array, pieces: int) -> Array:
    if not pieces:
        return np.ones(len(points))
    seeds = points[rng.integers(0, len(points), pieces)]
    nearest = (points**2).sum(axis=1)[:, None] - 2 * points @ seeds.T + (seeds**2).sum(axis=1)
    return rng.uniform(0.2, 1.0, pieces)[nearest.argmin(axis=1)]
