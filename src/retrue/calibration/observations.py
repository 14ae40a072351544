"""What calibration is computed from: corners of the board in either device, and dense points on its plane."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from retrue.geometry.arrays import FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class CornerObservations:
    """Known points of the board, seen by one device.

    Attributes
    ----------
    device : 0, the first camera; or 1, the projector or second camera.
    view : (N,) index of the view, ascending.
    board_points : (N, 3) in the board's frame.
    pixels : (N, 2) of that device; NaN in the coordinate that its code has not.
    sigma : (N,) of each, in pixels; only ratios matter.
    """

    device: int
    view: IntArray
    board_points: FloatArray
    pixels: FloatArray
    sigma: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class PlaneObservations:
    """Points somewhere on the board, seen at an exact pixel of the camera and a measured one of the projector.

    One projector coordinate is NaN where the code has not got it.
    """

    view: IntArray
    camera_px: FloatArray
    projector_px: FloatArray
    sigma: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class SceneObservations:
    """Points of the scene around the board: of no known shape, but on their epipolar line."""

    view: IntArray
    camera_px: FloatArray
    projector_px: FloatArray
    sigma: FloatArray


Group = CornerObservations | PlaneObservations | SceneObservations
NO_PIXELS = np.empty((0, 2))


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One pose of the board.

    Attributes
    ----------
    name : of the capture, for messages.
    board_xy : (N, 2) corners in the board's frame, in its unit.
    pixels : one (N, 2) a device, NaN where that device does not know the corner, or has no code of a coordinate.
    sigmas : one (N,) a device, in pixels.
    patch_camera_px, patch_projector_px, patch_sigma : (M, 2), (M, 2), (M,) means of dense points on the board.
    scene_camera_px, scene_projector_px : (L, 2) dense points around the board.
    dense_camera_px, dense_projector_px : (K, 2) dense points on the board, to judge by.
    complete : whether the whole board was found.
    two_pictures : whether the second device's corners were found in a picture of its own, and not from dense points.
    """

    name: str
    board_xy: FloatArray
    pixels: tuple[FloatArray, ...]
    sigmas: tuple[FloatArray, ...]
    patch_camera_px: FloatArray = field(default_factory=lambda: NO_PIXELS)
    patch_projector_px: FloatArray = field(default_factory=lambda: NO_PIXELS)
    patch_sigma: FloatArray = field(default_factory=lambda: np.empty(0))
    scene_camera_px: FloatArray = field(default_factory=lambda: NO_PIXELS)
    scene_projector_px: FloatArray = field(default_factory=lambda: NO_PIXELS)
    dense_camera_px: FloatArray = field(default_factory=lambda: NO_PIXELS)
    dense_projector_px: FloatArray = field(default_factory=lambda: NO_PIXELS)
    complete: bool = True
    two_pictures: bool = False

    def seen(self, device: int) -> IntArray:
        """Indices of the corners that a device knows."""
        return np.flatnonzero(np.isfinite(self.pixels[device]).any(axis=1))


def unknown_axes(views: list[View]) -> list[int]:
    """Coordinates of the second device that no view tells: its code has columns only (1), or rows only (0)."""
    pixels = np.concatenate([view.pixels[1] for view in views])
    return [axis for axis in (0, 1) if not np.isfinite(pixels[:, axis]).any()]


def corner_group(views: list[View], device: int) -> CornerObservations:
    """The corners of all views in one device."""
    rows = [view.seen(device) for view in views]
    return CornerObservations(
        device,
        np.repeat(np.arange(len(views)), [len(seen) for seen in rows]),
        np.concatenate([np.pad(view.board_xy[seen], ((0, 0), (0, 1))) for view, seen in zip(views, rows, strict=True)]),
        np.concatenate([view.pixels[device][seen] for view, seen in zip(views, rows, strict=True)]),
        np.concatenate([view.sigmas[device][seen] for view, seen in zip(views, rows, strict=True)]),
    )


def plane_group(views: list[View]) -> PlaneObservations:
    """The dense points of all views."""
    return PlaneObservations(
        np.repeat(np.arange(len(views)), [len(view.patch_sigma) for view in views]),
        np.concatenate([view.patch_camera_px for view in views]),
        np.concatenate([view.patch_projector_px for view in views]),
        np.concatenate([view.patch_sigma for view in views]),
    )


def scene_group(views: list[View]) -> SceneObservations:
    """The points around the board, of all views."""
    counts = [len(view.scene_camera_px) for view in views]
    return SceneObservations(
        np.repeat(np.arange(len(views)), counts),
        np.concatenate([view.scene_camera_px for view in views]),
        np.concatenate([view.scene_projector_px for view in views]),
        np.ones(sum(counts)),
    )


def observation_groups(views: list[View], dense: bool = True) -> tuple[Group, ...]:
    """What to fit: camera corners, and of the second device the dense points, else its corners.

    Both only of a second camera: a projector corner is itself computed from the dense points around it.
    """
    first = corner_group(views, 0)
    if len(views[0].pixels) == 1:
        return (first,)
    if not (dense and all(len(view.patch_sigma) for view in views)):
        return first, corner_group(views, 1)
    corners = (corner_group(views, 1),) if all(view.two_pictures for view in views) else ()
    scene = (group,) if len((group := scene_group(views)).view) else ()
    return (first, *corners, plane_group(views), *scene)
