"""A printed chessboard before a wall, held one way or another: what a rig is calibrated with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.geometry.arrays import FloatArray
from retrue.geometry.transform import RigidTransform
from retrue.rig import Rig
from retrue.simulation.scene import Scene
from retrue.simulation.surfaces import Paint, Wall

COLUMNS, ROWS = 9, 7
"""Inner corners."""
SHARE_OF_VIEW = 0.62  # of the camera's view at its distance that the board's width takes
TILTS_DEG = 32.0
BLACK = 0.06


@dataclass(frozen=True, slots=True)
class HeldBoard:
    """A chessboard somewhere.

    Attributes
    ----------
    pose : X_camera = R X_board + t; the board's frame begins in its middle, x along a row, z away from the camera.
    square : side of a square, in the rig's unit.
    columns, rows : inner corners.
    """

    pose: RigidTransform
    square: float
    columns: int = COLUMNS
    rows: int = ROWS


@dataclass(frozen=True, slots=True)
class Checkers(Paint):
    """Squares about the origin of the board's frame, the outermost of them black in the corners; white beyond."""

    board: HeldBoard = HeldBoard(RigidTransform(np.eye(3), np.zeros(3)), 1.0)

    def albedo(self, points: FloatArray) -> FloatArray:
        board, pose = self.board, self.board.pose
        at = (points - pose.t) @ pose.R / board.square + (np.array([board.columns, board.rows, 0]) + 1) / 2
        column, row = np.floor(at[..., 0]), np.floor(at[..., 1])
        printed = (column >= 0) & (column <= board.columns) & (row >= 0) & (row <= board.rows)
        black = printed & ((column + row) % 2 == 0)
        return np.where(black[..., None], BLACK, np.asarray(self.color))


def board_square(rig: Rig, distance: float) -> float:
    """Side of a square of the board that is shown at that distance: as large as the camera's view allows."""
    view = distance * rig.camera.size[0] / float(rig.camera.K[0, 0])
    return float(f"{SHARE_OF_VIEW * view / (COLUMNS + 3):.2g}")


def held_board(rig: Rig, distance: float, number: int) -> HeldBoard:
    """The board as it is held the `number`-th time; each time it leans another way, and stands elsewhere."""
    random = np.random.default_rng(number)
    lean = number * 2.4  # radians: the golden angle, so that no two lean alike
    tilt = np.radians(TILTS_DEG) * (0.0 if number == 0 else 0.6 + 0.4 * random.random())
    view = distance * np.array(rig.camera.size) / float(rig.camera.K[0, 0])
    x, y = (random.uniform(-0.09, 0.09, 2) if number else np.zeros(2)) * view
    at = [x, y, distance * (1 + (0.1 * random.uniform(-1, 1) if number else 0.0))]
    pose = RigidTransform.from_rotation_vector([tilt * np.cos(lean), tilt * np.sin(lean), 0.0], at)
    return HeldBoard(pose, board_square(rig, distance))


def board_scene(board: HeldBoard, distance: float, ambient: float) -> Scene:
    """The board before a wall; `distance` is where boards are held, and the wall stands well behind."""
    half = ((board.columns + 3) * board.square / 2, (board.rows + 3) * board.square / 2)
    sheet = Wall(board.pose, half, Checkers((0.85, 0.85, 0.85), board=board))
    return Scene([sheet, Wall.facing(max(1.6 * distance, 1.4 * float(board.pose.t[2])))], (ambient, ambient, ambient))
