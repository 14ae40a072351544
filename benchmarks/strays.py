"""Of wrong matches that lie on their epipolar lines by chance, how many does `strays` tell, and how many right ones?

    python benchmarks/strays.py [SEEDS]

At the true pose, of simulated balls of which a share of the matches is wrong.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from retrue.recalibration.chance import strays
from tests.recalibration.scenes import BALL, BALLS, capture
from tests.recalibration.test_strays import SMALL, at_truth, shuffled

SCENES = {
    "a ball": (BALL, 1.0),
    "a ball, quieter": (BALL, 0.3),
    "four balls": (BALLS, 0.3),
    "a small one": (SMALL, 0.4),
}


def main() -> None:
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    print(f"{seeds} captures each      wrong  there   told   right   lost")
    for share in (0.5, 0.05):
        whole = np.zeros(4, dtype=np.int64)
        for name, (scene, noise) in SCENES.items():
            counts = np.zeros(4, dtype=np.int64)
            for seed in range(seeds):
                points, wrong = shuffled(capture(scene, noise=noise, seed=seed), share, np.random.default_rng(seed))
                fit = at_truth(points)
                gone, explained = strays(fit, None), fit.explained
                counts += [
                    np.count_nonzero(rows)
                    for rows in (explained & wrong, gone & wrong, explained & ~wrong, gone & ~wrong)
                ]
            print(f"{name:20} {share:7.0%} {counts[0]:6} {counts[1]:6} {counts[2]:7} {counts[3]:6}", flush=True)
            whole += counts
        print(f"{'together':20} {share:7.0%} {whole[0]:6} {whole[1]:6} {whole[2]:7} {whole[3]:6}")


if __name__ == "__main__":
    main()
