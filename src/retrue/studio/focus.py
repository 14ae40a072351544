"""How sharp the pattern's blocks are in a frame."""

from __future__ import annotations

import cv2
import numpy as np

from retrue.correspondences import Correspondences
from retrue.geometry.arrays import Image

SHARP = 2.0  # px in which light falls from a block to the gap beside it, by a good lens and the pixels themselves
ROOM = 1.2  # of SHARP, that it must be able to take more: of smaller blocks nothing is told
STEPS = 32  # from the middle of a block to that of the next one
FEWEST, MOST = 30, 400  # pairs of neighbours


def focus(picture: Image, points: Correspondences) -> float | None:
    """From 0, where the light of each block runs into that of the next one, to 1, sharp; None where nothing tells.

    Between the middles of neighbours, d pixels apart, light falls by A and rises again, over A / (its steepest slope).
    The more it is blurred, the nearer it comes to a cosine, of which that is d / pi.
    """
    if points.cells is None or len(points) < FEWEST:
        return None
    place = points.cells.astype(np.int64) @ [1 << 20, 1]
    order = np.argsort(place)
    after = np.minimum(np.searchsorted(place[order], place + 1), len(place) - 1)
    left = np.flatnonzero(place[order][after] == place + 1)
    if len(left) < FEWEST:
        return None
    left = left[:: -(-len(left) // MOST)]
    ends = points.camera_px[left], points.camera_px[order[after[left]]]
    steps = np.linspace(0, 1, STEPS + 1)[:, None]
    at = (ends[0][:, None] * (1 - steps) + ends[1][:, None] * steps).astype(np.float32)
    seen = cv2.remap(picture, at[..., 0], at[..., 1], cv2.INTER_LINEAR).reshape(*at.shape[:2], -1).max(axis=2)
    seen = seen.astype(np.float64)
    fall = np.ptp(seen, axis=1)
    if np.count_nonzero(fall) < FEWEST:
        return None
    profile = np.mean(seen[fall > 0] / fall[fall > 0, None], axis=0)
    distance = float(np.median(np.linalg.norm(ends[1] - ends[0], axis=1)))
    widest = distance / np.pi
    if widest < ROOM * SHARP:
        return None
    width = distance * float(np.ptp(profile) / np.abs(np.gradient(profile, 1 / STEPS)).max())
    return float(np.clip((widest - width) / (widest - SHARP), 0, 1))
