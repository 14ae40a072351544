"""Camera pixel <-> projector pixel, the one thing that every decoder returns and every job takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retrue.errors import InputError, require_kind, require_kinds
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray, finite_array, frozen_array


@dataclass(frozen=True, slots=True, eq=False)
class Correspondences:
    """N matched pixels, only valid ones. (0, 0) is the centre of the top-left pixel, in both devices.

    Attributes
    ----------
    camera_px : (N, 2) float64, (x, y).
    projector_px : (N, 2) float64, (x, y).
    camera_sigma_px, projector_sigma_px : (N,) standard deviation of each point's noise, per axis, or
        None where the decoder cannot tell. Only their ratios need to be right: jobs estimate the level.
    confidence : (N,) in 0 .. 1, or None.
    colors : (N, 3) uint8 red, green, blue of the scene, or None.
    cells : (N, 2) int, (row, column) in a grid whose neighbours are neighbours on the surface: camera
        pixels for a dense code, blocks for a colour grid. None where the points have no topology.
    card : what the decoder has to say: counts, coverage, what was rejected and why, what to change.
    """

    camera_px: FloatArray
    projector_px: FloatArray
    camera_sigma_px: FloatArray | None = None
    projector_sigma_px: FloatArray | None = None
    confidence: FloatArray | None = None
    colors: NDArray[np.uint8] | None = None
    cells: IntArray | None = None
    card: Mapping[str, Any] = field(default_factory=dict[str, Any])

    def __post_init__(self) -> None:
        camera_px = finite_array(self.camera_px, (None, 2), "camera_px")
        projector_px = finite_array(self.projector_px, (None, 2), "projector_px")
        object.__setattr__(self, "camera_px", frozen_array(camera_px))
        object.__setattr__(self, "projector_px", frozen_array(projector_px))
        for name in ("projector_px", *OPTIONAL_COLUMNS):
            column = getattr(self, name)
            if column is not None and len(column) != len(camera_px):
                raise InputError(f"{name}: expected {len(camera_px)} rows as in camera_px, found {len(column)}")

    def __len__(self) -> int:
        return len(self.camera_px)

    def select(self, rows: IntArray | BoolArray) -> Correspondences:
        """The same, with only those rows (a mask or indices)."""
        columns = {name: None if (column := getattr(self, name)) is None else column[rows] for name in OPTIONAL_COLUMNS}
        return Correspondences(self.camera_px[rows], self.projector_px[rows], **columns, card=self.card)


def require_points(value: object) -> None:
    """An `InputError` that says what to hand in where `value` is no `Correspondences`."""
    require_kind(value, Correspondences, "points", READERS)


def require_captures(values: object) -> None:
    """An `InputError` where `values` is no list of `Correspondences`, or an empty one."""
    require_kinds(values, Correspondences, "captures", READERS)
    if not values:
        raise InputError("captures: expected at least one, found none")


READERS = "retrue.read_capture decodes pictures, retrue.read_points reads a table"
OPTIONAL_COLUMNS = ("camera_sigma_px", "projector_sigma_px", "confidence", "colors", "cells")
