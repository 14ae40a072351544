"""What the decoder of a colour grid saw, step by step, drawn over the photograph."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from retrue.decoding.blocks.sight import GridSight, Verdict
from retrue.geometry.arrays import FloatArray
from retrue.report.pictures import blank_figure, png_bytes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

REASON_COLORS = ("tab:green", "tab:gray", "tab:orange", "tab:purple", "tab:red", "tab:blue")
WIDTH = 14.0  # inches
DOTS = 100  # an inch


def grid_pictures(sight: GridSight) -> dict[str, bytes]:
    """PNG bytes by name: blocks, links, colours, decoded and rejected, in the order in which the decoder works."""
    steps: dict[str, Callable[[Any, GridSight], None]] = {
        "1-blocks": _draw_blocks,
        "2-links": _draw_links,
        "3-colours": _draw_colors,
        "4-decoded": _draw_decoded,
        "5-rejected": _draw_rejected,
    }
    return {name: _over_photograph(sight, draw) for name, draw in steps.items()}


def _draw_blocks(axis: Axes, sight: GridSight) -> None:
    """Each blob as the parallelogram's ellipse that its second moments make of it."""
    from matplotlib.collections import EllipseCollection

    blocks = sight.blocks
    if len(blocks):
        values, vectors = np.linalg.eigh(blocks.shape)
        axes = 4 * np.sqrt(np.maximum(values, 0)) * 2**sight.halvings
        angle = np.degrees(np.arctan2(vectors[:, 1, 1], vectors[:, 0, 1]))
        axis.add_collection(
            EllipseCollection(
                axes[:, 1],
                axes[:, 0],
                angle,
                units="xy",
                offsets=_centres(sight),
                transOffset=axis.transData,
                facecolors="none",
                edgecolors="tab:red",
            )
        )
    axis.set_title(f"{len(blocks)} blobs")


def _draw_links(axis: Axes, sight: GridSight) -> None:
    from matplotlib.collections import LineCollection

    start, direction = np.nonzero(sight.links.neighbour >= 0)
    end = sight.links.neighbour[start, direction]
    once = start < end
    centre = _centres(sight)
    lines = np.stack([centre[start[once]], centre[end[once]]], axis=1)
    axis.add_collection(LineCollection(list(lines), colors="tab:cyan", linewidths=0.8))
    axis.set_title(f"{len(lines)} links")


def _draw_colors(axis: Axes, sight: GridSight) -> None:
    """The colour that each blob was taken for."""
    palette = np.asarray(sight.pattern.colors) / 255
    x, y = _centres(sight).T
    axis.scatter(x, y, c=palette[sight.label], s=18, edgecolors="black", linewidths=0.4)
    axis.set_title("colours")


def _draw_decoded(axis: Axes, sight: GridSight) -> None:
    """Centres by column, lighter with every row; the outline joins what is joined in the code."""
    row, column = np.nonzero(np.isfinite(sight.centre_px[..., 0]))
    x, y = sight.centre_px[row, column].T
    axis.scatter(x, y, c=(column * 7 + row * 3) % 20, cmap="tab20", s=10)
    for r, c, px, py in zip(row, column, x, y, strict=True):
        if r % 5 == 0 and c % 5 == 0:
            axis.annotate(f"{r},{c}", (px, py), color="white", fontsize=6)
    axis.set_title(f"{len(row)} blocks decoded (row, column)")


def _draw_rejected(axis: Axes, sight: GridSight) -> None:
    centre = _centres(sight)
    for verdict, color in zip(Verdict, REASON_COLORS, strict=True):
        here = sight.verdict == verdict
        if here.any():
            x, y = centre[here].T
            size = 2 if verdict == Verdict.DECODED else 14
            axis.scatter(x, y, s=size, color=color, label=f"{verdict.reason}: {int(here.sum())}")
    if len(centre):
        axis.legend(loc="upper right", fontsize=8)
    axis.set_title("what became of the blobs")


def _centres(sight: GridSight) -> FloatArray:
    return (sight.blocks.centre + 0.5) * 2**sight.halvings - 0.5


def _over_photograph(sight: GridSight, draw: Callable[[Any, GridSight], None]) -> bytes:
    height, width = sight.picture.shape[:2]
    figure = blank_figure(WIDTH, WIDTH * height / width + 0.4)
    axis: Any = figure.subplots()
    full = np.iinfo(sight.picture.dtype).max
    axis.imshow(sight.picture / full, alpha=0.5 if draw is not _draw_blocks else 1.0)
    axis.set_axis_off()
    draw(axis, sight)
    return png_bytes(figure, DOTS)
