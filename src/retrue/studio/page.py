"""One browser tab of the studio: the live picture and a sentence in big letters; beside it, what can be done."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from retrue.calibration.result import Calibrated
from retrue.studio.calibrate_card import BAD, GOOD, CalibrateCard
from retrue.studio.drawings import dots, drift_plot, outlines
from retrue.studio.look import Look
from retrue.studio.state import State
from retrue.studio.studio import NO_RIG, REFRESH, Studio

SPACE = "width:100%;height:480px;border:0"
METERS = ("light", "clipping", "focus", "stillness", "blocks")


class Page:
    """Builds the tab, and renews what it shows."""

    def __init__(self, ui: Any, studio: Studio) -> None:
        self._ui, self._studio, self._seen, self._cloud_shown, self._plotted = ui, studio, -1, None, -1
        self._shown = 0
        with ui.column().classes("w-full max-w-6xl mx-auto p-2 gap-3"):
            self._sentence = ui.label("opening the devices").classes("text-3xl font-medium").props('aria-live="polite"')
            with ui.row().classes("w-full gap-4 items-start"):
                with ui.column().classes("grow basis-80 min-w-0 gap-2"):
                    self._image = ui.interactive_image().classes("w-full").props('alt="live picture"')
                    self._meters = {name: _meter(ui, name) for name in METERS}
                with ui.column().classes("grow basis-80 min-w-0 gap-2"):
                    self._buttons(ui, studio)
                    self._message = ui.label().classes("text-lg").props('role="status"')
                    self._calibrate = CalibrateCard(ui, studio)
                    with ui.column().classes("w-full gap-2") as self._clouds:
                        self._caption = ui.label()
                        self._space = ui.html("", sanitize=False).classes("w-full")
                    self._plot = ui.html("", sanitize=False).classes("w-full")
        self._refresh()
        ui.timer(REFRESH, self._refresh)

    def _buttons(self, ui: Any, studio: Studio) -> None:
        with ui.row().classes("gap-2"):
            self._check = ui.button("Check", on_click=studio.check)
            self._keep = ui.button("Keep", on_click=studio.keep)
            self._undo = ui.button("Undo", on_click=studio.undo).props("outline")
            self._scan = ui.button("Scan", on_click=studio.scan).props("outline")
        self._watch = ui.switch("Watch", value=studio.state.watching)
        self._watch.on("click", lambda: studio.watch(not studio.state.watching))
        if studio.simulated:
            with ui.row().classes("gap-2 items-center"):
                degrees = ui.number("bump, degrees", value=3.0, min=-20, max=20, step=0.5).classes("w-36")
                ui.button("Bump", on_click=_bump(studio, degrees)).props("outline")

    def _refresh(self) -> None:
        state = self._studio.state
        look = state.look
        if look is None:
            self._sentence.set_text(state.message or "opening the devices")
        elif state.number != self._seen:
            self._seen = state.number
            self._show_look(state, look)
        idle = "" if state.rig_there or state.calibration else NO_RIG
        self._message.set_text(f"{state.busy} ..." if state.busy else state.message or idle)
        self._message.classes(**{"add" if state.drifted else "remove": f"{BAD} font-medium"})
        self._enable(state)
        self._calibrate.refresh(state)
        self._watch.set_value(state.watching)
        shown = state.offer if state.offer is not None else state.cloud
        self._clouds.set_visibility(shown is not None)
        if shown is not self._cloud_shown:
            self._cloud_shown = shown
            self._show_clouds()
        self._plot.set_visibility(bool(state.watching or state.readings) and state.calibration is None)
        if len(state.readings) and state.readings[-1].at != self._plotted:
            self._plotted = state.readings[-1].at
            self._plot.set_content(drift_plot(state.readings, self._studio.unit))

    def _enable(self, state: State) -> None:
        free = state.look is not None and not state.busy
        looking = free and state.calibration is None
        calibrated = state.calibration is not None and isinstance(state.calibration.result, Calibrated)
        self._check.set_enabled(looking and state.rig_there)
        self._scan.set_enabled(looking and state.rig_there)
        self._keep.set_enabled(free and (state.offer is not None or calibrated))
        self._undo.set_enabled(looking and (state.rig_there or state.offer is not None))
        self._watch.set_enabled(looking and (state.rig_there or state.watching))

    def _show_look(self, state: State, look: Look) -> None:
        self._sentence.set_text(look.sentence)
        self._sentence.classes(add=GOOD if look.good else BAD, remove=BAD if look.good else GOOD)
        self._image.set_source(f"/frame.jpg?{self._seen}")
        progress = state.calibration
        self._image.set_content(dots(look) if progress is None else outlines(progress, look.picture.shape[1]))
        for name, (row, meter) in self._meters.items():
            row.set_visibility(name in look.meters)
            meter.set_value(round(look.meters.get(name, 0.0), 2))

    def _show_clouds(self) -> None:
        """The last scan; or, while a rig is offered, what the capture looks like with the old rig and the new."""
        offer, cloud = self._studio.state.offer, self._studio.state.cloud
        known = "" if cloud is None else f"{len(cloud)} points"
        if offer is not None:
            known = "left: with the rig as it is in the file; right: with the new rig"
        self._caption.set_text(known)
        self._shown += 1  # another address, so that the browser asks again
        frame = f'<iframe src="/space?{self._shown}" title="points in space" style="{SPACE}"></iframe>' if known else ""
        self._space.set_content(frame)


def _meter(ui: Any, name: str) -> tuple[Any, Any]:
    with ui.row().classes("w-full items-center gap-2 no-wrap") as row:
        ui.label(name).classes("w-24")
        return row, ui.linear_progress(0, show_value=False, size="12px").props(f'aria-label="{name}"')


def _bump(studio: Studio, degrees: Any) -> Callable[[], None]:
    return lambda: studio.bump(float(degrees.value or 0.0))
