"""How a calibrated pose goes with errors of the lenses that were calibrated with it.

A calibration that has a principal point a pixel wrong turns the device by as much, so that the rays of one point still
meet. What is off by itself then hardly moves what the rig measures; and the pose that belongs to these lenses, which is
the one that its owner knows and wants back, is known far better than the pose by itself.

Source: Schmidt, "Application of state-space methods to navigation problems", 1966, for parameters that are considered,
not estimated; here with the correlation that estimating them together leaves.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from retrue.correspondences import Correspondences
from retrue.geometry.arrays import FloatArray
from retrue.recalibration.fit import Support, own_pose
from retrue.recalibration.lens import LensPrior
from retrue.recalibration.measured import Measured
from retrue.recalibration.parameters import Parameters, Prior
from retrue.recalibration.posterior import posterior_at
from retrue.recalibration.rays import rays_of_captures
from retrue.rig import Rig

GRID = 16, 12  # places across and down the picture
DEPTHS = 0.6, 1.0, 2.0  # of the working distance, at which a calibration saw its boards
NOISE_PX = 0.1


def pose_with_lenses(rig: Rig, distance: float, lenses: LensPrior) -> FloatArray:
    """(5, 8) by how much the pose follows each lens parameter where both are calibrated on all that the rig sees.

    Parameters
    ----------
    distance : where the rig works; points fill the picture there, nearer and further away.
    lenses : how well they are known.
    """
    width, height = rig.camera.size
    across, down = np.meshgrid(np.linspace(0, width - 1, GRID[0]), np.linspace(0, height - 1, GRID[1]))
    pixels = np.column_stack([across.ravel(), down.ravel()])
    rays = rig.camera.unproject(pixels)
    known = np.isfinite(rays).all(axis=1)
    ahead = np.column_stack([rays[known], np.ones(int(known.sum()))])
    points = np.concatenate([ahead * depth * distance for depth in DEPTHS])
    there = rig.projector_from_camera.apply(points)
    seen, both = rig.projector.project(there), rig.projector.sees(there)
    rng = np.random.default_rng(0)
    camera_px = np.tile(pixels[known], (len(DEPTHS), 1))[both]
    noisy = [px + rng.normal(0, NOISE_PX, px.shape) for px in (camera_px, seen[both])]
    capture = Correspondences(noisy[0], noisy[1], camera_size=rig.camera.size, projector_size=rig.projector.size)
    found = rays_of_captures(rig, [capture], len(capture), rng)
    measured = Measured(
        replace(rig, evidence={}), capture.camera_px[found.row], capture.projector_px[found.row], Support.of(found),
        np.zeros((len(found), 3)), 0.0, np.empty((len(found), 0), dtype=np.int64),
    )  # fmt: skip
    return posterior_at(measured, Parameters.of(own_pose(rig)), Prior(lenses)).follows
