"""Pictures of what was found, and of how a rig moved over time, as PNG bytes; need the extra `.[plot]`."""

from __future__ import annotations

import io
import zlib
from collections.abc import Sequence
from datetime import datetime
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np

from retrue.correspondences import Correspondences, require_points
from retrue.errors import InputError, in_brief, require_kinds
from retrue.geometry.arrays import FloatArray, Image, require_picture
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.reconstruction.cloud import Cloud, require_cloud
from retrue.report.figures import every
from retrue.report.scene import FRUSTUM_SHARE
from retrue.rig import Rig, require_rig
from retrue.rig_difference import RigDifference

if TYPE_CHECKING:
    from matplotlib.figure import Figure


MOST_SCATTERED = 20_000  # drawn; more only blacken the picture


def residual_picture(image: Image, points: Correspondences, residuals: Sequence[tuple[str, FloatArray]]) -> bytes:
    """The photograph once per (title, residuals (N,) in pixels), its points coloured by their size.

    All share one scale, from 0.03 px to 30 px in powers of ten, so that before and after can be compared by eye.
    Raises `InputError` where matplotlib is not installed.
    """
    require_picture(image, "image")
    require_points(points)
    require_kinds(residuals, tuple, "residuals")
    if not residuals or any(len(entry) != 2 or np.shape(entry[1]) != (len(points),) for entry in residuals):
        raise InputError(f"residuals: expected (title, {len(points)} residuals) each, found {in_brief(residuals)}")
    require_matplotlib("pictures")
    from matplotlib.colors import LogNorm

    figure = blank_figure(6.4 * len(residuals), 5.2)
    rows = every(len(points), MOST_SCATTERED)
    photograph = image / np.iinfo(image.dtype).max
    drawn: Any = None
    axes: Any = figure.subplots(1, len(residuals), squeeze=False)[0]
    for axis, (title, residual) in zip(axes, residuals, strict=True):
        axis.imshow(photograph, cmap="gray", vmin=0, vmax=1, alpha=0.6)
        size = np.clip(np.abs(residual[rows]), 0.03, 30)
        x, y = points.camera_px[rows].T
        drawn = axis.scatter(x, y, c=size, s=5, cmap="turbo", norm=LogNorm(0.03, 30))
        axis.set_title(title)
        axis.set_axis_off()
    figure.colorbar(drawn, ax=axes, label="distance of the two rays, pixels", shrink=0.8)
    return png_bytes(figure)


def cloud_picture(cloud: Cloud, rig: Rig) -> bytes:
    """The cloud from above and from the side, with the camera and the projector that made it.

    Raises `InputError` where matplotlib is not installed.
    """
    require_cloud(cloud)
    require_rig(rig)
    figure = blank_figure(12.0, 5.2)
    rows = every(len(cloud), MOST_SCATTERED)
    X, colors = cloud.points[rows], cloud.colors[rows] / 255
    depth = float(np.median(X[:, 2]))
    axes: Any = figure.subplots(1, 2)
    for axis, across, title in ((axes[0], 0, "from above"), (axes[1], 1, "from the side")):
        axis.scatter(X[:, 2], X[:, across], c=colors, s=3)
        projector = rig.projector_from_camera.inverse()
        for camera, pose, name, color in (
            (rig.camera, RigidTransform.identity(), "camera", "tab:blue"),
            (rig.projector, projector, "projector", "tab:orange"),
        ):
            outline = _frustum(camera, pose, FRUSTUM_SHARE * depth)
            axis.plot(outline[:, 2], outline[:, across], color=color, label=name)
        axis.set_aspect("equal")
        axis.invert_yaxis()
        axis.set_xlabel(f"z, {cloud.unit}")
        axis.set_ylabel(f"{'xy'[across]}, {cloud.unit}")
        axis.set_title(title)
        axis.grid(alpha=0.3)
    axes[0].legend()
    return png_bytes(figure)


def _frustum(camera: Camera, camera_frame_from_device: RigidTransform, length: float) -> FloatArray:
    """A line (., 3) from the centre through the corners of the picture, in the camera frame."""
    a, b, c, d = camera.frustum(length)
    centre = np.zeros(3)
    return camera_frame_from_device.apply(np.array([centre, a, b, centre, c, d, centre, b, c, d, a]))


def has_matplotlib() -> bool:
    """Whether pictures can be drawn."""
    return find_spec("matplotlib") is not None


def require_matplotlib(what: str) -> None:
    """An `InputError` that says what cannot be drawn and names the extra, where matplotlib is not installed."""
    if not has_matplotlib():
        raise InputError(f"{what}: drawn by matplotlib, which is not installed: pip install '.[plot]'")


def blank_figure(width: float, height: float) -> Figure:
    """A figure of that size in inches, on no screen."""
    require_matplotlib("pictures")
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def png_bytes(figure: Figure, dpi: float = 110) -> bytes:
    """The figure as a PNG file. Runs alone make it as small as all of zlib does, in a fifth of the time."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=dpi, pil_kwargs={"compress_type": zlib.Z_RLE})
    return stream.getvalue()


def drift_picture(times: Sequence[datetime], since_first: Sequence[RigDifference]) -> bytes:
    """Rotation and direction of t away from the first rig, each held until the next one took its place."""
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

    figure = blank_figure(8.0, 4.0)
    axis: Any = figure.subplots()
    for label, values in (
        ("rotation", [difference.rotation_deg for difference in since_first]),
        ("direction of t", [difference.translation_deg for difference in since_first]),
    ):
        axis.step(times, values, where="post", marker="o", label=label)
    locator = AutoDateLocator()
    axis.xaxis.set_major_locator(locator)
    axis.xaxis.set_major_formatter(ConciseDateFormatter(locator))
    axis.set_xlabel("time, UTC")
    axis.set_ylabel("drift since the first entry, deg")
    axis.set_ylim(bottom=0)
    axis.grid(alpha=0.3)
    axis.legend()
    return png_bytes(figure)
