"""How much each point of a capture weighs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from retrue.correspondences import Correspondences
from retrue.recalibration.rays import LEAST_LENS_PX, rays_of_captures
from tests.recalibration.scenes import RIG, SPHERE, Scene, capture


def test_a_dense_code_is_no_surer_than_lenses_are() -> None:
    rng = np.random.default_rng(2)
    points = capture(Scene(spheres=[SPHERE]), seed=1)
    own = np.where(rng.random(len(points)) < 0.5, 0.001, 0.01)
    points = replace(points, camera_sigma_px=None, projector_sigma_px=own)

    def ratio(capture: Correspondences) -> float:
        sigma = rays_of_captures(RIG, [capture], 100_000, rng).points.projector_sigma
        return float(sigma[own > 0.005].mean() / sigma[own < 0.005].mean())

    assert abs(ratio(points) - 10) < 1e-9
    scattered = replace(points, projector_sigma_ratio=np.ones(len(points)))
    assert abs(ratio(scattered) - np.hypot(0.01, LEAST_LENS_PX) / np.hypot(0.001, LEAST_LENS_PX)) < 1e-9
