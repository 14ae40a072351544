"""Split the points of one capture into planes: robust homographies, largest first, by themselves."""

from __future__ import annotations

import numpy as np

from retrue.geometry.arrays import FloatArray, IntArray
from retrue.geometry.robust_homography import HYPOTHESES, MOST_HYPOTHESES, largest_plane
from retrue.geometry.two_view import FREE


def split_planes(
    camera_rays: FloatArray,
    projector_rays: FloatArray,
    noise: float,
    *,
    min_points: int,
    max_planes: int,
    rng: np.random.Generator,
) -> tuple[list[FloatArray], IntArray]:
    """Homographies of the planes, largest first, and the plane of each point, `FREE` where on none.

    Parameters
    ----------
    camera_rays, projector_rays : (N, 2) normalised.
    noise : standard deviation per axis of a point about its plane, in normalised units of the projector.
    min_points : fewest points on a plane; a plane also holds a twentieth of the points, or it is chance.
    """
    plane_index = np.full(len(camera_rays), FREE)
    homographies: list[FloatArray] = []
    left = np.arange(len(camera_rays))
    fewest = max(min_points, len(camera_rays) // 20)
    while len(homographies) < max_planes and len(left) >= fewest:
        thorough = MOST_HYPOTHESES if not homographies else HYPOTHESES  # without a first plane there is no answer
        found = largest_plane(camera_rays[left], projector_rays[left], noise, fewest, rng, thorough)
        if found is None:
            break
        plane_index[left[found.inliers]] = len(homographies)
        homographies.append(found.homography)
        left = left[~found.inliers]
    return homographies, plane_index
