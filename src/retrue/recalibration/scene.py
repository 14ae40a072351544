"""What the captures show: rays, planes and light, before any pose is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from retrue.correspondences import Correspondences
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.two_view import TwoViewPose
from retrue.recalibration.bows import bow_shapes
from retrue.recalibration.candidates import (
    check_spread,
    foremost,
    match_noise,
    poses_of_no_plane,
    refined_poses,
    starting_poses,
    with_planes,
)
from retrue.recalibration.doubtful_planes import planes_between
from retrue.recalibration.fit import Support
from retrue.recalibration.loudness import loudness_of_captures
from retrue.recalibration.measured import MISFIT_PX
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.parameters import Parameters
from retrue.recalibration.parts import FEWEST_OF_A_PART, homography_residuals, noise_of_planes, plane_levels
from retrue.recalibration.posterior import Measured
from retrue.recalibration.rays import Rays, rays_of_captures
from retrue.recalibration.rivals import Light, light_of, nearest_points
from retrue.recalibration.turned import turned_over
from retrue.recalibration.uneven_noise import NoiseShape, noise_shape
from retrue.rig import Rig

COMPARED_POINTS = 1500  # enough to tell hypotheses apart; the best is then fitted to all
LEAST_TURNED = 0.03  # of the points; wrong matches turn a few over, too


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What the captures of a rig show.

    Attributes
    ----------
    rig, captures, options : what was asked.
    rays : all points.
    few : those that hypotheses are compared on.
    turned : (N,) points that a mirror shows.
    homographies : of the planes.
    curved : (P,) planes that may be as curved as balls and faces are.
    neighbours : (M, 4) of the few.
    noise, local : of a match, see `match_noise`.
    photographs : whether all matches are of the scene's own texture.
    shape, shape_of_all : of the noise of the few and of all, where it is not alike along all axes.
    light : of the few, where any capture says it.
    """

    rig: Rig
    captures: Sequence[Correspondences]
    options: RecalibrateOptions
    rays: Rays
    few: Rays
    turned: BoolArray
    homographies: list[FloatArray]
    curved: BoolArray
    neighbours: IntArray
    noise: float
    local: float
    photographs: bool
    shape: NoiseShape | None = None
    shape_of_all: NoiseShape | None = None
    light: Light | None = None

    def measured(self) -> Measured:
        """Of the few."""
        measured = self._measured(self.few, self.neighbours)
        lone = None  # small things of photographs show one match each, and no surface has a second of them
        if not self.photographs:
            levels = plane_levels(measured)
            lone = noise_of_planes(self.few.points, self.homographies, self.neighbours, levels)
        return replace(measured, noise_shape=self.shape, lone=lone)

    def measured_of_all(self) -> Measured:
        """Of all points, without those that a mirror shows."""
        measured = self._measured(self.rays, np.empty((len(self.rays), 0), dtype=np.int64))
        misfit = MISFIT_PX if self.photographs else 0.0  # of a projector's points, a slow error holds it
        aside = self.turned if self.turned.any() else None
        return replace(measured, aside=aside, misfit=misfit, noise_shape=self.shape_of_all)

    def without_planes(self, gone: BoolArray) -> Scene:
        """The same where the points of those planes (P,) lie on none."""
        left = [H for H, none in zip(self.homographies, gone, strict=True) if not none]
        rays, few = self.rays.without_planes(gone), self.few.without_planes(gone)
        return replace(self, rays=rays, few=few, homographies=left, curved=self.curved[~gone])

    def starts(self, old: TwoViewPose, rng: np.random.Generator) -> list[Parameters]:
        """The foremost poses that planes, five points, or the old one lead to. DegenerateError where there are none."""
        poses = starting_poses(self.few.points, self.homographies, old, self.noise, rng)
        fits = refined_poses(poses, Support.of(self.few), rng)
        return [Parameters.of(fit.pose) for fit in foremost(fits, self.few.points)]

    def starts_of_no_plane(self, rng: np.random.Generator) -> list[Parameters]:
        """The foremost of a thorough search that no plane leads."""
        noises = self.noise, self.local
        poses = poses_of_no_plane(Support.of(self.few), self.homographies, noises, rng)
        return [Parameters.of(pose) for pose in poses]

    def _measured(self, rays: Rays, neighbours: IntArray) -> Measured:
        rows = [rays.row[rays.capture == index] for index in range(len(self.captures))]  # one capture after the other
        each = list(zip(self.captures, rows, strict=True))
        camera_px = np.concatenate([np.take(capture.camera_px, mine, axis=0) for capture, mine in each])
        projector_px = np.concatenate([np.take(capture.projector_px, mine, axis=0) for capture, mine in each])
        missed, shapes = homography_residuals(rays.points, self.homographies), bow_shapes(rays.points)
        return Measured(
            self.rig, camera_px, projector_px, Support.of(rays), shapes, self.options.flatness_sigma, neighbours,
            curved=self.curved, homography_residuals=missed, textured=self.photographs,
        )  # fmt: skip


def scene_of(
    rig: Rig, captures: Sequence[Correspondences], options: RecalibrateOptions, rng: np.random.Generator
) -> Scene:
    """Split planes off, and measure the noise. Undecidable where there are too few points, or all on a line."""
    rays = rays_of_captures(rig, captures, options.max_points, rng)
    check_spread(rays, options)
    few = rays.thinned(COMPARED_POINTS, rng)
    (noise, local), neighbours = match_noise(few.points, rng), nearest_points(few)
    turned = np.zeros(len(rays), dtype=np.bool_)
    if np.count_nonzero(turned_over(few.points, neighbours, noise)) > max(FEWEST_OF_A_PART, LEAST_TURNED * len(few)):
        turned = turned_over(rays.points, nearest_points(rays), noise)
    rays, homographies = with_planes(rays, rig, options, rng, turned)
    few = rays.select(~turned).thinned(COMPARED_POINTS, rng)
    flat = np.zeros(len(homographies), dtype=np.bool_)
    photographs = all(capture.card is not None and capture.card.counted == "features" for capture in captures)
    neighbours = nearest_points(few)
    if len(captures) > 1:
        loudness = loudness_of_captures(few, neighbours, homographies, len(captures))
        rays, few = rays.as_loud(loudness), few.as_loud(loudness)
    scene = Scene(rig, captures, options, rays, few, turned, homographies, flat, neighbours, noise, local, photographs)
    if not photographs:
        between = planes_between(few.points.plane_index, neighbours, len(homographies))
        scene = scene.without_planes(between)
    shape = noise_shape(scene.few.points, scene.homographies, neighbours)
    shape_of_all = None if shape is None else shape.of(scene.rays.points, scene.homographies)
    return replace(scene, shape=shape, shape_of_all=shape_of_all, light=light_of(rig, captures, scene.few))
