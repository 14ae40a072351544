"""A plane in front of the camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from retrue.errors import InputError
from retrue.geometry.arrays import FloatArray, finite_array, frozen_array
from retrue.ranges import require_number
from retrue.shown import ShortRepr, Shown, figures, vector
from retrue.values import ByValue

ROUNDING = 1e-15  # a unit vector within that of length one stays as it is


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Plane(ByValue, ShortRepr):
    """normal . X = distance, in the camera frame; the paper's n is normal / distance.

    Attributes
    ----------
    normal : (3,) unit vector, pointing away from the camera.
    distance : from the camera's centre, positive; in the rig's unit (or in |t| while scale is unknown).

    >>> Plane.from_n([0, 0, 0.5]).distance
    2.0
    """

    normal: FloatArray
    distance: float

    def __post_init__(self) -> None:
        normal = finite_array(self.normal, (3,), "plane normal")
        length = float(np.linalg.norm(normal))
        require_number(self.distance, "plane distance", 0, above=True)
        if not length > 0:
            raise InputError(f"plane: expected a non-zero normal, found {normal}")
        object.__setattr__(self, "normal", frozen_array(normal / length if abs(length - 1) > ROUNDING else normal))
        object.__setattr__(self, "distance", float(self.distance))

    @classmethod
    def from_n(cls, n: ArrayLike) -> Plane:
        """From the paper's n (3,), n . X = 1."""
        n = finite_array(n, (3,), "plane n")
        length = float(np.linalg.norm(n))
        return cls(n, 1.0 / length if length > 0 else np.inf)

    @property
    def n(self) -> FloatArray:
        """normal / distance, (3,)."""
        return self.normal / self.distance

    def _shown(self) -> Shown:
        return f"normal {vector(self.normal)}, distance {figures(self.distance, 4)}", {}
