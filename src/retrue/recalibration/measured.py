"""What was measured, through whichever lenses: matched pixels, their rays, their planes and how those may be bowed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.camera import Camera
from retrue.geometry.two_view import FREE, PlaneBows, TwoViewPoints
from retrue.kernels import lenses as kernel
from retrue.recalibration.bows import CURVED
from retrue.recalibration.fit import BLOCKS, Support
from retrue.recalibration.lens import LENS_PARAMETERS, lens_numbers
from retrue.recalibration.uneven_noise import NoiseShape
from retrue.rig import Rig

MISFIT_PX = 0.04  # of a real lens from its model, shared by a part of the picture: no term of the model mends it


@dataclass(frozen=True, eq=False)
class Measured:
    """Matched pixels of all captures, and what does not change from one fit to the next.

    Attributes
    ----------
    rig : whose lenses may change.
    camera_px, projector_px : (N, 2).
    support : their rays through the rig's own lenses, with planes and blocks.
    shapes : (N, B) bows of each point's plane, three but of what is curved, RMS 1 over the plane; 0 of points on none.
    flatness : RMS bow of planes, relative to their distance.
    curved : (P,) planes that may be `CURVED` times as bowed; None where none may.
    neighbours : (N, 4) rows of the nearest points in the picture; (N, 0) where nobody asks.
    misfit : px, what no lens model explains of a real lens, and a part of the picture shares; part of the noise.
    homography_residuals : (N, 2) that each plane's homography leaves by itself; (0, 2) where nobody asks.
    aside : (N,) rows that belong to another pose and leave no residual.
    noise_shape : of a match, see `uneven_noise`; None where it is alike along all axes.
    textured : whether matches are of the scene's own texture, which may repeat in space.
    lone : (N,) points off all planes that may be the noise of one, see `noise_of_planes`; None where nobody asks.
    """

    rig: Rig
    camera_px: FloatArray
    projector_px: FloatArray
    support: Support
    shapes: FloatArray
    flatness: float
    neighbours: IntArray
    curved: BoolArray | None = None
    misfit: float = 0.0
    homography_residuals: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    aside: BoolArray | None = None
    noise_shape: NoiseShape | None = None
    textured: bool = False
    lone: BoolArray | None = None

    def __len__(self) -> int:
        return len(self.camera_px)

    def bowed(self, bows: FloatArray) -> PlaneBows:
        """Planes by those bows (P, B), and what share of its plane's disparity each moves a point by."""
        return self._bends, np.ascontiguousarray(bows)

    @property
    def capture(self) -> IntArray:
        """(N,) the number of each point's capture, as the blocks of its picture have it."""
        return self.support.blocks[0] // BLOCKS**2

    def may_be_curved(self, planes: int) -> BoolArray:
        """(P,) which of so many planes may be `CURVED` times as bowed as walls are."""
        return np.zeros(planes, dtype=np.bool_) if self.curved is None else self.curved

    def seen(self, lens: FloatArray) -> TwoViewPoints:
        """The rays through changed lenses (8,); their noise is one of pixels."""
        points = self.support.points
        if not lens.any():
            return points
        rays = [points.camera_rays.copy(), points.projector_rays.copy()]
        sigmas = [sigma.copy() for sigma in self._sigmas_px]
        for index, (device, pixels) in enumerate(self._devices):
            change = lens[index * LENS_PARAMETERS : (index + 1) * LENS_PARAMETERS]
            kernel.move_rays(*lens_numbers(device, change), pixels, rays[index], sigmas[index])
        return TwoViewPoints(rays[0], rays[1], sigmas[0], sigmas[1], points.plane_index)

    def turns(self, lens: FloatArray, rays: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How each parameter of changed lenses (8,) moves rays (2, N, 2) of camera and projector: (N, 2, 4) each."""
        turns = np.empty((2, rays.shape[1], 2, LENS_PARAMETERS))
        for index, (device, _) in enumerate(self._devices):
            change = lens[index * LENS_PARAMETERS : (index + 1) * LENS_PARAMETERS]
            kernel.turns_of_rays(*lens_numbers(device, change), rays[index], turns[index])
        return turns[0], turns[1]

    def select(self, rows: IntArray | BoolArray) -> Measured:
        """The same, with only those rows."""
        return replace(
            self,
            camera_px=self.camera_px[rows],
            projector_px=self.projector_px[rows],
            support=Support(self.support.points.select(rows), np.ascontiguousarray(self.support.blocks[:, rows])),
            shapes=self.shapes[rows],
            neighbours=np.empty((0, 0), dtype=np.int64),
            homography_residuals=self.homography_residuals[rows]
            if len(self.homography_residuals)
            else self.homography_residuals,
            aside=None if self.aside is None else self.aside[rows],
            noise_shape=None if self.noise_shape is None else self.noise_shape.select(rows),
            lone=None if self.lone is None else self.lone[rows],
        )

    def without_planes(self, gone: BoolArray) -> Measured:
        """The same where the points of those planes (P,) lie on none."""
        points = self.support.points.without_planes(gone)
        free = points.plane_index == FREE
        blocks = np.stack([self.support.blocks[0], np.where(free, -1, self.support.blocks[1])])
        shapes = np.where(free[:, None], 0.0, self.shapes)
        curved = None if self.curved is None else self.curved[~gone]
        return replace(self, support=Support(points, blocks), shapes=shapes, curved=curved)

    @cached_property
    def _bends(self) -> FloatArray:
        bends = self.shapes * self.flatness
        if self.curved is not None and self.curved.any():
            bends *= np.where(np.append(self.curved, False)[self.support.points.plane_index], CURVED, 1.0)[:, None]
        return bends

    @cached_property
    def _sigmas_px(self) -> tuple[FloatArray, FloatArray]:
        """(N,) each, of camera and projector: those of the rays in the pixels that they are of."""
        points = self.support.points
        sigmas = points.camera_sigma.copy(), points.projector_sigma.copy()
        rays = points.camera_rays, points.projector_rays
        for (device, _), there, sigma in zip(self._devices, rays, sigmas, strict=True):
            kernel.in_pixels(*lens_numbers(device, np.zeros(LENS_PARAMETERS)), np.ascontiguousarray(there), sigma)
        return sigmas

    @property
    def _devices(self) -> tuple[tuple[Camera, FloatArray], tuple[Camera, FloatArray]]:
        """Camera and projector, each with its pixels."""
        return (self.rig.camera, self.camera_px), (self.rig.projector, self.projector_px)
