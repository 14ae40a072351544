"""What a reconstruction returns: points, or points with faces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retrue.errors import InputError, require_kind
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.reconstruction.uncertainty import Errors, Uncertainty
from retrue.shown import HasReport, ShortRepr, Shown, counted, figures, in_space
from retrue.values import ByValue


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Cloud(ByValue, ShortRepr, HasReport):
    """N points in the camera frame.

    Attributes
    ----------
    points : (N, 3) in `unit`, all in front of both devices.
    colors : (N, 3) uint8 red, green, blue; mid grey where the capture has none.
    camera_px : (N, 2) where the camera sees each point.
    unit : the rig's unit of length.
    cells : (N, 2) as in `Correspondences`, or None.
    card : counts of what was kept and dropped, and the epipolar RMS in pixels, None of one projector coordinate.
    normals : (N, 3) unit normals that point to the camera, NaN where too few neighbours tell; None: not asked for.
    sigma : (N,) one standard deviation of each point's own error along the camera's ray, in `unit`; NaN of a point that
        was filled in. None where it is not known, as of a file without it.
    uncertainty : what `sigma` and `covariance` rest on; None where that is not known.
    """

    points: FloatArray
    colors: NDArray[np.uint8]
    camera_px: FloatArray
    unit: str
    cells: IntArray | None = None
    card: Mapping[str, Any] = field(default_factory=dict[str, Any])
    normals: FloatArray | None = None
    sigma: FloatArray | None = None
    uncertainty: Uncertainty | None = None

    def __len__(self) -> int:
        return len(self.points)

    def select(self, rows: IntArray | BoolArray) -> Cloud:
        """The same, with only those rows (a mask or indices)."""
        columns = ("points", "colors", "camera_px", "cells", "normals", "sigma")
        kept = {name: None if (column := getattr(self, name)) is None else column[rows] for name in columns}
        uncertainty = None if self.uncertainty is None else self.uncertainty.select(rows)
        return replace(self, **kept, uncertainty=uncertainty)

    def covariance(self, errors: Errors = "all") -> FloatArray:
        """(N, 3, 3) covariance of each point, in `unit` squared and the camera frame, made when asked for.

        Parameters
        ----------
        errors : "own": what each point errs by itself, through the noise of its pixels; "common": what the rig's pose,
            scale and lenses make all points err by together; "all": the sum. Of points i and j own errors are
            independent, common ones are not: their cross-covariance is S_i S_j^T, S the `common_shifts`.

        Raises
        ------
        InputError : the cloud does not say what it rests on, as one from a file.
        """
        if errors not in ("own", "common", "all"):
            raise InputError(f'errors: expected "own", "common" or "all", found {errors!r}')
        return self._known().covariance(self.points, errors)

    def common_shifts(self) -> FloatArray:
        """S (N, 3, K): how far each of K independent errors of the rig, one sigma each, moves each point."""
        return self._known().shifts(self.points)

    def _known(self) -> Uncertainty:
        if self.uncertainty is None:
            raise InputError("cloud: expected one that retrue.reconstruct made, found no record of how sure it is")
        return self.uncertainty

    def _shown(self) -> Shown:
        rows: dict[str, str] = {}
        if len(self):
            near, middle, far = np.quantile(self.points[:, 2], [0, 0.5, 1])
            rows["depth"] = (
                f"{figures(near, 4)} to {figures(far, 4)} {self.unit}, median {figures(middle, 4)} {self.unit}"
            )
        if self.card.get("epipolar_rms_px") is not None:
            rows["rays miss by"] = f"{figures(self.card['epipolar_rms_px'])} px (RMS)"
        if self.sigma is not None and np.isfinite(self.sigma).any():
            rows["sigma"] = f"{figures(float(np.nanmedian(self.sigma)))} {self.unit} along the ray (median)"
        with_ = [name for name in ("cells", "normals") if getattr(self, name) is not None]
        if with_:
            rows["with"] = ", ".join(with_)
        return f"{counted(len(self), 'point')} in {self.unit}", rows

    def _in_space(self) -> str:
        return in_space(self) if len(self) else ""


def require_cloud(value: object) -> None:
    """An `InputError` that says what to hand in where `value` is no `Cloud`."""
    require_kind(value, Cloud, "cloud", "retrue.reconstruct makes one")


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Mesh(ByValue, ShortRepr):
    """Triangles over points, in the camera frame.

    Attributes
    ----------
    points : (N, 3) in `unit`.
    colors : (N, 3) uint8 red, green, blue.
    faces : (M, 3) indices of points, counter-clockwise as the camera sees them.
    unit : the rig's unit of length.
    """

    points: FloatArray
    colors: NDArray[np.uint8]
    faces: IntArray
    unit: str

    def _shown(self) -> Shown:
        return f"{counted(len(self.points), 'point')}, {counted(len(self.faces), 'face')} in {self.unit}", {}

    def _in_space(self) -> str:
        return in_space(self) if len(self.points) else ""
