"""How often `verify` cries wolf, and how small a drift it finds.

    python benchmarks/verify_power.py [--trials 2000] [--seed 0]

Random rigs and scenes, as in faults.py. The drift is given in sigma of the statistic that `verify` tests (five degrees
of freedom: rotation and direction of t). No test can do better than the two last columns: with one false alarm
in a thousand, the power of chi-square with five degrees of freedom, and that of a test which is told the direction of
the drift beforehand (Neyman and Pearson).
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # a process for each core; threads below them would only wait
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.stats import chi2, ncx2, norm

import retrue
from retrue.geometry.transform import rotation_from_vector
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.verify import VerifyOptions

sys.path.insert(0, str(Path(__file__).parents[1]))
from benchmarks.faults import random_rig, random_scene
from tests.recalibration.scenes import capture

FALSE_ALARMS = 1e-3
# The rig's own pose, intrinsics and planes are exact here, so that the statistic is that of the points alone.
EXACT = VerifyOptions(
    FALSE_ALARMS,
    estimate=RecalibrateOptions(
        focal_sigma=1e-9,
        principal_point_sigma_px=1e-6,
        k1_sigma=1e-9,
        flatness_sigma=1e-9,
        rig_sigma_rotation_deg=1e-6,
        rig_sigma_translation_deg=1e-6,
    ),
)


def trial(options: VerifyOptions, drift_sigmas: float, seed: np.random.SeedSequence) -> str:
    """The verdict on one capture, for a rig that is so far off."""
    rng = np.random.default_rng(seed)
    while True:
        rig = random_rig(rng)
        points = capture(random_scene(rng), rig=rig, seed=int(rng.integers(1 << 30)))
        if len(points) > 60:
            break
    if drift_sigmas == 0:
        return retrue.verify(rig, [points], options).verdict
    turn = rng.normal(size=3) / 57
    own = rig.projector_from_camera

    def verdict_at(angle: float) -> retrue.Verification:
        pose = retrue.RigidTransform(rotation_from_vector(angle * turn) @ own.R, own.t)
        return retrue.verify(replace(rig, projector_from_camera=pose), [points], options)

    angle = _angle_of(lambda angle: verdict_at(angle).drift_sigmas, verdict_at(0.0).drift_sigmas, drift_sigmas)
    return verdict_at(angle).verdict


def _angle_of(distance: Callable[[float], float | None], at_rest: float | None, wanted: float) -> float:
    """The turn whose expected statistic is `wanted`: its own noise is taken out to first order by both senses of it."""
    if at_rest is None:
        return 0.0
    small = 1e-3
    squares = [distance(sense * small) or np.nan for sense in (1, -1)]
    curvature = (squares[0] ** 2 + squares[1] ** 2 - 2 * at_rest**2) / (2 * small**2)
    return float(wanted / np.sqrt(curvature)) if curvature > 0 else 0.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    limit = chi2.isf(FALSE_ALARMS, 5)
    print(f"of {arguments.trials} captures; false alarms asked for: {FALSE_ALARMS:g}")
    print(f"{'drift, sigma':>12} {'':9}{'drifted':>8} {'good':>8} {'unknown':>8}   {'5 d.o.f.':>8} {'1 d.o.f.':>8}")
    sequences = np.random.SeedSequence(arguments.seed).spawn(9)
    with ProcessPoolExecutor() as pool:
        for (name, options, drift), sequence in zip(
            [("exact", EXACT, d) for d in (0.0, 3.0, 5.0, 6.0, 7.0, 8.0)] + [("default", VerifyOptions(), 0.0)],
            sequences,
            strict=False,
        ):
            found = list(pool.map(partial(trial, options, drift), sequence.spawn(arguments.trials), chunksize=16))
            shares = [found.count(verdict) / len(found) for verdict in ("drifted", "good", "unknown")]
            power = ncx2.sf(limit, 5, drift**2) if drift else FALSE_ALARMS
            best = norm.sf(norm.isf(FALSE_ALARMS) - drift)
            print(
                f"{drift:12g} {name:9}{shares[0]:8.2%} {shares[1]:8.2%} {shares[2]:8.2%}   {power:8.2%} {best:8.2%}",
                flush=True,
            )


if __name__ == "__main__":
    main()
