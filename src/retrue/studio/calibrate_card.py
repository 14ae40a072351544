"""The part of a tab that calibrates: the board's name, where it has been, and what came out."""

from __future__ import annotations

from typing import Any

from retrue.calibration.board import HOW
from retrue.calibration.result import Calibrated
from retrue.studio.calibrating import AIM, FEWEST, Progress, result_rows
from retrue.studio.drawings import raster
from retrue.studio.state import State
from retrue.studio.studio import Studio

EXAMPLE_BOARD = "chessboard:9x7:29mm"
GOOD, BAD = "text-green-8", "text-orange-9"  # dark enough on white, and light enough on black
RASTERS = (("camera", "camera_cells"), ("projector", "projector_cells"))


class CalibrateCard:
    """Before a calibration, a field and a button; while it goes on, all that there is to see of it."""

    def __init__(self, ui: Any, studio: Studio) -> None:
        self._studio, self._shown = studio, None
        with ui.row().classes("w-full gap-2 items-center") as self._before:
            self._board = ui.input("board", value=studio.begun or EXAMPLE_BOARD).classes("grow")
            self._board.tooltip(HOW)
            self._start = ui.button("Calibrate", on_click=lambda: studio.calibrate(self._board.value or ""))
        with ui.card().classes("w-full gap-2") as self._card:
            self._title = ui.label().classes("text-lg")
            with ui.row().classes("w-full gap-4 no-wrap"):
                self._rasters = {name: self._raster(ui, name) for name, _ in RASTERS}
            self._result = ui.column().classes("w-full gap-1")
            with ui.row().classes("gap-2"):
                self._fit = ui.button("Calibrate now", on_click=studio.fit).props("outline")
                self._more = ui.button("Add poses", on_click=studio.add_poses).props("outline")
                self._again = ui.button("Start over", on_click=studio.start_over).props("outline")
                self._leave = ui.button("Leave", on_click=studio.leave).props("outline")
        self._ui = ui

    def refresh(self, state: State) -> None:
        """Show what is now."""
        progress = state.calibration
        self._before.set_visibility(progress is None)
        self._card.set_visibility(progress is not None)
        self._start.set_enabled(state.look is not None and not state.busy)
        self._start.props(**{"add" if state.rig_there else "remove": "outline"})
        if progress is None or progress is self._shown:
            return
        if self._shown is None or progress.result is not self._shown.result:
            self._show_result(progress)
        if self._shown is None or progress.poses != self._shown.poses:
            for name, cells in RASTERS:
                self._rasters[name].set_content(raster(name, getattr(progress, cells)))
        self._shown = progress
        self._title.set_text(f"{progress.board}: {progress.poses} of {AIM} poses")
        self._fit.set_enabled(progress.poses >= FEWEST and progress.result is None and not state.busy)
        self._more.set_enabled(progress.result is not None and not state.busy)

    def _raster(self, ui: Any, name: str) -> Any:
        with ui.column().classes("grow basis-0 gap-1"):
            ui.label(f"{name}'s picture")
            return ui.html("", sanitize=False).classes("w-full")

    def _show_result(self, progress: Progress) -> None:
        """What came out, what is uncertain, and what to add."""
        result = progress.result
        self._result.clear()
        if result is None:
            return
        good = isinstance(result, Calibrated)
        with self._result:
            headline = self._ui.label(f"{'calibrated' if good else 'refused'}: {result.reason}")
            headline.classes(f"font-medium {GOOD if good else BAD}")
            for name, words in result_rows(result).items():
                self._ui.label(f"{name}: {words}")
            for advice in result.evidence.get("advice", ()):
                self._ui.label(f"to do better: {advice}").classes(BAD)
