"""Everything that calibration estimates, and in which column of the derivatives each unknown stands.

A pose changes by R <- exp([w]x) R, t <- t + v; its six unknowns are (w, v). The board is a shallow paraboloid
z = bend . (x^2, x y, y^2): printed boards bow by some tenths of a millimetre, which a tilted view shows as tenths of
a pixel. In each capture the second device's picture may be shifted by hundredths of a pixel, all of it alike.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from retrue.geometry.arrays import FloatArray
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform, rotation_from_vector

INTRINSICS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
POSE = ("rx", "ry", "rz", "tx", "ty", "tz")
BEND = ("xx", "xy", "yy")
BOARD_POSE, SHIFT, OF_VIEW = slice(0, 6), slice(6, 8), 8
"""Columns of a view of its own, and their number: the board's pose, the shift of the second device's picture."""


@dataclass(frozen=True, slots=True)
class Columns:
    """Where each unknown stands: those that all views share, then those of the view of its own.

    Shared: `INTRINSICS` of each device, then `POSE` of the second one if there is one, then `BEND`.

    >>> Columns(2).intrinsic(1, "fx"), Columns(2).pose, Columns(2).bend, Columns(2).board_pose
    (9, slice(18, 24, None), slice(24, 27, None), slice(27, 33, None))
    """

    devices: int

    def intrinsics(self, device: int) -> slice:
        """All of a device."""
        return slice(len(INTRINSICS) * device, len(INTRINSICS) * (device + 1))

    def intrinsic(self, device: int, name: str) -> int:
        """One of them."""
        return self.intrinsics(device).start + INTRINSICS.index(name)

    def pinhole(self, device: int) -> slice:
        """fx, fy, cx, cy."""
        return slice(self.intrinsic(device, "fx"), self.intrinsic(device, "k1"))

    def lens(self, device: int) -> slice:
        """The distortion."""
        return slice(self.intrinsic(device, "k1"), self.intrinsics(device).stop)

    @property
    def pose(self) -> slice:
        """Of the second device."""
        start = self.intrinsics(self.devices).start
        return slice(start, start + len(POSE) * (self.devices - 1))

    @property
    def rotation(self) -> slice:
        """Of the second device."""
        return slice(self.pose.start, self.pose.start + 3)

    @property
    def translation(self) -> slice:
        """Of the second device."""
        return slice(self.pose.start + 3, self.pose.stop)

    @property
    def bend(self) -> slice:
        """Of the board."""
        return slice(self.pose.stop, self.pose.stop + len(BEND))

    @property
    def shared(self) -> int:
        """The number of those that all views share; the view's own begin there."""
        return self.bend.stop

    @property
    def board_pose(self) -> slice:
        """Of the view."""
        return slice(self.shared + BOARD_POSE.start, self.shared + BOARD_POSE.stop)

    @property
    def shift(self) -> slice:
        """Of the view's second picture."""
        return slice(self.shared + SHIFT.start, self.shared + SHIFT.stop)

    @property
    def board(self) -> slice:
        """All that moves points of the board: its bend, and its pose, which follows on it."""
        return slice(self.bend.start, self.board_pose.stop)

    @property
    def all(self) -> int:
        """The number of all."""
        return self.shared + OF_VIEW


@dataclass(frozen=True, slots=True, eq=False)
class Setup:
    """Everything that calibration estimates.

    Attributes
    ----------
    devices : the camera, and the projector or second camera if there is one.
    second_from_first : pose of the second device.
    first_from_board : of each view.
    bend : (3,) of the board, the same in all views; one over its unit of length.
    shifts : (views, 2) of the second device's picture in each view, in pixels.
    """

    devices: tuple[Camera, ...]
    second_from_first: RigidTransform
    first_from_board: tuple[RigidTransform, ...]
    bend: FloatArray
    shifts: FloatArray

    @classmethod
    def started(
        cls,
        devices: tuple[Camera, ...],
        second_from_first: RigidTransform,
        first_from_board: tuple[RigidTransform, ...],
    ) -> Setup:
        """With a flat board, and a projector that stood still."""
        return cls(devices, second_from_first, first_from_board, np.zeros(3), np.zeros((len(first_from_board), 2)))

    @property
    def columns(self) -> Columns:
        """Of the derivatives by it."""
        return Columns(len(self.devices))

    def without(self, view: int) -> Setup:
        """The same, without that view."""
        poses = self.first_from_board[:view] + self.first_from_board[view + 1 :]
        return replace(self, first_from_board=poses, shifts=np.delete(self.shifts, view, axis=0))

    def moved(self, change: FloatArray, own: FloatArray | None = None) -> Setup | None:
        """After a step (shared,), and one of each view's own (views, OF_VIEW); None where it is none.

        A focal length below zero is none.
        """
        columns = self.columns
        devices: list[Camera] = []
        for device, camera in enumerate(self.devices):
            if not change[columns.intrinsics(device)].any():
                devices.append(camera)
                continue
            K, distortion = camera.K.copy(), camera.distortion.copy()
            K[[0, 1, 0, 1], [0, 1, 2, 2]] += change[columns.pinhole(device)]
            distortion[:5] += change[columns.lens(device)]
            if not (K[0, 0] > 0 and K[1, 1] > 0 and np.isfinite(K).all() and np.isfinite(distortion).all()):
                return None
            devices.append(Camera(camera.size, K, distortion))
        second = self.second_from_first
        if len(devices) == 2:
            second = _turned(second, change[columns.pose])
        bend = self.bend + change[columns.bend]
        if own is None:
            return Setup(tuple(devices), second, self.first_from_board, bend, self.shifts)
        pairs = zip(self.first_from_board, own[:, BOARD_POSE], strict=True)
        boards = tuple(_turned(pose, change) for pose, change in pairs)
        return Setup(tuple(devices), second, boards, bend, self.shifts + own[:, SHIFT])


def _turned(pose: RigidTransform, change: FloatArray) -> RigidTransform:
    return RigidTransform(rotation_from_vector(change[:3]) @ pose.R, pose.t + change[3:])
