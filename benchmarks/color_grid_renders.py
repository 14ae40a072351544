"""Score the colour-grid decoder on renders with exact truth.

    python benchmarks/color_grid_renders.py [FOLDER ...]

A folder holds NAME.png and/or NAME.jpg, NAME.npz (K_c, dist_c, K_p, R, t, cam_size, prj_size, depth, obj_id,
prj_visible) and NAME.json or pattern.json. Counted are blocks that are wholly visible and at least 6 px wide; wrong
is more than half a pitch off; / sigma is the error over the sigma that each point comes with. The time is set beside
that of OpenCV reading the same file, the fastest of several runs each.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
from color_grid_score import block_truth, score

from retrue.decoding.blocks.decode_color_grid import decode_color_grid
from retrue.geometry.arrays import FloatArray, Image
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.patterns.color_grid import ColorGrid

RENDERS = Path(__file__).parents[2] / "shared" / "data" / "renders"
RUNS = 7


def main(folders: list[Path]) -> None:
    head = ("blocks", "decoded %", "points", "wrong", "RMS px", "worst", "/ sigma", "ms", "/ imread")
    print("picture".ljust(24), "{:>6} {:>9} {:>6} {:>5} {:>7} {:>6} {:>7} {:>6} {:>8}".format(*head))
    points = wrong = 0
    for file, truth_file, grid in pictures(folders):
        with np.load(truth_file) as truth:
            projector_px = true_projector_px(dict(truth))
            blocks = block_truth(grid, projector_px, truth["prj_visible"] > 0, truth["obj_id"].astype(np.int64))
        image = read(file)
        result = score(grid, projector_px, blocks, decode_color_grid(grid, image))
        decoding, reading = fastest(
            lambda grid=grid, image=image: decode_color_grid(grid, image), lambda file=file: cv2.imread(str(file))
        )
        points, wrong = points + result.points, wrong + result.wrong
        print(
            f"{file.name:24} {result.countable:6} {100 * result.recall:9.2f} {result.points:6} {result.wrong:5}"
            f" {result.rms_px:7.3f} {result.worst_px:6.2f}"
            f" {result.error_over_sigma:7.2f} {1000 * decoding:6.1f} {decoding / reading:8.2f}"
        )
    print(f"{points} points, {wrong} wrong")


def pictures(folders: list[Path]) -> Iterator[tuple[Path, Path, ColorGrid]]:
    for folder in folders:
        for truth in sorted(folder.glob("*.npz")):
            own = truth.with_suffix(".json")
            grid = read_grid(own if own.exists() else folder / "pattern.json")
            for suffix in (".png", ".jpg"):
                if truth.with_suffix(suffix).exists():
                    yield truth.with_suffix(suffix), truth, grid


def true_projector_px(truth: dict[str, FloatArray]) -> FloatArray:
    """(h, w, 2): unproject each pixel to its depth, and project that point into the projector."""
    camera = Camera(tuple(truth["cam_size"]), truth["K_c"], truth["dist_c"])
    projector = Camera(tuple(truth["prj_size"]), truth["K_p"])
    depth = truth["depth"]
    y, x = np.mgrid[0 : depth.shape[0], 0 : depth.shape[1]]
    rays = camera.unproject(np.stack([x, y], axis=-1))
    points = np.concatenate([rays, np.ones((*depth.shape, 1))], axis=-1) * depth[..., None]
    return projector.project(RigidTransform(truth["R"], truth["t"]).apply(points))


def read_grid(path: Path) -> ColorGrid:
    spec = json.loads(path.read_text())
    return ColorGrid(**{key: spec[key] for key in ("projector_size", "colors", "pitch", "block", "origin", "code")})


def read(path: Path) -> Image:
    return np.ascontiguousarray(cv2.imread(str(path))[..., ::-1])


def fastest(*works: Callable[[], object]) -> list[float]:
    """Seconds of the fastest of a few runs of each, in turns, so that what else the machine does meets all alike."""
    times = [float("inf")] * len(works)
    for _ in range(RUNS):
        for k, work in enumerate(works):
            start = time.perf_counter()
            work()
            times[k] = min(times[k], time.perf_counter() - start)
    return times


if __name__ == "__main__":
    cv2.setNumThreads(2)
    main([Path(folder) for folder in sys.argv[1:]] or [RENDERS])
