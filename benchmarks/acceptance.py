"""Do reported values lie within their stated uncertainty? Simulated acceptance tests of rigs with errors.

    python -m benchmarks.acceptance [TESTS] [SEED] [FIRST]

Each test draws a rig with errors in pose, focal lengths and distortion, a ball bar and a plate in random positions, the
errors of the artefact's calibration, and noise of 0.03 to 0.2 px. The truth of size and spacing is what the same
wrong rig says of the same scene without noise; that of form and flatness, which noise is a part of, the mean over
new captures.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from retrue.acceptance.accept import Acceptance, accept
from retrue.acceptance.artefact import Artefact, Length
from retrue.acceptance.fits import trimmed_range
from retrue.correspondences import Correspondences
from retrue.geometry.sphere import sphere_through
from retrue.geometry.transform import RigidTransform
from retrue.rig import Rig
from retrue.simulation.surfaces import Wall
from tests.acceptance.simulated import ball, measured, noisy, placed, seen, wrong_rig

REPEATS = 20
OUTLIERS = 0.003
CALIBRATION = 0.02  # mm, k = 2

Errors = dict[str, list[tuple[float, float]]]
"""Error and expanded uncertainty of each value, by quantity."""


def bar_test(random: np.random.Generator, rig: Rig, sigma: float, errors: Errors) -> None:
    """A ball bar somewhere in the volume."""
    diameter, distance = random.uniform(35, 55), random.uniform(100, 160)
    middle = np.array([*random.uniform(-50, 50, 2), random.uniform(550, 750)])
    along = random.normal(size=3) * [1, 1, 0.5]
    along /= np.linalg.norm(along)
    centres = [middle - distance / 2 * along, middle + distance / 2 * along]
    points, surface = seen([ball(*centre, diameter) for centre in centres], 3)
    lengths = diameter, distance
    known = Artefact("spheres", *(Length(x + CALIBRATION / 2 * random.normal(), CALIBRATION) for x in lengths))
    exact = accept([measured(rig, points)], Artefact("spheres", *map(Length, lengths)))
    answer = accept([measured(rig, noisy(points, random, sigma))], known)
    if "refused" in (answer.verdict, exact.verdict):
        errors["refused"].append((np.nan, np.nan))
        return
    forms = iter(_mean_forms(random, rig, sigma, points, surface, exact))
    for value, truth in zip(answer.positions[0].values, exact.positions[0].values, strict=True):
        true_value = next(forms) if value.quantity == "form" else truth.value
        errors[value.quantity].append((value.value - true_value, value.expanded))


def _mean_forms(
    random: np.random.Generator, rig: Rig, sigma: float, points: Correspondences, surface: np.ndarray, exact: Acceptance
) -> list[float]:
    """Of each ball, from left to right, over new captures of its points."""
    used = {tuple(pixel) for pixel in exact.positions[0].camera_px.tolist()}
    here = np.array([tuple(pixel) in used for pixel in points.camera_px.tolist()])
    balls = sorted(
        (points.select(here & (surface == k)) for k in (0, 1)), key=lambda part: measured(rig, part).points[0, 0]
    )
    return [_mean_range(random, rig, sigma, part, lambda points: sphere_through(points).residuals) for part in balls]


def _mean_range(
    random: np.random.Generator,
    rig: Rig,
    sigma: float,
    points: Correspondences,
    residuals: Callable[[np.ndarray], np.ndarray],
) -> float:
    """Of the residuals, over new captures of the points."""
    alone = replace(points, cells=None)
    captures = (placed(rig, noisy(alone, random, sigma)) for _ in range(REPEATS))
    return float(np.mean([trimmed_range(residuals(capture), OUTLIERS) for capture in captures]))


def _off_plane(points: np.ndarray) -> np.ndarray:
    away = points - points.mean(axis=0)
    return away @ np.linalg.eigh(away.T @ away)[1][:, 0]


def plate_test(random: np.random.Generator, rig: Rig, sigma: float, errors: Errors) -> None:
    """A plate somewhere before the wall."""
    turn = 0.3 * random.normal(size=3)
    pose = RigidTransform.from_rotation_vector(turn, [*random.uniform(-40, 40, 2), random.uniform(550, 700)])
    points, _ = seen([Wall(pose, (random.uniform(80, 120), random.uniform(60, 90)))], 4)
    answer = accept([measured(rig, noisy(points, random, sigma))], Artefact("plane"))
    if answer.verdict == "refused":
        errors["refused"].append((np.nan, np.nan))
        return
    (position,) = answer.positions
    used = points.select(np.sort(_rows_of(points, position.camera_px)))
    value = position.values[0]
    errors["flatness"].append((value.value - _mean_range(random, rig, sigma, used, _off_plane), value.expanded))


def _rows_of(points: Correspondences, camera_px: np.ndarray) -> np.ndarray:
    """The points whose noisy pixels are nearest to those."""
    from scipy.spatial import cKDTree

    _, rows = cKDTree(points.camera_px).query(camera_px)
    return np.unique(rows)


def study(tests: int, seed: int = 0, first: int = 0) -> Errors:
    """The errors of so many tests, each of its own random numbers, from the `first`."""
    errors: Errors = defaultdict(list)
    for number in range(first, first + tests):
        random = np.random.default_rng([seed, number])
        rig, sigma = wrong_rig(random), random.uniform(0.03, 0.2)
        bar_test(random, rig, sigma, errors)
        plate_test(random, rig, sigma, errors)
        print(f"\r{number + 1 - first} of {tests}", end="", file=sys.stderr)
    return errors


def main() -> None:
    words = [int(word) for word in sys.argv[1:]]
    errors = study(*(words or [200]))
    for quantity, pairs in errors.items():
        off, expanded = np.array(pairs).T
        share = (np.abs(off) <= expanded).mean()
        print(
            f"{quantity:<9} {len(pairs):4d} values, {share:6.1%} within their uncertainty, RMS of error over standard "
            f"uncertainty {np.sqrt(np.mean((2 * off / expanded) ** 2)):.2f}, mean {np.mean(2 * off / expanded):+.2f}, "
            f"median U {np.median(expanded):.3f} mm"
        )


if __name__ == "__main__":
    main()
