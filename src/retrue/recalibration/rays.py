"""From the correspondences of several captures to rays that can be fitted together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from retrue.correspondences import Correspondences
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.camera import Camera
from retrue.geometry.two_view import FREE, TwoViewPoints
from retrue.kernels import surroundings as kernel
from retrue.rig import Rig

SAME_PLACE, SAME_PLACE_PX = 0.2, 3.0  # of the usual distance between points, and at most
LOUDEST = 3.0  # times the noise that photographs' matches measured of themselves, beside what a lens leaves over
SMALLEST_RELATIVE_SIGMA = 0.1  # of the median: no point outweighs a hundred others by what it says of itself
LEAST_LENS_PX = 0.005  # of the projector: lenses leave over, which a dense code's own scatter does not know


@dataclass(frozen=True, slots=True, eq=False)
class Rays:
    """All captures as one set of rays.

    Attributes
    ----------
    points : N rays, none on a plane yet. Residuals that they leave are in pixels.
    capture : (N,) which capture each came from.
    row : (N,) which row of that capture.
    """

    points: TwoViewPoints
    capture: IntArray
    row: IntArray

    def __len__(self) -> int:
        return len(self.points)

    def select(self, rows: IntArray | BoolArray) -> Rays:
        """The same, with only those rows."""
        return Rays(self.points.select(rows), self.capture[rows], self.row[rows])

    def as_loud(self, loudness: FloatArray) -> Rays:
        """The same where each capture (C,) is so much louder than the usual one."""
        times = loudness[self.capture]
        camera, projector = self.points.camera_sigma * times, self.points.projector_sigma * times
        return replace(self, points=replace(self.points, camera_sigma=camera, projector_sigma=projector))

    def without_planes(self, gone: BoolArray) -> Rays:
        """The same where the points of those planes (P,) lie on none."""
        return replace(self, points=self.points.without_planes(gone))

    def thinned(self, count: int, rng: np.random.Generator) -> Rays:
        """At most `count` of them, evenly at random."""
        if len(self) <= count:
            return self
        return self.select(np.sort(rng.choice(len(self), count, replace=False)))


def rays_of_captures(rig: Rig, captures: Sequence[Correspondences], max_points: int, rng: np.random.Generator) -> Rays:
    """Undistorted rays of all captures, each thinned to its share; pixels that no ray maps to are left out.

    A place that was found several times counts once: its copies share their error, and two wrong matches with their
    copies would pass for a part of the scene. Decoders find no place twice.

    A capture that gives sigmas for one device only says that the other is exact; one that gives none has equal noise
    in both.
    """
    parts = [
        _rays_of_capture(rig, capture, index, max_points // len(captures), rng)
        for index, capture in enumerate(captures)
    ]
    if len(parts) == 1:
        return parts[0]
    points = TwoViewPoints(
        *(np.concatenate([getattr(part.points, name) for part in parts]) for name in TwoViewPoints.__dataclass_fields__)
    )
    return Rays(
        points,
        np.concatenate([part.capture for part in parts]),
        np.concatenate([part.row for part in parts]),
    )


def _rays_of_capture(rig: Rig, capture: Correspondences, index: int, max_points: int, rng: np.random.Generator) -> Rays:
    row = np.arange(len(capture))
    if len(row) > max_points:
        row = np.sort(rng.choice(len(row), max_points, replace=False))
    if capture.card is None or capture.card.counted == "features":
        row = row[_one_a_place(capture, row)]
    camera_sigma, projector_sigma = _relative_sigmas(capture, row)
    camera_rays = rig.camera.unproject(capture.camera_px[row])
    projector_rays = rig.projector.unproject(capture.projector_px[row])
    reached = np.isfinite(camera_rays + projector_rays)
    good = reached[:, 0] & reached[:, 1]
    points = TwoViewPoints(
        camera_rays,
        projector_rays,
        camera_sigma / _focal_length(rig.camera),
        projector_sigma / _focal_length(rig.projector),
        np.full(len(row), FREE),
    )
    rays = Rays(points, np.full(len(row), index), row)
    return rays if good.all() else rays.select(good)


def _one_a_place(capture: Correspondences, row: IntArray) -> BoolArray:
    """(N,) of those rows, all but the copies of a place that is found with less noise, or came before."""
    kept = np.ones(len(row), dtype=np.bool_)
    if len(row) < 2:
        return kept
    width, height = (float(np.ptp(side)) for side in capture.camera_px.T)
    reach = min(SAME_PLACE * float(np.sqrt(width * height / len(capture))), SAME_PLACE_PX)
    if not reach > 0:
        return kept
    given = [sigma[row] for sigma in (capture.camera_sigma_px, capture.projector_sigma_px) if sigma is not None]
    noise = np.sum(np.square(given), axis=0) if given else np.zeros(len(row))
    room = np.empty((len(row), 2)), np.empty(len(row), np.intc), np.empty(2 * len(row), np.intc)
    kernel.drop_copies(capture.camera_px[row], capture.projector_px[row], noise, reach, *room, kept.view(np.uint8))
    return kept


def _relative_sigmas(capture: Correspondences, row: IntArray) -> tuple[FloatArray, FloatArray]:
    """Sigmas per point in units of the median, so that residuals stay in pixels."""
    given = capture.camera_sigma_px, capture.projector_sigma_px
    if given[0] is None and given[1] is None:
        return np.ones(len(row)), np.ones(len(row))
    camera, projector = (np.zeros(len(row)) if sigma is None else sigma[row] for sigma in given)
    if capture.projector_sigma_ratio is not None:  # as measured on the points' own scatter
        projector = np.hypot(projector, LEAST_LENS_PX)
    median = float(np.median(np.hypot(camera, projector))) if len(row) else 1.0
    if not median > 0:
        return np.ones(len(row)), np.ones(len(row))
    total = np.hypot(camera, projector)
    lifted = np.maximum(total, SMALLEST_RELATIVE_SIGMA * median) / np.where(total > 0, total, 1.0) / median
    camera, projector = camera * lifted, projector * lifted
    unknown = ~(np.isfinite(camera) & np.isfinite(projector) & (total > 0))
    return np.where(unknown, 1.0, camera), np.where(unknown, 1.0, projector)


def _focal_length(device: Camera) -> float:
    return float(np.sqrt(device.K[0, 0] * device.K[1, 1]))


def loudest_px(captures: Sequence[Correspondences], most: float) -> float:
    """Noise that photographs' matches may have: louder ones are held together by a pose between that of some and that
    of others.
    """
    known: list[FloatArray] = []
    for capture in captures:
        if capture.camera_sigma_px is not None and capture.projector_sigma_px is not None:
            stated = np.hypot(capture.camera_sigma_px, capture.projector_sigma_px)
            known.append(stated[np.isfinite(stated) & (stated > 0)])
    told = np.concatenate(known) if known else np.empty(0)
    return min(most, round(LOUDEST * float(np.median(told)), 3)) if len(told) else most
