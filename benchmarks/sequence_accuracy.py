"""Sines beside Gray code on simulated scenes: how far off, how honest the sigmas, and how many turns are wrong.

    python -m benchmarks.sequence_accuracy [SCENES] [FIRST SEED]

Errors are those of projector coordinates, at every decoded pixel, to where its ray truly meets the scene. Counted
apart are points within a few pixels of a jump of depth, where a pixel sees light of two surfaces. A wrong turn is an
error of more than half a period that no surface within three pixels explains.
"""

from __future__ import annotations

import sys

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from benchmarks.object.scenes import DISTANCES, PATTERNS, Shot, beside_edges, make_rig, make_scene, take, true_points
from retrue.correspondences import Correspondences
from retrue.geometry.arrays import FloatArray
from retrue.patterns.gray_code import GrayCode
from retrue.patterns.pattern import Pattern
from retrue.patterns.phase_shift import make_phase_shift
from retrue.simulation.scene import Scene
from retrue.simulation.surfaces import Wall

HALF_A_PERIOD_PX = 8.0
REACH = 3


def main(scenes: int, first: int) -> None:
    for name in ("sines", "gray code"):
        for distance in DISTANCES:
            seen = [_errors(name, distance, seed) for seed in range(first, first + scenes)]
            error, sigma, edge = (np.concatenate([own[k] for own in seen]) for k in range(3))
            turns = sum(own[3] for own in seen)
            relative = error / sigma
            print(
                f"{name:10}{distance:6g} mm{len(sigma):9} points, sigma {np.median(sigma):.4f} px; within 1, 2, 3: "
                f"{_within(relative[~edge])}, all {_within(relative)}; wrong turns {turns}",
                flush=True,
            )
    for distance in DISTANCES:
        gray, stripes = _plane_rms(GrayCode((1024, 768)), distance, first)
        sines, _ = _plane_rms(make_phase_shift((1024, 768), 16.0, 8), distance, first)
        print(
            f"a wall at {distance:g} mm: RMS {sines:.4f} px by sines, {gray:.4f} by the edges of a Gray code's "
            f"stripes, averaged; {stripes:.4f} by its stripes alone, {stripes / sines:.1f} times that of sines",
            flush=True,
        )


def _errors(name: str, distance: float, seed: int) -> tuple[FloatArray, FloatArray, FloatArray, int]:
    scene = make_scene(np.random.default_rng([seed, int(distance)]), distance)
    shot = take(make_rig((960, 720)), scene, PATTERNS[name](), distance, seed)
    points = shot.points
    truth = _true_px(shot)
    x, y = points.camera_px.astype(int).T
    error = points.projector_px - truth[y, x]
    off = np.abs(error).max(axis=1) > HALF_A_PERIOD_PX
    around = sliding_window_view(np.pad(truth, ((REACH,) * 2, (REACH,) * 2, (0, 0)), mode="edge"), (7, 7), (0, 1))
    near = np.abs(around[y[off], x[off]] - points.projector_px[off, :, None, None]).max(axis=1).min(axis=(1, 2))
    wrong = int(np.count_nonzero(near > HALF_A_PERIOD_PX))
    return error, _sigma_by_axis(points), beside_edges(shot, points.camera_px), wrong


def _sigma_by_axis(points: Correspondences) -> FloatArray:
    """(N, 2) of x and of y: stripes may tell one several times as well as the other."""
    both, ratio = points.projector_sigma_px, points.projector_sigma_ratio
    assert both is not None
    ratio = np.ones_like(both) if ratio is None else ratio
    y = both * np.sqrt(2 / (1 + ratio**2))
    return np.stack([ratio * y, y], axis=1)


def _true_px(shot: Shot) -> FloatArray:
    """(height, width, 2) what each camera pixel truly sees."""
    width, height = shot.rig.camera.size
    x, y = np.meshgrid(np.arange(float(width)), np.arange(float(height)))
    there = true_points(shot, np.column_stack([x.ravel(), y.ravel()]))
    px = shot.rig.projector.project(shot.rig.projector_from_camera.apply(there))
    return px.reshape(height, width, 2)


def _plane_rms(pattern: Pattern, distance: float, seed: int) -> tuple[float, float]:
    """Of every pixel of a bare wall; and of the middle of its stripe, which is what the code alone says."""
    wall = Scene([Wall.facing(distance, np.array([0.1, -0.05, 0.0]))], (0.04, 0.04, 0.04), bright_at=distance)
    shot = take(make_rig((960, 720)), wall, pattern, distance, seed)
    x, y = shot.points.camera_px.astype(int).T
    truth = _true_px(shot)[y, x]
    return _rms(shot.points.projector_px - truth), _rms(np.rint(truth) - truth)


def _rms(error: FloatArray) -> float:
    return float(np.sqrt(np.mean(error**2)))


def _within(z: FloatArray) -> str:
    return " ".join(f"{100 * float(np.mean(np.abs(z) < k)):.1f}" for k in (1, 2, 3))


if __name__ == "__main__":
    words = [int(word) for word in sys.argv[1:]]
    main(words[0] if words else 1, words[1] if len(words) > 1 else 700)
