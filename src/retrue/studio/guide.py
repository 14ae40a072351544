"""Where to hold the board next: of many ways to hold it, the one that shows most of what no pose has shown yet.

What a pose shows has four parts, each from 0 to 1: cells of the camera's picture that had no board, cells of the
projector's, an angle that no board had, and a distance that none had. Nothing is calibrated yet, so the camera is taken
for one of a usual lens: good enough to say "tilt it more", and nothing else rests on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from retrue.calibration.board import Board
from retrue.calibration.detection import BoardCorners
from retrue.errors import DegenerateError, InputError
from retrue.geometry.arrays import FloatArray
from retrue.geometry.homography import apply_homography, fit_homography
from retrue.geometry.transform import RigidTransform, nearest_rotation, rotation_from_vector

CELLS = (8, 6)
"""Columns and rows in which both pictures are counted."""
USUAL_FOCAL = 1.2  # of the picture's width
NEW_ANGLE = np.radians(30.0)  # to the nearest pose, from which on its angle is all new
NEW_DISTANCE = 0.2  # of the distance, likewise
TILT = np.radians(35.0)
LEANS = 8  # directions
PLACES = (0.32, 0.5, 0.68)  # of the picture, where the board's middle may be
SIZES = (0.42, 0.55)  # of the picture's width or height that the board takes, whichever is more
WORTH = 0.6  # of what the wished pose shows: who holds the board need not be exact
CLOSE_ANGLE, CLOSE_PLACE, CLOSE_SIZE = np.radians(12.0), 0.06, 0.12


@dataclass(frozen=True, slots=True, eq=False)
class SeenBoard:
    """One way to hold the board.

    Attributes
    ----------
    pose : X_camera = R X_board + t, for a usual lens; the board's frame begins in its middle.
    camera_px : (N, 2) points of the board in the camera's picture.
    projector_px : (M, 2) the same in the projector's, or some of them; empty where that is not known.
    """

    pose: RigidTransform
    camera_px: FloatArray
    projector_px: FloatArray

    @property
    def normal(self) -> FloatArray:
        return self.pose.R[:, 2]


@dataclass(frozen=True)
class Guide:
    """What was seen, and so what to ask for.

    Attributes
    ----------
    board : its corners as a plan.
    camera_size, projector_size : (width, height).
    taken : the poses so far.
    """

    board: Board
    camera_size: tuple[int, int]
    projector_size: tuple[int, int]
    taken: tuple[SeenBoard, ...] = ()

    @cached_property
    def K(self) -> FloatArray:
        width, height = self.camera_size
        focal = USUAL_FOCAL * width
        return np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])

    @cached_property
    def plan(self) -> FloatArray:
        """(N, 2) the board's points about its middle."""
        points = self.board.points
        return points - 0.5 * (points.min(axis=0) + points.max(axis=0))

    def seen(self, corners: BoardCorners, projector_px: FloatArray | None = None) -> SeenBoard | None:
        """How it is held; None where its corners tell no pose. Without `projector_px`, those are guessed."""
        xy = corners.board_xy
        xy = xy - 0.5 * (xy.min(axis=0) + xy.max(axis=0))
        try:
            columns = np.linalg.inv(self.K) @ fit_homography(xy, corners.pixels, source_sigma=0.0)
            columns = columns * (np.sign(columns[2, 2]) / np.sqrt(np.prod(np.linalg.norm(columns[:, :2], axis=0))))
            x, y, t = (np.asarray(column, dtype=np.float64) for column in columns.T)
            pose = RigidTransform(nearest_rotation(np.column_stack([x, y, np.cross(x, y)])), t)
        except (DegenerateError, InputError):
            return None
        return SeenBoard(pose, corners.pixels, self._guessed(corners.pixels) if projector_px is None else projector_px)

    @cached_property
    def wish(self) -> SeenBoard:
        """The pose that shows most of what is new."""
        return max(self._candidates, key=self.gain)

    def gain(self, pose: SeenBoard) -> float:
        """How much that pose shows which none has shown: 0 to 4."""
        cells = sum(
            len(cells_of(getattr(pose, name), size) - self.covered(name)) / (CELLS[0] * CELLS[1])
            for name, size in (("camera_px", self.camera_size), ("projector_px", self.projector_size))
        )
        angle, distance = NEW_ANGLE, NEW_DISTANCE
        for other in self.taken:
            angle = min(angle, float(np.arccos(np.clip(pose.normal @ other.normal, -1, 1))))
            distance = min(distance, abs(float(np.log(pose.pose.t[2] / other.pose.t[2]))))
        return cells + angle / NEW_ANGLE + distance / NEW_DISTANCE

    def covered(self, name: str) -> set[int]:
        """Cells of "camera_px" or "projector_px" in which some pose had the board."""
        size = self.camera_size if name == "camera_px" else self.projector_size
        return {cell for pose in self.taken for cell in cells_of(getattr(pose, name), size)}

    def is_worth(self, pose: SeenBoard) -> bool:
        """Whether it shows nearly as much as the wished one."""
        return self.gain(pose) >= WORTH * self.gain(self.wish)

    def advice(self, pose: SeenBoard) -> str:
        """The largest step from that pose to the wished one, in words."""
        wish, width = self.wish, self.camera_size[0]
        ways: list[tuple[float, str]] = []
        lean = wish.normal - pose.normal
        angle = float(np.arccos(np.clip(pose.normal @ wish.normal, -1, 1)))
        ways.append((angle / CLOSE_ANGLE, self._tilt_in_words(lean[:2], wish)))
        x, y = (wish.camera_px.mean(axis=0) - pose.camera_px.mean(axis=0)) / width
        side = ("right" if x > 0 else "left") if abs(x) > abs(y) else ("down" if y > 0 else "up")
        ways.append((float(np.hypot(x, y)) / CLOSE_PLACE, f"move it {side} in the picture"))
        nearer = float(np.log(pose.pose.t[2] / wish.pose.t[2]))
        ways.append((abs(nearer) / CLOSE_SIZE, "hold it nearer" if nearer > 0 else "hold it farther away"))
        return max(ways)[1]

    @staticmethod
    def _tilt_in_words(lean: FloatArray, wish: SeenBoard) -> str:
        """A normal, which points away, that moves to the right: the right edge comes nearer."""
        if wish.normal[2] > np.cos(CLOSE_ANGLE):
            return "hold it flat towards the camera"
        if abs(lean[0]) > abs(lean[1]):
            return f"tilt it more: its {'right' if lean[0] < 0 else 'left'} edge away from the camera"
        return f"tilt it more: its {'lower' if lean[1] < 0 else 'upper'} edge away from the camera"

    @cached_property
    def _candidates(self) -> Sequence[SeenBoard]:
        span = np.ptp(self.plan, axis=0)
        size = np.array(self.camera_size, dtype=float)
        leans = [np.zeros(3)] + [
            TILT * np.array([np.cos(turn), np.sin(turn), 0.0]) for turn in np.arange(LEANS) * 2 * np.pi / LEANS
        ]
        poses: list[SeenBoard] = []
        for share, x, y, lean in product(SIZES, PLACES, PLACES, leans):
            distance = float((span * self.K[0, 0] / (share * size)).max())
            middle = np.linalg.inv(self.K) @ np.array([x * (size[0] - 1), y * (size[1] - 1), 1.0])
            pose = RigidTransform(rotation_from_vector(lean), np.asarray(distance * middle, dtype=np.float64))
            points = pose.apply(np.column_stack([self.plan, np.zeros(len(self.plan))]))
            camera_px = points @ self.K.T
            camera_px = camera_px[:, :2] / camera_px[:, 2:]
            margin = 1.6 * self.board.spacing * self.K[0, 0] / distance  # its outer squares, and some white
            if (camera_px >= margin).all() and (camera_px <= size - 1 - margin).all():
                poses.append(SeenBoard(pose, camera_px, self._guessed(camera_px)))
        return poses

    def _guessed(self, camera_px: FloatArray) -> FloatArray:
        """Where the projector would light these: as the homography of the pose taken last would have it, roughly."""
        if not self._map:
            return np.empty((0, 2))
        return apply_homography(self._map[0], camera_px)

    @cached_property
    def _map(self) -> tuple[FloatArray, ...]:
        matched = [pose for pose in self.taken if len(pose.projector_px) == len(pose.camera_px)]
        known = [np.isfinite(pose.projector_px).all(axis=1) for pose in matched]
        if not matched or sum(map(np.sum, known)) < 8:
            return ()
        camera_px = np.concatenate([pose.camera_px[good] for pose, good in zip(matched, known, strict=True)])
        projector_px = np.concatenate([pose.projector_px[good] for pose, good in zip(matched, known, strict=True)])
        try:
            return (fit_homography(camera_px, projector_px),)
        except DegenerateError:
            return ()


def cells_of(pixels: FloatArray, size: tuple[int, int]) -> set[int]:
    """Those of `CELLS` in which there are some of these pixels (N, 2).

    >>> sorted(cells_of(np.array([[0.0, 0.0], [639.0, 479.0], [-9.0, 0.0]]), (640, 480)))
    [0, 47]
    """
    place = (pixels + 0.5) / np.array(size)
    place = place[((place >= 0) & (place < 1)).all(axis=1)]
    return set(((place * CELLS).astype(int) @ [1, CELLS[0]]).tolist())
