"""How the colour-grid decoder falls off, one disturbance at a time, until it stops.

    python benchmarks/color_grid_limits.py

Our own renderer, a tilted wall with a ball before it. It has to stop by missing points, not by wrong ones.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from color_grid_score import Score, block_truth, score

from retrue.decoding.blocks.decode_color_grid import decode_color_grid
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.patterns.color_grid import make_color_grid
from retrue.rig import Rig
from retrue.simulation.camera_model import CameraModel, Mixing
from retrue.simulation.scene import Scene, render
from retrue.simulation.surfaces import Paint, Sphere, Wall

GRID = make_color_grid((640, 480), 20, 26)
USUAL = CameraModel(exposure=0.8, blur_px=0.8, electrons=10000, read_noise=5, gamma=2.2, bayer=True)
SEEDS = (1, 2)


def main() -> None:
    print(f"{'disturbance':34} {'blocks':>6} {'decoded %':>9} {'wrong':>5} {'RMS px':>7}")
    for electrons in (10000, 1000, 300, 100, 30, 10):
        report(f"noise, {electrons} electrons", model=replace(USUAL, electrons=electrons))
    for blur in (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0):
        report(f"blur, {blur} px", model=replace(USUAL, blur_px=blur))
    for focal in (1200, 800, 560, 400, 300, 220, 160):
        report(f"block size, about {focal / 58:.1f} px", focal=focal)
    for leak in (0.0, 0.2, 0.4, 0.6, 0.8):
        report(f"colour mixing, {leak} of each neighbour", model=replace(USUAL, mixing=mixing(leak)))
    for ambient in (0.03, 0.3, 1.0, 2.0, 4.0, 8.0):
        report(
            f"ambient light, {ambient} of white", model=replace(USUAL, exposure=0.8 / (1 + ambient)), ambient=ambient
        )
    for exposure in (0.8, 0.1, 0.01, 0.003, 0.001):
        report(f"darkness, white at {exposure}", model=replace(USUAL, exposure=exposure, gamma=1.0, bayer=False))
    for contrast in (0.0, 0.3, 0.6, 0.8, 0.95):
        report(f"print, contrast {contrast}", contrast=contrast)


def mixing(leak: float) -> Mixing:
    return ((1, leak, 0), (leak / 2, 1, leak / 2), (0, leak, 1))


def report(
    name: str, model: CameraModel = USUAL, focal: float = 560.0, ambient: float = 0.03, contrast: float = 0.0
) -> None:
    results = [_score(model, focal, ambient, contrast, seed) for seed in SEEDS]
    countable = sum(result.countable for result in results)
    decoded = sum(result.decoded for result in results)
    rms = np.sqrt(np.mean([result.rms_px**2 for result in results]))
    share = f"{100 * decoded / countable:9.1f}" if countable else f"({sum(r.points for r in results)})".rjust(9)
    print(f"{name:34} {countable:6} {share} {sum(result.wrong for result in results):5} {rms:7.3f}", flush=True)


def _score(model: CameraModel, focal: float, ambient: float, contrast: float, seed: int) -> Score:
    camera = Camera((480, 360), [[focal, 0, 239.5], [0, focal, 179.5], [0, 0, 1]], [-0.1, 0.03, 0.001, 0, 0])
    projector = Camera((640, 480), [[1000, 0, 319.5], [0, 1000, 300.0], [0, 0, 1]])
    rig = Rig(camera, projector, RigidTransform.from_rotation_vector([0.02, 0.2, 0.02], [-300, 10, 20]))
    paint = Paint(blob_size=120.0 if contrast else 0.0, contrast=contrast, seed=seed)
    ball = Sphere(np.array([-60.0, 20.0, 1300.0]), 110.0)
    scene = Scene([Wall.facing(1500.0, (0.1, 0.25, 0.0), paint), ball], ambient=(ambient, ambient, ambient))
    seen = render(rig, scene, GRID.render(), model, seed=seed)
    truth = block_truth(GRID, seen.projector_px, seen.visible, seen.surface)
    return score(GRID, seen.projector_px, truth, decode_color_grid(GRID, seen.image))


if __name__ == "__main__":
    main()
