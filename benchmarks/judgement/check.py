"""Does the simulator keep its own laws? Each is checked another way than the one it is made by.

python -m benchmarks.judgement.check
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from .bound import bound
from .capture import Capture, Noise, capture
from .kinds import KINDS, draw
from .lens import PRIORS, Array, Generator
from .light import Paint, irradiance, radiance
from .rig import Rig, moved, pose_error, random_rig, turn, turn_vector
from .scene import SCENES, Relief, Scene

SILENT = Noise(0.0)


def seen(rng: Generator, name: str) -> tuple[Rig, Scene, Capture]:
    """A capture without noise."""
    while True:
        distance = 10 ** rng.uniform(2, 3.5)
        rig, scene = random_rig(rng, distance), SCENES[name](rng, distance)
        taken = capture(rng, rig, scene, count=800, noise=SILENT)
        if taken is not None and len(taken) > 60:
            return rig, scene, taken


def epipolar_miss(rig: Rig, taken: Capture) -> float:
    """By how many projector pixels the truth misses its matches: points from the two rays alone, projected again."""
    x, y = rig.camera.rays(taken.camera_px), rig.projector.rays(taken.projector_px) @ rig.R
    found = []
    for a, b in zip(x, y, strict=True):  # a s = place + b r
        s, _ = np.linalg.lstsq(np.stack([a, -b], axis=1), rig.place, rcond=None)[0]
        found.append(a * s)
    again = rig.projector.project(rig.in_projector(np.array(found)))
    return float(np.abs(again - taken.projector_px).max())


def textbook_pixels(rig: Rig, points: Array) -> Array:
    """Camera pixels by the formulas of the lens model as they are printed."""
    (k1, k2, p1, p2, k3), lens = rig.camera.bend, rig.camera
    x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    r2 = x * x + y * y
    gain = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = x * gain + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * gain + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.stack([u, v], axis=1) * lens.focal + lens.centre


def plane_miss(taken: Capture) -> float:
    """By how much the points of each flat piece miss the plane that fits them best, relative to their distance."""
    worst = 0.0
    for label in np.unique(taken.labels[taken.flat]):
        points = taken.points[taken.labels == label]
        if len(points) > 3:
            worst = max(worst, float(np.linalg.svd(points - points.mean(axis=0))[1][2] / np.abs(points).max()))
    return worst


def light_miss(rng: Generator, rig: Rig, scene: Scene, taken: Capture) -> float:
    """Median relative error of the irradiance against one pixel's flux over the area that its corners span."""
    h = 1e-3
    corners = []
    for dx, dy in ((-h, -h), (h, -h), (h, h), (-h, h)):
        corners.append(scene.trace(rig.place, rig.projector.rays(taken.projector_px + np.array([dx, dy])) @ rig.R)[0])
    a, b, c, d = corners
    area = 0.5 * np.linalg.norm(np.cross(c - a, d - b), axis=1) / (2 * h) ** 2
    error = irradiance(rig, taken.points, taken.normals) * area - 1
    return float(np.nanmedian(np.abs(error)))


def wall_light_miss(rng: Generator) -> float:
    """Light on a wall against 3 log(n . r) - 3 log cos(alpha) + 4 log cos(camera): what is left but a constant."""
    while True:
        rig, _, taken = seen(rng, "wall")
        if not any(rig.projector.bend):
            break
    points = rig.in_projector(taken.points)
    normal = np.linalg.svd(points - points.mean(axis=0))[2][2]
    rays = points / np.linalg.norm(points, axis=1, keepdims=True)
    said = 3 * np.log(np.abs(rays @ normal) / rays[:, 2])
    said += 4 * np.log(taken.points[:, 2] / np.linalg.norm(taken.points, axis=1))
    left = np.log(radiance(rng, rig, taken, Paint())) - said
    return float(np.ptp(left))


def normal_miss(rig: Rig, scene: Scene, taken: Capture) -> float:
    """Median angle, radians, between the normals and those of little triangles on the surface."""
    h = 1e-2
    a, b, c = (
        scene.trace(rig.place, rig.projector.rays(taken.projector_px + d) @ rig.R)[0] for d in ([0, 0], [h, 0], [0, h])
    )
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return float(np.nanmedian(np.linalg.norm(np.cross(normal, taken.normals), axis=1)))


def rotations(rng: Generator) -> float:
    """turn against the exponential's series, and against its inverse."""
    worst = 0.0
    for _ in range(200):
        v = rng.normal(size=3)
        W = np.cross(np.eye(3), v)
        series, term = np.eye(3), np.eye(3)
        for k in range(1, 60):
            term = term @ W / k
            series = series + term
        worst = max(worst, float(np.abs(turn(v) - series).max()))
        if np.linalg.norm(v) < np.pi:
            worst = max(worst, float(np.abs(turn_vector(turn(v)) - v).max()))
    return worst


def errors(rng: Generator) -> float:
    """pose_error against the angles that `moved` promises, in degrees."""
    worst = 0.0
    for _ in range(100):
        rig = random_rig(rng, 1.0)
        a, b = rng.uniform(0, 30, 2)
        other = moved(rng, rig, a, b, keep_length=False)
        error = pose_error(other.R, other.t, rig)
        off = np.degrees([np.linalg.norm(error[:3]), np.linalg.norm(error[3:])])
        worst = max(worst, float(np.abs(off - [a, b]).max()))
    return worst


def estimator_reaches_bound(rng: Generator) -> tuple[float, float]:
    """Median and mean of error^2 / bound^2 of a plain Gauss-Newton estimator of its own, without planes."""
    exact = PRIORS["exact"]
    ratio = []
    while len(ratio) < 60:
        distance = 1000.0
        rig, scene = random_rig(rng, distance), SCENES["object"](rng, distance)
        taken = capture(rng, rig, scene, count=400, noise=Noise(0.1))
        if taken is None or len(taken) < 150:
            continue
        best = bound(rig, [replace(taken, flat=np.zeros(len(taken), dtype=bool))], exact)
        if not (best.pose < 1).all():
            continue
        R, t = epipolar_fit(rig, taken)
        error = pose_error(R, t, rig)
        off = np.degrees([np.linalg.norm(error[:3]), np.linalg.norm(error[3:])])
        ratio.append((off / best.pose) ** 2)
    return float(np.median(ratio)), float(np.mean(ratio))


def epipolar_fit(rig: Rig, taken: Capture) -> tuple[Array, Array]:
    """From the truth, the pose that the noisy matches like best: Gauss-Newton on Sampson's distance, by differences."""
    x, y = rig.camera.rays(taken.camera_px), rig.projector.rays(taken.projector_px)
    dx = [(rig.camera.rays(taken.camera_px + d) - rig.camera.rays(taken.camera_px - d)) / 2 for d in np.eye(2)]

    def distance(step: Array, R: Array, t: Array) -> Array:
        R, t = turn(step[:3]) @ R, t + np.linalg.svd(t[None])[2][1:].T @ step[3:]
        line = np.cross(y, t) @ R
        return (line * x).sum(axis=1) / np.hypot(*((line * d).sum(axis=1) for d in dx))

    R, t = rig.R, rig.t / np.linalg.norm(rig.t)
    for _ in range(4):
        J = np.stack([(distance(h, R, t) - distance(-h, R, t)) / 2e-6 for h in 1e-6 * np.eye(5)], axis=1)
        step = np.linalg.lstsq(J, -distance(np.zeros(5), R, t), rcond=None)[0]
        R, t = turn(step[:3]) @ R, t + np.linalg.svd(t[None])[2][1:].T @ step[3:]
        t = t / np.linalg.norm(t)
    return R, t


def main() -> None:
    rng = np.random.default_rng(0)
    failed = []

    def law(name: str, value: float, most: float) -> None:
        good = bool(value <= most)
        print(f"{'ok  ' if good else 'FAIL'} {name:44} {value:.2e} (at most {most:.0e})")
        if not good:
            failed.append(name)

    law("rotations: quaternion against series", rotations(rng), 1e-9)
    law("pose error against the stated move, deg", errors(rng), 1e-9)
    for name in SCENES:
        made = [seen(rng, name) for _ in range(6)]
        law(f"{name}: the truth meets its matches, px", max(epipolar_miss(rig, taken) for rig, _, taken in made), 1e-5)
        textbook = max(np.abs(textbook_pixels(rig, c.points) - c.camera_px).max() for rig, _, c in made)
        law(f"{name}: the lens as printed, px", float(textbook), 1e-9)
        law(f"{name}: flat pieces are flat", max(plane_miss(taken) for _, _, taken in made), 1e-12)
        law(f"{name}: normals", max(normal_miss(rig, scene, taken) for rig, scene, taken in made), 1e-3)
        law(f"{name}: light by areas", max(light_miss(rng, rig, scene, taken) for rig, scene, taken in made), 1e-4)
        if any(isinstance(surface, Relief) for _, scene, _ in made for surface in scene.surfaces):
            off = max(np.abs(_heights(scene, taken)).max() for _, scene, taken in made)
            law(f"{name}: points lie on the relief", float(off), 1e-9)
    law("light on a wall: the closed form", max(wall_light_miss(rng) for _ in range(6)), 1e-9)
    middle, average = estimator_reaches_bound(rng)
    law("bound: mean of error^2 / bound^2 is 1", abs(average - 1), 0.35)
    law("bound: median of error^2 / bound^2", middle, 1.0)
    start, count = time.perf_counter(), 0
    for name in KINDS:
        for seed in range(2):
            first, again = (draw(name, seed) for _ in range(2))
            count += 2
            if not np.array_equal(first.captures[0].camera_px, again.captures[0].camera_px):
                failed.append(f"{name} {seed}: not the same twice")
    print(f"{1000 * (time.perf_counter() - start) / count:.1f} ms a case, {len(KINDS)} kinds")
    if failed:
        raise SystemExit("failed: " + "; ".join(failed))


def _heights(scene: Scene, taken: Capture) -> Array:
    """How far the points are from the height of the relief, relative to their distance."""
    relief = scene.surfaces[0]
    assert isinstance(relief, Relief)
    u, v, z = ((taken.points - relief.middle) @ relief.axes.T).T
    return (z - relief.height(u, v)) / np.abs(taken.points).max()


if __name__ == "__main__":
    main()
