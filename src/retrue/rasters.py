"""Do picture, pattern and rig belong together? Their sizes tell, before any work, and on which side points are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from retrue.answers import Reason
from retrue.correspondences import Correspondences, require_both_axes, require_each_once
from retrue.errors import CaptureError
from retrue.geometry.arrays import FloatArray
from retrue.geometry.camera import Camera
from retrue.geometry.nearest import nearest_of_all
from retrue.rig import Rig

Size = tuple[int, int]
"""(width, height)."""

MOST_BINNED = 8
MOST_MIRRORED = 0.8
MOST_CORNERS = 1000
FEWEST_TRIANGLES = 12
NEAREST_ZERO = 2.0
"""All points that lie this near to it, in pixels, are none of a raster."""
MOST_OUTSIDE = 0.01
"""Share of the points that may lie beyond the rig's picture where nobody said of which one they are."""


def check_captures(rig: Rig, captures: Sequence[Correspondences]) -> None:
    """`check_rasters` of each, by its place in the list; a pose asks for both projector coordinates, too, and for each
    capture once."""
    named = [(f"captures[{index}]", points) for index, points in enumerate(captures)]
    for name, points in named:
        check_rasters(rig, points, name)
        require_both_axes(points, name)
    require_each_once(named)


def check_rasters(rig: Rig, points: Correspondences, name: str | Path = "points") -> None:
    """Are these points of the rasters that the rig is calibrated for? They may not say of which, but are to be pixels.

    Parameters
    ----------
    name : of the capture, for the message; its file where it has one.

    Raises
    ------
    CaptureError
        of other rasters; says both sizes, and what the difference looks like. Or of points that are no pixels.

    >>> from retrue import Camera, RigidTransform
    >>> camera = Camera((640, 480), [[500, 0, 320], [0, 500, 240], [0, 0, 1]])
    >>> rig = Rig(camera, camera, RigidTransform(np.eye(3), [-100.0, 0, 0]))
    >>> try:
    ...     check_rasters(rig, Correspondences([[9, 9]], [[9, 9]], camera_size=(320, 240)), "wall.csv")
    ... except CaptureError as error:
    ...     print(str(error).partition(";")[0])
    wall.csv: the pictures are 320 x 240, those of the rig's camera 640 x 480: binned by 2
    """
    if points.camera_size is not None:
        check_pictures(rig, points.camera_size, name)
    if points.projector_size is not None:
        check_pattern(rig, points.projector_size, name)
    check_pixels("camera", rig.camera.size, points.camera_px, name, rig.camera)
    check_pixels("projector", rig.projector.size, points.projector_px[:, points.axes], name, rig.projector)


def check_pixels(device: str, size: Size, found: FloatArray, name: str | Path, lens: Camera | None = None) -> None:
    """A `CaptureError` where a device's coordinates are shares of its picture, or its rays, in the place of pixels."""
    if len(found) < FEWEST_TRIANGLES or not np.abs(found).max(initial=0.0) <= NEAREST_ZERO < min(size):
        return
    low, high = float(found.min()), float(found.max())
    shares = low >= 0 and high <= 1
    if shares:
        like = "they look like shares of the picture: hand in pixels, share * size - 0.5"
    elif lens and found.shape[1] == 2 and np.mean(lens.contains(lens.pixels_from_rays(found))) >= 1 - MOST_OUTSIDE:
        like = "they look like rays, normalised by the lens (K^-1): hand in the pixels before that"
    else:
        like = "they look normalised: hand in the pixels before that"
    raise CaptureError(
        name, f"the {device}'s points lie between {low:.2g} and {high:.2g}, in pixels of {_text(size)}; {like}"
    )


def check_extent(rig: Rig, points: Correspondences, name: str | Path = "points") -> None:
    """A `CaptureError` where points that do not say their raster can only be of a larger picture than the rig's.

    For what comes from a file. Pixels count from 0, so that a larger picture puts points beyond the last pixel of the
    rig's, and none before the first; undistorted points leave it on every side, and no larger picture explains them.
    The picture reaches half a pixel beyond the centres of its pixels.
    """
    if points.camera_size is not None or not len(points):
        return
    if bool(np.any(points.camera_px < -0.5)):
        return
    beyond = points.camera_px > np.array(rig.camera.size) - 0.5
    outside = float(np.mean(beyond[:, 0] | beyond[:, 1]))
    if not outside <= MOST_OUTSIDE:
        exchanged = np.mean(rig.camera.contains(points.camera_px[:, ::-1])) >= 1 - MOST_OUTSIDE
        like = "x and y are exchanged, or it is turned by a quarter" if exchanged else "of a picture of another size"
        raise CaptureError(
            name,
            f"{100 * outside:.0f} % of the points lie beyond the last pixel of the rig's picture, "
            f"{_text(rig.camera.size)}, and none before its first: {like}; "
            "take it as for the calibration, or calibrate again",
        )


def check_pictures(rig: Rig, size: Size, name: str | Path) -> None:
    """A `CaptureError` where pictures of that size are not what the rig's camera took."""
    if size != rig.camera.size:
        raise CaptureError(
            name,
            f"the pictures are {_text(size)}, those of the rig's camera {_text(rig.camera.size)}: "
            f"{looks_like(size, rig.camera.size)}; take them as for the calibration, or calibrate again",
        )


def check_pattern(rig: Rig, size: Size, name: str | Path) -> None:
    """A `CaptureError` where a pattern for a projector of that size is not for the rig's."""
    if size != rig.projector.size:
        raise CaptureError(
            name,
            f"the pattern is for a projector of {_text(size)}, the rig's is {_text(rig.projector.size)}: "
            "pattern for another projector; show one of the rig's size, pixel for pixel",
        )


WAYS = (
    "picture is mirrored, left to right",
    "x and y are exchanged, or its picture is mirrored and turned by a quarter",
    "picture is mirrored, top to bottom",
    "picture is mirrored and turned by a quarter",
)
"""What was done to a device's picture, by quarters that it was turned by after it was mirrored left to right."""
EXCHANGED = 1
SETTINGS = {
    "camera": "a driver's setting, or that of whatever showed the picture?",
    "projector": "rear projection, or a ceiling setting?",
}


@dataclass(frozen=True, slots=True)
class PictureMirrored(Reason):
    """A picture is turned over, as no surface shows it that both devices see from one side.

    Whose it is, and by how many quarters it is turned as well, where that is known.
    """

    share: float
    device: str | None = None
    quarters: int = 0

    def __str__(self) -> str:
        run = f"{self.share:.0%} of neighbouring points run the other way round"
        if self.device is None:
            return (
                f"the projector's picture is mirrored, or the camera's: {run}"
                " (rear projection, a ceiling setting, a driver's, or all seen in a mirror?);"
                " switch it off, or x and y of one are exchanged"
            )
        cause, advice = SETTINGS[self.device], "switch it off"
        if self.quarters == EXCHANGED:
            cause, advice = "a table of rows and columns?", "hand in x, which counts columns, first"
        return f"the {self.device}'s {WAYS[self.quarters]}: {run} ({cause}); {advice}"


def picture_mirrored(captures: Sequence[Correspondences]) -> PictureMirrored | None:
    """The reason where most of the points are mirrored; None where they are not."""
    share = mirrored_share(captures)
    return PictureMirrored(share) if share > MOST_MIRRORED else None


def mirrored_share(captures: Sequence[Correspondences]) -> float:
    """How many of the triangles of neighbouring points run the other way round in the projector; 0 of too few.

    Three points of a surface run the same way round in both devices, which see it from the same side: the triangle
    of a point and its two nearest neighbours keeps its sign, but for noise, for wrong points, and across depth jumps.
    """
    kept, seen = 0, 0
    for points in captures:
        areas = _areas(points)
        kept += int(np.count_nonzero(areas > 0))
        seen += int(np.count_nonzero(areas))
    return 1 - kept / seen if seen >= FEWEST_TRIANGLES else 0.0


def _areas(points: Correspondences) -> FloatArray:
    """Of some triangles in the camera times that in the projector: positive where both run the same way round."""
    if len(points) < 3 or len(points.axes) < 2:  # one coordinate cannot tell
        return np.empty(0)
    few = np.linspace(0, len(points) - 1, min(len(points), MOST_CORNERS)).astype(np.int64)
    camera_px, projector_px = points.camera_px[few], points.projector_px[few]
    _, rows = nearest_of_all(camera_px, camera_px, 3)
    areas: list[FloatArray] = []
    for pixels in (camera_px, projector_px):
        (ax, ay), (bx, by), (cx, cy) = pixels[rows].transpose(1, 2, 0)
        areas.append((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))
    return areas[0] * areas[1]


def check_alike(captures: Sequence[tuple[str, Size]]) -> None:
    """A `CaptureError` where captures, by name and size, are not all of the first one's size."""
    for name, size in captures:
        first, usual = captures[0]
        if size != usual:
            raise CaptureError(
                name,
                f"expected pictures of {_text(usual)} as in {first}, found {_text(size)}: "
                f"{looks_like(size, usual)}; one calibration, one picture size",
            )


def looks_like(size: Size, expected: Size) -> str:
    """What became of pictures that are of `size`, and were `expected`.

    >>> looks_like((640, 480), (1280, 960)), looks_like((960, 1280), (1280, 960)), looks_like((1600, 1200), (1280, 960))
    ('binned by 2', 'turned by a quarter', 'of another size')
    """
    (width, height), (full_width, full_height) = size, expected
    for factor in range(2, MOST_BINNED + 1):
        if size == (full_width // factor, full_height // factor):
            return f"binned by {factor}"
        if expected == (width // factor, height // factor):
            return f"no longer binned by {factor}"
    if size == (full_height, full_width):
        return "turned by a quarter"
    if width <= full_width and height <= full_height:
        return "cropped, so that the principal point moved"
    return "of another size"


def _text(size: Size) -> str:
    return f"{size[0]} x {size[1]}"
