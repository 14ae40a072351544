"""Line charts, as SVG and PNG."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Protocol, cast

from retrue.report.pictures import blank_figure, require_matplotlib

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMNS = 3
MARKERS = "osv^D<>PX*"
OWN_LEGEND = 4  # lines up to which each set of axes has its own; else one for all, below


class LineLike(Protocol):
    """One curve; `error` is half the length of the error bars."""

    @property
    def label(self) -> str: ...
    @property
    def x(self) -> Sequence[float]: ...
    @property
    def y(self) -> Sequence[float]: ...
    @property
    def error(self) -> Sequence[float] | None: ...


class PanelLike(Protocol):
    """One set of axes."""

    @property
    def title(self) -> str: ...
    @property
    def x_label(self) -> str: ...
    @property
    def y_label(self) -> str: ...
    @property
    def lines(self) -> Sequence[LineLike]: ...
    @property
    def log_x(self) -> bool: ...
    @property
    def log_y(self) -> bool: ...


def line_charts(panels: Sequence[PanelLike]) -> dict[str, bytes]:
    """The panels side by side, under "svg" and "png"; the same panels give the same bytes."""
    require_matplotlib("charts")
    import matplotlib

    with cast("Any", matplotlib).rc_context({"svg.hashsalt": "retrue", "svg.fonttype": "none"}):
        figure = _drawn(panels)
        return {kind: _saved(figure, kind) for kind in ("svg", "png")}


def _drawn(panels: Sequence[PanelLike]) -> Figure:
    columns = min(COLUMNS, len(panels))
    rows = -(-len(panels) // columns)
    figure = blank_figure(4.6 * columns, 3.6 * rows + 1.2)
    axes: Any = figure.subplots(rows, columns, squeeze=False).ravel()
    labels = list(dict.fromkeys(line.label for panel in panels for line in panel.lines))
    shown: dict[str, Any] = {}
    for axis, panel in zip(axes, panels, strict=False):
        for line in panel.lines:
            k = labels.index(line.label)  # looks the same on all axes
            style = {"marker": MARKERS[k % len(MARKERS)], "color": f"C{k % 10}", "linestyle": ("-", "--")[k // 10 % 2]}
            shown[line.label] = axis.errorbar(
                line.x, line.y, line.error, label=line.label, markersize=4, linewidth=1, **style
            )
        axis.set_title(panel.title, fontsize=10)
        axis.set_xlabel(panel.x_label)
        axis.set_ylabel(panel.y_label)
        if panel.log_x:
            axis.set_xscale("log")
        if panel.log_y:
            axis.set_yscale("log")
        axis.grid(alpha=0.3)
    for axis in axes[len(panels) :]:
        axis.set_axis_off()
    if len(labels) > OWN_LEGEND:
        figure.legend([shown[label] for label in labels], labels, loc="outside lower center", ncols=3, fontsize=8)
    else:
        for axis in axes[: len(panels)]:
            axis.legend(fontsize=8)
    return figure


def _saved(figure: Figure, kind: str) -> bytes:
    stream = io.BytesIO()
    figure.savefig(stream, format=kind, dpi=110, metadata={"Date": None} if kind == "svg" else None)
    return stream.getvalue()
