"""Where lines of the two families cross, and which crossings are neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from retrue.decoding.lines.families import Family
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.kernels import crossings as kernel

FAINT = 0.1  # of the strongest line about it: what is fainter is no line
ABOUT = 25  # px
ASIDE = 0.3  # of its distance that a neighbour may lie beside the line
LEAST, FARTHEST = 1.5, 32.0  # px to a neighbour
NONE = -1


@dataclass(frozen=True, slots=True, eq=False)
class Crossings:
    """N crossings.

    Attributes
    ----------
    at : (N, 2) camera (x, y).
    axes : (N, 2, 2) unit vectors along the lines there, to the right and down.
    neighbour : (N, 4) the next crossing to the right, down, to the left and up along the lines, or -1.
    """

    at: FloatArray
    axes: FloatArray
    neighbour: IntArray

    def __len__(self) -> int:
        return len(self.at)

    def select(self, rows: BoolArray) -> Crossings:
        """Only those, linked anew: the next one may be further on."""
        return link(self.at[rows], self.axes[rows])

    def turned(self, quarters: int) -> Crossings:
        """The same with other names for the directions: what was direction `quarters` is to the right."""
        axes = np.concatenate([self.axes, -self.axes], axis=1)
        turned = [(k + quarters) % 4 for k in range(4)]
        return Crossings(self.at, axes[:, turned[:2]], self.neighbour[:, turned])

    def steps(self) -> tuple[FloatArray, FloatArray]:
        """(N, 2) the way to the next one to the right, and down: the mean of both sides, NaN where there is none."""
        steps: list[FloatArray] = []
        for ahead in (0, 1):
            sides = [
                np.where(self.neighbour[:, [k]] >= 0, sign * (self.at[self.neighbour[:, k]] - self.at), np.nan)
                for k, sign in ((ahead, 1), (ahead + 2, -1))
            ]
            one = np.where(np.isfinite(sides[0]), sides[0], sides[1])
            steps.append((one + np.where(np.isfinite(sides[1]), sides[1], one)) / 2)
        return steps[0], steps[1]


def find_crossings(upright: Family, level: Family) -> Crossings:
    """The crossings of the lines of two families, linked along both; only mutual links stay."""
    near = [cv2.dilate(_strong(family).astype(np.uint8), np.ones((3, 3), np.uint8)) for family in (upright, level)]
    both = cv2.bitwise_and(near[0], near[1])
    at = np.asarray(cv2.connectedComponentsWithStats(both, connectivity=4)[3], dtype=np.float64)[1:]
    column, row = np.round(at).astype(np.int64).T
    return link(at, np.stack([level.along[row, column], upright.along[row, column]], axis=1))


def link(at: FloatArray, axes: FloatArray) -> Crossings:
    """Crossings at (N, 2), each with the nearest ones along its axes (N, 2, 2); only mutual links stay.

    Those that may be neighbours lie in a square about it; of equally near ones it is the upper one.
    """
    places = np.ascontiguousarray(at, dtype=np.float64)
    x, y = places.T
    wide = FARTHEST * float(np.hypot(1, ASIDE))
    strip = ((x - x.min(initial=0.0)) / (wide * (1 + 1e-9))).astype(np.int64)  # places within reach are in the next one
    order, rank = np.lexsort((y, strip)), np.empty(len(at), dtype=np.int64)
    rank[np.argsort(y, kind="stable")] = np.arange(len(at))
    start: IntArray = np.searchsorted(strip[order], np.arange(int(strip.max(initial=-1)) + 2))
    neighbour = np.empty((len(at), 4), dtype=np.int64)
    directions = np.ascontiguousarray(axes, dtype=np.float64)
    kernel.along_axes(places, directions, strip, start, order, rank, FARTHEST, ASIDE, LEAST, neighbour)
    return Crossings(at, axes, _mutual(neighbour))


def _strong(family: Family) -> BoolArray:
    side = 2 * ABOUT + 1
    return family.ridge & (family.height > FAINT * cv2.dilate(family.height, np.ones((side, side), np.uint8)))


def _mutual(neighbour: IntArray) -> IntArray:
    """Only the links that lead back."""
    itself = np.arange(len(neighbour))
    mutual = neighbour.copy()
    for k in range(4):
        back = neighbour[neighbour[:, k], (k + 2) % 4]
        mutual[(back != itself) | (neighbour[:, k] < 0), k] = NONE
    return mutual
