"""How many points of a smoothed cloud lie within 1, 2 and 3 of their sigma: planes, balls, waves, and beside creases.

    python -m benchmarks.object.smoothing [SCENES] [FIRST SEED]

Inverse depth is drawn over the picture, and each point's place in the projector errs by itself, by 0.05 or 0.25 px.
Beside the share within: RMS of the error, in sigmas of the point before. Right are 68.3, 95.4, 99.7.
"""

from __future__ import annotations

import sys
from collections import defaultdict

import numpy as np

from benchmarks.object.scenes import make_rig
from benchmarks.object.sigma import within
from retrue.correspondences import Correspondences
from retrue.geometry.arrays import FloatArray
from retrue.reconstruction.cloud import Cloud
from retrue.reconstruction.reconstruct import reconstruct
from retrue.reconstruction.smooth import smoothed

SIZE = (560, 420)
NOISES = (0.05, 0.25)  # px
DISTANCES = (650.0, 900.0, 1250.0)  # mm
RINGS = (2, 5, 9)  # cells from a crease


def surface(kind: str, rays: FloatArray, distance: float, random: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """1 / Z (H, W) along rays (H, W, 2), and how many cells each is from a crease."""
    x, y = np.moveaxis(rays, -1, 0)
    turn = random.uniform(0, np.pi)
    away, away_px = x * np.cos(turn) + y * np.sin(turn), np.inf + np.zeros_like(x)
    leaning = (1 + random.uniform(-0.3, 0.3) * x + random.uniform(-0.3, 0.3) * y) / distance
    if kind == "waves":
        return leaning + random.uniform(0.004, 0.012) / distance * np.sin(away * random.uniform(40, 80)), away_px
    if kind == "creases":  # a roof beside the other, each side with a slope of its own
        period = random.uniform(0.12, 0.25)
        phase = np.mod(away + random.uniform(0, 1), period) - period / 2
        pixel = float(np.hypot(x[0, 1] - x[0, 0], y[1, 0] - y[0, 0]) / np.sqrt(2))
        away_px = np.minimum(np.abs(phase), period / 2 - np.abs(phase)) / pixel
        return leaning + random.uniform(0.2, 0.8) * np.abs(phase) / distance, away_px
    w = leaning
    if kind == "balls":
        for _ in range(5):
            centre = np.array([*random.uniform(-0.25, 0.25, 2), 1.0]) * distance * random.uniform(0.8, 0.9)
            radius = distance * random.uniform(0.05, 0.1)
            along, square = rays @ centre[:2] + centre[2], 1 + x**2 + y**2
            root = along**2 - square * (centre @ centre - radius**2)
            w = np.where(root > 0, square / (along - np.sqrt(np.maximum(root, 0))), w)
    return w, away_px


def seen(kind: str, noise: float, seed: int) -> tuple[Cloud, FloatArray, FloatArray]:
    """A cloud, where its points truly are (N, 3), and their distances from creases (N,)."""
    random = np.random.default_rng([seed, int(1000 * noise)])
    rig, distance = make_rig(SIZE), DISTANCES[seed % len(DISTANCES)]
    v, u = np.mgrid[: SIZE[1], : SIZE[0]]
    pixels = np.stack([u, v], axis=-1).reshape(-1, 2).astype(np.float64)
    rays = rig.camera.unproject(pixels)
    w, away = surface(kind, rays.reshape(*SIZE[::-1], 2), distance, random)
    X = np.column_stack([rays, np.ones(len(rays))]) / w.reshape(-1, 1)
    projector_px = rig.projector.project(rig.projector_from_camera.apply(X))
    projector_px = projector_px + random.normal(0, noise, projector_px.shape)
    cells = np.stack([v, u], axis=-1).reshape(-1, 2)
    points = Correspondences(pixels, projector_px, projector_sigma_px=np.full(len(X), noise), cells=cells)
    cloud = reconstruct(rig, points)
    assert cloud.cells is not None
    row = np.ravel_multi_index(tuple(cloud.cells.T), SIZE[::-1])
    return cloud, X[row], away.ravel()[row]


def main(scenes: int, first: int) -> None:
    found: dict[str, list[FloatArray]] = defaultdict(list)
    for seed in range(first, first + scenes):
        for kind in ("planes", "balls", "waves", "creases"):
            for noise in NOISES:
                cloud, truth, away = seen(kind, noise, seed)
                smooth = smoothed(cloud)
                assert cloud.sigma is not None
                assert smooth.sigma is not None
                ray = truth / np.linalg.norm(truth, axis=1, keepdims=True)
                error = ((smooth.points - truth) * ray).sum(axis=1)
                ring = np.searchsorted(RINGS, away, side="right")
                for number in np.unique(ring):
                    to = f"to {RINGS[number]} px from them" if number < len(RINGS) else "further off"
                    here, name = ring == number, kind if kind != "creases" else f"creases, {to}"
                    found[name].append(np.stack([error / smooth.sigma, error / cloud.sigma])[:, here])
    for name in sorted(found):
        z, of_before = np.concatenate(found[name], axis=1)
        print(f"{name:28}{len(z):9}{within(z)}   {np.sqrt(np.mean(of_before**2)):.3f}")


if __name__ == "__main__":
    words = [int(word) for word in sys.argv[1:]]
    main(words[0] if words else 3, words[1] if len(words) > 1 else 100)
