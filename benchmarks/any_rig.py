"""Any rig before any scene, however sampled and spoilt: is a wrong pose accepted, is a sigma too small?

    python -m benchmarks.any_rig [FIRST LAST] [--jobs 2] [--dump FILE]

A second simulator, which shares nothing with `benchmarks.judgement`: depth maps seen from the camera, OpenCV's lens
model, foreign matches of four kinds. A case is drawn whole from its seed: rasters, fields of view, lens shift, base and
aim; a surface with others before it; points at random, on a grid, at whole pixels, in heaps or in a window; noise in
either picture, with long tails or rounded; matches that are wrong, off by whole periods, shuffled in a blob, or a copy.

A pose is wrong when it is more than 5 of its own sigma and more than .2 deg off, in rotation or direction of t.
"""

from __future__ import annotations

import argparse
import json
import os
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")  # a process for each core; threads below them would only wait
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import numpy as np

import retrue

Array = np.ndarray
Generator = np.random.Generator
Depth = Callable[[Array], Array]  # (N,) depth of the rays (x, y, 1), (N, 2); infinite where there is nothing

RASTERS = [(640, 480), (800, 600), (912, 1140), (1280, 720), (1280, 1024), (1920, 1080), (2448, 2048), (4096, 3000)]
SURFACES = [
    "plane",
    "plane",
    "corner",
    "vee",
    "room",
    "terrain",
    "wave",
    "stairs",
    "ball",
    "cylinder",
    "cells",
    "saddle",
]
ATTEMPTS, FEWEST = 300, 60
WRONG_SIGMAS, WRONG_DEG = 5.0, 0.2
LENS = 2e-3, 1.0, 1e-3  # how well it was calibrated: relative focal length, centre in pixels, k1


@dataclass(frozen=True)
class Device:
    """A lens as OpenCV has it."""

    size: tuple[int, int]
    K: Array
    distortion: Array

    def project(self, points: Array) -> Array:
        return cv2.projectPoints(points[:, None], np.zeros(3), np.zeros(3), self.K, self.distortion)[0][:, 0]

    def rays(self, pixels: Array) -> Array:
        until = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-14)
        return cv2.undistortPoints(pixels[:, None], self.K, self.distortion, None, None, None, until)[:, 0]

    def sees(self, pixels: Array) -> Array:
        return ((pixels >= 0) & (pixels <= np.array(self.size) - 1)).all(axis=1)

    def calibrated(self, rng: Generator) -> retrue.Camera:
        """As a calibration finds it."""
        focal, centre, k1 = LENS
        K, distortion = self.K.copy(), self.distortion.copy()
        K[:2, :2] *= 1 + focal * rng.normal()
        K[:2, 2] += centre * rng.normal(size=2)
        distortion[0] += k1 * rng.normal()
        return retrue.Camera(self.size, K, distortion)


def between(rng: Generator, low: float, high: float) -> float:
    """Any size between, each order of magnitude alike."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def turn(rng: Generator, degrees: float) -> Array:
    axis = rng.normal(size=3)
    return cv2.Rodrigues(np.radians(degrees) * axis / np.linalg.norm(axis))[0]


def random_device(rng: Generator, *, lens_shift: bool) -> Device:
    width, height = RASTERS[rng.integers(len(RASTERS))]
    focal = width / 2 / np.tan(np.radians(between(rng, 12, 75)) / 2)
    centre = np.array([width - 1, height - 1]) / 2 + rng.normal(0, 0.01 * width, 2)
    if lens_shift:
        centre[1] = height * rng.uniform(0.75, 1.05)
    K = np.array([[focal, 0, centre[0]], [0, focal * rng.choice([1, 1, 1.002, 0.99]), centre[1]], [0, 0, 1.0]])
    gentle = min(1.0, (0.8 * focal / width) ** 2)
    k1 = rng.normal(0, 0.08) * gentle * (rng.random() < 0.7)
    k2 = -0.3 * k1 * gentle * (rng.random() < 0.5)
    return Device((width, height), K, np.array([k1, k2, *rng.normal(0, 3e-4, 2), 0.0]) * (rng.random() < 0.9))


def random_normal(rng: Generator, most_deg: float) -> Array:
    around, away = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(0, most_deg))
    return np.array([np.sin(away) * np.cos(around), np.sin(away) * np.sin(around), np.cos(away)])


def depth_of_plane(normal: Array, distance: float) -> Depth:
    """Of the one that the axis meets at that distance."""

    def depth(rays: Array) -> Array:
        facing = rays @ normal[:2] + normal[2]
        return np.where(facing > 1e-3, distance * normal[2] / np.maximum(facing, 1e-3), np.inf)

    return depth


def random_surface(rng: Generator, distance: float, half: float) -> tuple[str, Depth]:
    """At about that distance, its features of a size that a picture of that half width shows."""
    name = str(rng.choice(SURFACES))
    plane = depth_of_plane(random_normal(rng, 60 if name == "plane" else 40), distance)
    along = rng.normal(size=2)
    along /= np.linalg.norm(along)
    if name in ("corner", "vee", "room"):
        normals = [random_normal(rng, 55) for _ in range(3 if name == "room" else 2)]
        walls = [depth_of_plane(normal, distance * rng.uniform(0.95, 1.05)) for normal in normals]
        nearer = np.maximum if name == "vee" else np.minimum
        return name, lambda rays: reduce(nearer, [wall(rays) for wall in walls])
    if name == "terrain":
        waves, phases = rng.normal(size=(6, 2)) * rng.uniform(2, 8) / half / 4, rng.uniform(0, 2 * np.pi, 6)
        heights = rng.normal(0, 0.015, 6)
        return name, lambda rays: plane(rays) * (1 + np.sin(rays @ waves.T + phases) @ heights)
    if name == "wave":
        wave, height = along * rng.uniform(1, 12) / half, 10 ** rng.uniform(-3.3, -1.3)
        return name, lambda rays: plane(rays) * (1 + height * np.sin(rays @ wave))
    if name == "stairs":
        step, height = along * rng.uniform(2, 8) / half, rng.uniform(0.005, 0.04)
        return name, lambda rays: plane(rays) * (1 + height * np.floor(rays @ step))
    if name in ("ball", "cylinder"):
        radius = 2 * half * distance * between(rng, 0.15, 3)
        centre = np.array([*rng.normal(0, 0.15, 2) * half * distance, distance + radius])
        axis = rng.normal(size=3) * (name == "cylinder")
        across = np.eye(3) - np.outer(axis, axis) / max(float(axis @ axis), 1e-9)
        return name, depth_of_quadric(across, centre, radius)
    if name == "cells":
        return name, depth_of_cells(rng, distance, half)
    if name == "saddle":
        bend = rng.normal(size=(2, 2)) * 10 ** rng.uniform(-2.7, -0.7) / half**2
        return name, lambda rays: plane(rays) * (1 + np.einsum("ni,ij,nj->n", rays, bend, rays))
    return name, plane


def depth_of_quadric(across: Array, centre: Array, radius: float) -> Depth:
    """Of the points at that distance from the centre, `across` it."""

    def depth(rays: Array) -> Array:
        x = np.column_stack([rays, np.ones(len(rays))])
        a, b = np.einsum("ni,ij,nj->n", x, across, x), x @ across @ centre
        root = b * b - a * (centre @ across @ centre - radius**2)
        found = (b - np.sqrt(np.maximum(root, 0))) / np.maximum(a, 1e-12)
        return np.where((root > 0) & (found > 0), found, np.inf)

    return depth


def depth_of_cells(rng: Generator, distance: float, half: float) -> Depth:
    """A plane of its own, and a depth, about each of some places."""
    count = int(rng.integers(4, 60))
    places, depths = rng.uniform(-1, 1, (count, 2)) * half, distance * rng.uniform(0.75, 1.35, count)
    normals = np.array([random_normal(rng, 50) for _ in range(count)])

    def depth(rays: Array) -> Array:
        cell = ((rays[:, None] - places) ** 2).sum(axis=2).argmin(axis=1)
        x, middle = (np.column_stack([place, np.ones(len(rays))]) for place in (rays, places[cell]))
        facing = (x * normals[cell]).sum(axis=1)
        there = depths[cell] * (middle * normals[cell]).sum(axis=1)
        return np.where(facing > 1e-3, there / np.maximum(facing, 1e-3), np.inf)

    return depth


def random_scene(rng: Generator, distance: float, half: float) -> tuple[str, Depth]:
    """A surface, and up to four pieces of others before it."""
    name, background = random_surface(rng, distance, half)
    names, pieces = [name], list[Depth]()
    for _ in range(int(rng.choice([0, 0, 0, 1, 1, 2, 4]))):
        name, front = random_surface(rng, distance * rng.uniform(0.7, 0.95), 0.4 * half)
        names.append(name)
        at, sides, angle = rng.uniform(-0.8, 0.8, 2) * half, half * rng.uniform(0.08, 0.5, 2), rng.uniform(0, np.pi)
        axes = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

        def piece(rays: Array, front: Depth = front, at: Array = at, sides: Array = sides, axes: Array = axes) -> Array:
            return np.where((np.abs((rays - at) @ axes) < sides).all(axis=1), front(rays - at), np.inf)

        pieces.append(piece)
    surfaces = [background, *pieces]
    return "+".join(names), lambda rays: np.min([surface(rays) for surface in surfaces], axis=0)


def random_pose(rng: Generator, distance: float, half: float, projector: Device) -> tuple[Array, Array, float]:
    """R, t and the base over the distance: the middle of the projector's picture lies in the camera's."""
    base = between(rng, 0.05, 1.0)
    if rng.random() < 0.15:  # rectified
        return np.eye(3), -distance * base * np.eye(3)[rng.integers(2)] * rng.choice([-1, 1]), base
    centre = rng.normal(size=3) * [1, 1, 0.2 if rng.random() < 0.8 else 1]
    centre *= base * distance / np.linalg.norm(centre)
    ahead = np.array([*rng.normal(0, 0.1, 2) * half * distance, distance]) - centre
    ahead /= np.linalg.norm(ahead)
    right = np.cross([0, 1.0, 0], ahead)
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(ahead, right), ahead])
    middle = np.array([*projector.rays((np.array([projector.size]) - 1.0) / 2)[0], 1.0])
    middle /= np.linalg.norm(middle)
    axis = np.cross([0, 0, 1.0], middle)
    sine = np.linalg.norm(axis)
    if sine > 1e-9:
        R = cv2.Rodrigues(axis / sine * np.arctan2(sine, middle[2]))[0] @ R
    if rng.random() < 0.5:
        R = turn(rng, abs(rng.normal(0, 8))) @ R
    return R, -R @ centre, base


def random_pixels(rng: Generator, how: str, count: int, size: tuple[int, int]) -> Array:
    raster = np.array(size)
    if how in ("grid", "whole pixels"):
        step = np.sqrt(raster.prod() / count)
        pixels = np.stack(np.meshgrid(*(np.arange(0, side - 1, step) for side in size)), axis=-1).reshape(-1, 2)
        return np.rint(pixels) if how == "whole pixels" else pixels
    pixels = rng.uniform(0, 1, (count, 2)) * (raster - 1)
    if how == "heaps":
        middles = rng.uniform(0, 1, (int(rng.integers(3, 15)), 2)) * (raster - 1)
        pixels = middles[rng.integers(len(middles), size=count)] + rng.normal(0, 0.04 * size[0], (count, 2))
    if how == "window":
        pixels = rng.uniform(0, 0.7, 2) * raster + pixels * rng.uniform(0.2, 0.5)
    return pixels[((pixels >= 0) & (pixels <= raster - 1)).all(axis=1)]


def first_seen(pixels: Array, depths: Array, size: tuple[int, int]) -> Array:
    """(N,) those that no other hides from the projector, in cells half as wide again as they lie apart."""
    side = max(2.0, 1.5 * np.sqrt(size[0] * size[1] / len(pixels)))
    _, cell = np.unique((pixels // side).astype(int), axis=0, return_inverse=True)
    nearest = np.full(cell.max() + 1, np.inf)
    np.minimum.at(nearest, cell.ravel(), depths)
    return depths < 1.03 * nearest[cell.ravel()]


@dataclass(frozen=True)
class Case:
    """What `retrue` is asked, the pose that is right, and what a reader of a failure wants to know."""

    rig: retrue.Rig
    points: retrue.Correspondences
    R: Array
    t: Array
    facts: dict[str, Any]


def draw(seed: int) -> Case:
    rng = np.random.default_rng([31337, seed])
    for _ in range(ATTEMPTS):
        camera, projector = random_device(rng, lens_shift=False), random_device(rng, lens_shift=rng.random() < 0.5)
        distance, half = 10 ** rng.uniform(1.5, 3.5), camera.size[0] / 2 / camera.K[0, 0]
        R, t, base = random_pose(rng, distance, half, projector)
        name, depth = random_scene(rng, distance, half)
        count, how = int(between(rng, 60, 8000)), str(rng.choice(["random", "grid", "whole pixels", "heaps", "window"]))
        pixels = random_pixels(rng, how, max(4 * count, 6000), camera.size)
        seen = exact_points(camera, projector, R, t, depth, distance, pixels)
        if len(seen) >= FEWEST:
            break
    else:
        raise RuntimeError(f"seed {seed}: no scene that both devices see")
    seen = seen[np.sort(rng.permutation(len(seen))[:count])]
    facts: dict[str, Any] = {"scene": name, "sampled": how, "base": round(base, 2)}
    points, spoilt = spoil(rng, seen, camera, projector, how)
    far = int(rng.choice([3, 10, 45]))
    old = retrue.RigidTransform(
        turn(rng, rng.uniform(0, far)) @ R, turn(rng, rng.uniform(0, far)) @ t * np.exp(rng.normal(0, 0.1))
    )
    rig = retrue.Rig(camera.calibrated(rng), projector.calibrated(rng), old, "mm")
    return Case(rig, points, R, t, facts | spoilt | {"points": len(points), "old": far})


def exact_points(
    camera: Device,
    projector: Device,
    R: Array,
    t: Array,
    depth: Depth,
    distance: float,
    pixels: Array,
) -> Array:
    """(N, 4) camera and projector pixels of what both see."""
    rays = camera.rays(pixels)
    x = np.column_stack([rays, np.ones(len(rays))])
    z = depth(rays)
    kept = (np.linalg.norm(camera.project(x) - pixels, axis=1) < 1e-4) & (z < 6 * distance)  # none beyond its fold
    there = x[kept] * z[kept, None] @ R.T + t
    before = there[:, 2] > 0.05 * distance
    seen, there = pixels[kept][before], there[before]
    slopes = there[:, :2] / there[:, 2:]
    if len(seen) < FEWEST:
        return np.empty((0, 4))
    seen = np.column_stack([seen, projector.project(there)])
    kept = (np.linalg.norm(slopes, axis=1) < 1.3) & projector.sees(seen[:, 2:])
    kept &= np.linalg.norm(projector.rays(seen[:, 2:]) - slopes, axis=1) < 1e-6
    seen, depths = seen[kept], there[kept, 2]
    return seen[first_seen(seen[:, 2:], depths, projector.size)] if len(seen) else seen


def spoil(
    rng: Generator, seen: Array, camera: Device, projector: Device, how: str
) -> tuple[retrue.Correspondences, dict[str, Any]]:
    """Noise, rounding, and matches that are not right."""
    level, tails = between(rng, 0.03, 0.6), rng.random() < 0.2
    noisy = "projector" if how == "whole pixels" else str(rng.choice(["camera", "projector", "both"]))
    errors = rng.standard_t(3, seen.shape) / np.sqrt(3) if tails else rng.normal(size=seen.shape)
    errors *= level * np.repeat([noisy != "projector", noisy != "camera"], 2)
    c, p = np.split(seen + errors, 2, axis=1)
    rounded = rng.random() < 0.15
    if rounded:
        p = np.rint(p)
    share, wrong = float(rng.choice([0, 0, 0, 0.02, 0.1, 0.3])), str(rng.choice(["wrong", "periods", "blob", "copy"]))
    rows = rng.random(len(c)) < share
    if wrong in ("blob", "copy"):
        apart = np.linalg.norm(c - c[rng.integers(len(c))], axis=1)
        rows = apart < np.quantile(apart, share)
    many = np.count_nonzero(rows)
    if wrong == "wrong":
        p[rows] = rng.uniform(0, 1, (many, 2)) * projector.size
    elif wrong == "periods":
        period = np.eye(2)[rng.integers(2)] * projector.size[0] / rng.choice([8, 16, 32, 64])
        p[rows] += period * rng.choice([-1, 1], (many, 1))
    elif wrong == "blob":
        p[rows] = rng.permutation(p[rows])
    else:
        p[rows] += rng.normal(0, 0.08, 2) * projector.size[0]
    inside = [(x >= -0.5).all(1) & (x <= np.array(d.size) - 0.5).all(1) for x, d in ((c, camera), (p, projector))]
    c, p = c[inside[0] & inside[1]], p[inside[0] & inside[1]]
    sizes = {"camera_size": camera.size, "projector_size": projector.size} if rng.random() < 0.7 else {}
    facts = {"noise": round(level, 3), "of": noisy, "tails": tails, "rounded": rounded}
    return retrue.Correspondences(c, p, **sizes), facts | ({"share": share, "foreign": wrong} if share else {})


def pose_error(R: Array, t: Array, case: Case) -> Array:
    """(5,) rotation vector from the true to that R, and the step from the true to that direction of t, in radians."""
    unit, true = t / np.linalg.norm(t), case.t / np.linalg.norm(case.t)
    tangent = np.linalg.svd(true[None])[2][1:]
    across = tangent @ unit
    angle = np.arctan2(np.linalg.norm(across), unit @ true)
    return np.concatenate([cv2.Rodrigues(R @ case.R.T)[0].ravel(), angle * across / max(np.linalg.norm(across), 1e-12)])


def ask(seed: int) -> dict[str, Any]:
    case = draw(seed)
    result = retrue.recalibrate(case.rig, [case.points], retrue.RecalibrateOptions())
    lens = result.evidence.lens
    found: dict[str, Any] = {"seed": seed, **case.facts, "verdict": result.verdict, "lens": lens}
    if isinstance(result, retrue.Refused):
        return found | {"cause": result.cause.name, "reason": result.reason}
    pose, sigma = result.rig.projector_from_camera, result.evidence.sigma
    error = np.degrees(pose_error(pose.R, pose.t, case))
    off = np.array([np.linalg.norm(error[:3]), np.linalg.norm(error[3:])])
    stated = np.zeros(2) if sigma is None else np.array([sigma.rotation_deg, sigma.translation_deg])
    right = ((off <= WRONG_DEG) | (off <= WRONG_SIGMAS * stated)).all()
    return found | {"off": off.round(3).tolist(), "sigma": stated.round(3).tolist(), "right": bool(right)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "seeds", type=int, nargs="*", default=[0, 300], metavar="SEED", help="the first, and the last+1"
    )
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--dump", type=Path, help="write all of it, a line of JSON for each case")
    options = parser.parse_args()
    first, last = options.seeds
    with ProcessPoolExecutor(options.jobs) as pool:
        found = list(pool.map(ask, range(first, last), chunksize=4))
    if options.dump is not None:
        options.dump.write_text("".join(f"{json.dumps(one)}\n" for one in found))
    answered = [one for one in found if "off" in one]
    wrong = [one for one in answered if not one["right"]]
    causes = Counter(one["cause"] for one in found if "cause" in one)
    ratios = np.array([np.divide(one["off"], one["sigma"]) for one in answered if one["verdict"] == "accepted"])
    within = [float(np.mean(ratios < k)) for k in (1, 2, 3)]
    print(f"{len(found)} cases: {len(answered)} answered, {len(wrong)} of them wrong; refused: {dict(causes)}")
    print("errors within 1, 2, 3 sigma: " + ", ".join(f"{share:.3f}" for share in within))
    for one in wrong:
        print(one)


if __name__ == "__main__":
    main()
