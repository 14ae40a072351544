"""Colours of points beside those that the scene truly has, in grey levels of 255, RMS over red, green, blue.

    python -m benchmarks.object.colors [SCENES] [FIRST SEED] [PAINT ...]

One paint takes some minutes: of `plain`, `colored` and `printed` all are asked, unless some are named.

In white light: the truth is the picture without noise that the camera would take in the projector's white light;
without a white picture, less the room's light, which a single picture of a grid does not tell from the surface. Beside
it the colours that the blocks themselves have. Albedo: the truth is that of the paint, through the camera's channels,
and times one factor for the whole cloud, which no picture tells.
"""

from __future__ import annotations

import sys

import numpy as np

from benchmarks.object.scenes import (
    BLUR_PX,
    CAMERA,
    DISTANCES,
    PATTERNS,
    PROJECTOR_SIZE,
    make_rig,
    make_scene,
    take,
    true_albedo,
)
from retrue.decoding.blocks.decode_color_grid import inspect_color_grid
from retrue.decoding.decode import decode
from retrue.decoding.light import around
from retrue.geometry.arrays import FloatArray
from retrue.reconstruction.options import ReconstructOptions
from retrue.reconstruction.reconstruct import reconstruct
from retrue.simulation.camera_model import gaussian_blur
from retrue.simulation.light_transport import find_transport
from retrue.simulation.surfaces import Paint

PAINTS = {
    "plain": Paint(),
    "colored": None,
    "printed": Paint(blob_size=60.0, contrast=0.5, seed=3),
}


def main(scenes: int, first: int, paints: list[str]) -> None:
    print(f"{'':18}in white light {'':22}albedo")
    names = (
        ("points", 8),
        ("with white", 12),
        ("without", 10),
        ("as projected", 14),
        ("with white", 12),
        ("without", 10),
    )
    print(f"{'paint':10}" + "".join(f"{name:>{width}}" for name, width in names))
    pattern, rig = PATTERNS["color grid"](), make_rig((1280, 960))
    for name in paints:
        paint = PAINTS[name]
        errors: list[list[FloatArray]] = [[], [], [], [], []]
        for seed in range(first, first + scenes):
            distance = DISTANCES[seed % len(DISTANCES)]
            scene = make_scene(np.random.default_rng(seed), distance, paint)
            shot = take(rig, scene, pattern, distance, seed)
            grid, black, white = shot.pictures
            transport = find_transport(rig, scene)
            truth = []
            for level in (255, 0):
                light = transport.light(np.full((*PROJECTOR_SIZE[::-1], 3), level, np.uint8)).astype(np.float64)
                truth.append(CAMERA.picture(gaussian_blur(light, BLUR_PX)))
            with_white, without = decode(pattern, [grid, black, white]), shot.points
            lit, dark = (around(picture, without.camera_px).mean(axis=1) for picture in truth)
            projected = inspect_color_grid(pattern, grid).color[tuple(without.cells.T)]
            errors[0].append(with_white.colors - around(truth[0], with_white.camera_px).mean(axis=1))
            errors[1].append(without.colors - (lit - dark))
            errors[2].append(projected - (lit - dark))
            for error, points in ((errors[3], with_white), (errors[4], without)):
                cloud = reconstruct(rig, points, ReconstructOptions(albedo=True))
                error.append(beside(cloud.colors.astype(np.float64), true_albedo(shot, cloud.camera_px)))
        rms = [float(np.sqrt(np.mean(np.concatenate(error) ** 2))) for error in errors]
        points = sum(map(len, errors[1]))
        print(f"{name:10}{points:8}{rms[0]:12.2f}{rms[1]:10.2f}{rms[2]:14.2f}{rms[3]:12.2f}{rms[4]:10.2f}", flush=True)


def beside(colors: FloatArray, albedo: FloatArray) -> FloatArray:
    """(N, 3) errors, the albedo scaled as fits the colours best."""
    known = np.isfinite(albedo).all(axis=1)
    found, true = colors[known], albedo[known]
    return found - true * float((found * true).sum() / (true * true).sum())


if __name__ == "__main__":
    words = [int(word) for word in sys.argv[1:3]]
    main(words[0] if words else 3, words[1] if len(words) > 1 else 9000, sys.argv[3:] or list(PAINTS))
