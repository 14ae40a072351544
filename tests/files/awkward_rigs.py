"""Rigs whose every digit counts, to carry through files."""

from __future__ import annotations

from typing import Any

import numpy as np

from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.rig import Rig

SIZES: dict[str, Any] = {"camera_size": (1280, 1024), "projector_size": (1024, 768)}

UNFOLDED = np.array([5e-3, 2e-4, 5e-4, 5e-4, 1e-5])
"""Coefficients of about this size fold no picture of these, whatever its focal length."""


def make_rig(seed: int = 0, skew: float = 0.0) -> Rig:
    """A rig with awkward digits; principal points that survive + 1 - 1 (one tool counts from 1)."""
    rng = np.random.default_rng(seed)

    def camera(size: tuple[int, int]) -> Camera:
        f = rng.uniform(500, 5000, 2)
        c = rng.uniform(513, 1000, 2)
        K = np.array([[f[0], skew, c[0]], [0, f[1], c[1]], [0, 0, 1]])
        return Camera(size, K, rng.normal(size=5) * UNFOLDED)

    pose = RigidTransform.from_rotation_vector(rng.normal(size=3), rng.normal(size=3) * 10.0 ** rng.integers(-9, 9, 3))
    return Rig(camera(SIZES["camera_size"]), camera(SIZES["projector_size"]), pose, "mm")
