"""All unknowns of a recalibration, and what is known of them beforehand."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.geometry.two_view import POSE_PARAMETERS, TwoViewPose, pose_difference
from retrue.recalibration.bows import BOWS, CURVED
from retrue.recalibration.lens import LENS_PARAMETERS, LensPrior

LENSES = 2 * LENS_PARAMETERS


@dataclass(frozen=True, slots=True, eq=False)
class Parameters:
    """All unknowns.

    Attributes
    ----------
    pose : R, unit t, planes.
    lens : (8,) changes of both lenses, see `lens`.
    bows : (P, B) of the planes, in units of `flatness`, or `CURVED` times that.
    """

    pose: TwoViewPose
    lens: FloatArray
    bows: FloatArray

    @classmethod
    def of(cls, pose: TwoViewPose, lens: FloatArray | None = None) -> Parameters:
        """A pose seen through the rig's own lenses, or changed ones; planes flat."""
        return cls(pose, np.zeros(LENSES) if lens is None else lens, np.zeros((len(pose.planes), BOWS)))

    def without_planes(self, gone: BoolArray) -> Parameters:
        """The same without those planes (P,)."""
        return replace(self, pose=replace(self.pose, planes=self.pose.planes[~gone]), bows=self.bows[~gone])

    def as_curved(self, planes: BoolArray) -> Parameters:
        """The same place where those planes (P,), of which each was as flat as walls are, may be curved."""
        return replace(self, bows=np.where(planes[:, None], self.bows / CURVED, self.bows))

    def moved(self, step: FloatArray) -> Parameters:
        """By a step of the pose and planes (5 + 3 P), the lenses (8) and the bows (B P)."""
        size = POSE_PARAMETERS + 3 * len(self.pose.planes)
        return Parameters(
            self.pose.moved(step[:size]),
            self.lens + step[size : size + LENSES],
            self.bows + step[size + LENSES :].reshape(self.bows.shape),
        )


@dataclass(frozen=True, slots=True, eq=False)
class PosePrior:
    """What is known of the pose beforehand.

    Attributes
    ----------
    pose : R and unit t; its planes do not matter.
    precision : (5, 5) inverse covariance, see `pose_covariance`.
    """

    pose: TwoViewPose
    precision: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """What is known beforehand.

    Attributes
    ----------
    lens : of the lenses.
    free : whether the points may move the lenses. Else those stay as they are, and widen the covariance: what a real
        lens leaves over is larger than the noise of many points, and would be taken for a change.
    pose : of the pose, where an old one is asked about.
    kept : (8, 8) second moment of what lenses that stay are off by, given what the points say of them; None: as the
        prior has it.
    together : (5, 8) how the rig's own pose goes with errors of the lenses calibrated with it; None where it does not.
    """

    lens: LensPrior
    free: bool = False
    pose: PosePrior | None = None
    kept: FloatArray | None = None
    together: FloatArray | None = None

    def cost(self, parameters: Parameters) -> float:
        """Squared Mahalanobis length of the parameters in it."""
        lens, bows = parameters.lens, parameters.bows
        cost = float(lens @ self.lens.precision @ lens) + float(np.vdot(bows, bows))
        if self.pose is not None:
            difference = pose_difference(parameters.pose, self.pose.pose)
            cost += float(difference @ self.pose.precision @ difference)
        return cost
