"""How many points lie within 1, 2 and 3 of their own sigma, by distance and beside edges.

    python -m benchmarks.object.sigma [SCENES] [FIRST SEED] [BLUR PX] [PATTERN ...]

A right sigma holds 68.3, 95.4 and 99.7 %. The error is along the camera's ray, to where the surface truly is. Blur is
one sigma of the camera's lens; of the patterns all are asked, unless some are named.
"""

from __future__ import annotations

import sys

import numpy as np

from benchmarks.object.scenes import (
    BLUR_PX,
    DISTANCES,
    EDGE_PX,
    PATTERNS,
    Shot,
    beside_edges,
    make_rig,
    make_scene,
    take,
    true_points,
    true_points_of_projector,
)
from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.patterns.color_grid import ColorGrid
from retrue.reconstruction.reconstruct import reconstruct
from retrue.reconstruction.surface_grid import cell_index


def main(scenes: int, first: int, blur_px: float, patterns: list[str]) -> None:
    print(f"{'':26}{'points':>9}{'sigma mm':>10}   all of them within 1, 2, 3     {EDGE_PX:g} px beside edges")
    for name in patterns:
        pattern = PATTERNS[name]()
        rig = make_rig((1280, 960) if isinstance(pattern, ColorGrid) else (960, 720))
        for distance in DISTANCES:
            found: list[tuple[FloatArray, FloatArray, BoolArray]] = []
            for seed in range(first, first + scenes):
                scene = make_scene(np.random.default_rng([seed, int(distance)]), distance)
                found.append(errors(take(rig, scene, pattern, distance, seed, blur_px=blur_px)))
            z, sigma, edge = (np.concatenate(part) for part in zip(*found, strict=True))
            row = f"{name + f', {distance:g} mm':26}{len(z):9}{np.median(sigma):10.4f}"
            print(f"{row}   {within(z)}          {within(z[edge])}  ({100 * edge.mean():.1f} %)", flush=True)


def errors(shot: Shot) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Of each point of the cloud its error in own sigmas, its sigma, and whether it lies beside an edge."""
    cloud = reconstruct(shot.rig, shot.points)
    assert shot.points.cells is not None
    assert cloud.cells is not None
    assert cloud.sigma is not None
    rows = cell_index(shot.points.cells)[tuple((cloud.cells - shot.points.cells.min(axis=0)).T)]
    points = shot.points.select(rows)
    if isinstance(shot.pattern, ColorGrid):  # whose places in the projector are exact
        truth = true_points_of_projector(shot, points.projector_px)
    else:
        truth = true_points(shot, points.camera_px)
    ray = cloud.points / np.linalg.norm(cloud.points, axis=1, keepdims=True)
    z = ((cloud.points - truth) * ray).sum(axis=1) / cloud.sigma
    return z, cloud.sigma, beside_edges(shot, points.camera_px)


def within(z: FloatArray) -> str:
    return " ".join(f"{100 * float(np.mean(np.abs(z) < k)):6.1f}" for k in (1, 2, 3))


if __name__ == "__main__":
    words = sys.argv[1:]
    count, seed, blur = (words[k] if k < len(words) else usual for k, usual in enumerate(("1", "700", str(BLUR_PX))))
    main(int(count), int(seed), float(blur), words[3:] or list(PATTERNS))
