"""What is decoded: crossings of the code, where they are, what their lines add, and which are neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.decoding.lines.colors import Colors
from retrue.decoding.surface import Joints, sound_joints
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray

LEAST_NATS = -1.0  # by which one line's light may speak against the code's colour
FAINT = 0.3  # of the usual light of its colour: less is no line


@dataclass(frozen=True, slots=True, eq=False)
class Code:
    """Colours of the columns (C,) and rows (R,) of the code, and how they look in one picture."""

    columns: IntArray
    rows: IntArray
    column_colors: Colors
    row_colors: Colors

    @property
    def shape(self) -> tuple[int, int]:
        return len(self.rows), len(self.columns)

    def nats(self, row: IntArray, column: IntArray, lights: FloatArray) -> FloatArray:
        """(2, N) by which the lights (2, N, 3) of column and row of each crossing speak for the code's colours."""
        itself = np.arange(len(row))
        of_column = self.column_colors.likelihood(lights[0])[itself, self.columns[column]]
        return np.stack([of_column, self.row_colors.likelihood(lights[1])[itself, self.rows[row]]])

    def right(self, row: IntArray, column: IntArray, lights: FloatArray) -> BoolArray:
        """(N,) whether both lights speak for the code's colours, and are enough."""
        nats = self.nats(row, column, lights)
        usual = np.stack([self.column_colors.usual[self.columns[column]], self.row_colors.usual[self.rows[row]]])
        enough = np.linalg.norm(np.maximum(lights, 0.0), axis=-1) > FAINT * usual
        return (nats > LEAST_NATS).all(axis=0) & (nats.sum(axis=0) > 0) & enough.all(axis=0)


@dataclass(frozen=True, slots=True, eq=False)
class Surfaces:
    """The crossings that are decoded; (rows, columns, ...) of the code, NaN where there is none.

    Attributes
    ----------
    position : (rows, columns, 2), in pixels of the picture.
    lights : (2, rows, columns, 3) what column and row add to their gaps.
    likeness : (rows, columns) of the profiles to those of lines, the lesser one.
    joints : which of them are neighbours on one surface.
    """

    position: FloatArray
    lights: FloatArray
    likeness: FloatArray
    joints: Joints

    @classmethod
    def none(cls, rows: int, columns: int) -> Surfaces:
        shape = (rows, columns)
        arrays = (np.full((*shape, 2), np.nan), np.full((2, *shape, 3), np.nan), np.full(shape, np.nan))
        return cls(*arrays, Joints.none(rows, columns))

    @property
    def held(self) -> BoolArray:
        """(rows, columns)."""
        return np.isfinite(self.position[..., 0])

    def only(self, keep: BoolArray) -> Surfaces:
        """Without the others."""
        keep = keep & self.held
        there = keep[..., None]
        return Surfaces(
            np.where(there, self.position, np.nan),
            np.where(there, self.lights, np.nan),
            np.where(keep, self.likeness, np.nan),
            self.joints.between(keep),
        )

    def scaled(self, factor: int) -> Surfaces:
        """In pixels that many times smaller."""
        return Surfaces((self.position + 0.5) * factor - 0.5, self.lights, self.likeness, self.joints)

    def joined(self) -> Surfaces:
        """With joints between all neighbours in the code whose step is like another one beside it: of one surface."""
        held = self.held
        everywhere = Joints(held[:, :-1] & held[:, 1:], held[:-1] & held[1:])
        return Surfaces(self.position, self.lights, self.likeness, sound_joints(self.position, everywhere))
