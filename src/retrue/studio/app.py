"""The studio's page, through NiceGUI: the live picture, what the decoder sees over it, one sentence, and buttons."""

from __future__ import annotations

import socket
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

import numpy as np

from retrue.errors import InputError
from retrue.files.images import jpeg
from retrue.reconstruction.cloud import Cloud
from retrue.studio.guard import Guard
from retrue.studio.look import Look
from retrue.studio.studio import Studio

HOST = "127.0.0.1"
REFRESH = 0.25  # seconds
MOST_DOTS = 600
MOST_POINTS = 20_000
SCENE = 340, 280  # pixels: what fits a telephone
VIEW = 4.0  # units of the scene that a cloud is scaled to
GOOD, BAD = "text-positive", "text-warning"


def require_nicegui() -> Any:
    """NiceGUI; an `InputError` that names the extra, where it is not installed."""
    try:
        return import_module("nicegui")
    except ImportError as error:
        raise InputError("the studio needs nicegui: pip install 'retrue[studio]'") from error


def require_free_port(port: int) -> None:
    """An `InputError` where something listens there already."""
    try:
        with socket.create_server((HOST, port)):
            pass
    except (OSError, OverflowError) as error:
        raise InputError(f"cannot listen on {HOST}:{port}: {error}; choose another --port") from error


def serve(studio: Studio, token: str, port: int) -> None:
    """Until it is interrupted; only who has the token is let in."""
    nicegui = require_nicegui()
    app, ui = nicegui.app, nicegui.ui
    responses = import_module("starlette.responses")
    app.add_middleware(Guard, token=token, port=port)

    @app.get("/frame.jpg")
    def frame() -> Any:
        look = studio.state.look
        headers = {"Cache-Control": "no-store"}
        if look is None:
            return responses.Response(status_code=404, headers=headers)
        return responses.Response(jpeg(look.picture), media_type="image/jpeg", headers=headers)

    @ui.page("/", title="retrue studio")
    def page() -> None:
        _Page(ui, studio)

    app.on_startup(studio.start)
    app.on_shutdown(studio.stop)
    ui.run(
        host=HOST,
        port=port,
        title="retrue studio",
        dark=None,
        reload=False,
        show=False,
        show_welcome_message=False,
        uvicorn_logging_level="error",
    )


class _Page:
    """One browser tab."""

    def __init__(self, ui: Any, studio: Studio) -> None:
        self._ui, self._studio, self._seen, self._cloud_shown = ui, studio, -1, None
        with ui.column().classes("w-full max-w-6xl mx-auto p-2 gap-3"):
            self._sentence = ui.label("opening the devices").classes("text-3xl font-medium").props('aria-live="polite"')
            with ui.row().classes("w-full gap-4 items-start"):
                with ui.column().classes("grow basis-80 min-w-0 gap-2"):
                    self._image = ui.interactive_image().classes("w-full").props('alt="live picture"')
                    self._meters = {name: _meter(ui, name) for name in ("light", "clipping", "stillness", "blocks")}
                with ui.column().classes("grow basis-80 min-w-0 gap-2"):
                    self._buttons(ui, studio)
                    self._message = ui.label().classes("text-lg").props('role="status"')
                    self._blend = ui.slider(min=0, max=1, step=1, value=1).props('aria-label="before or after"')
                    self._blend.on_value_change(self._show_clouds)
                    self._caption = ui.label()
                    self._scene = ui.scene(width=SCENE[0], height=SCENE[1], grid=False, background_color="#30343a")
        self._refresh()
        ui.timer(REFRESH, self._refresh)

    def _buttons(self, ui: Any, studio: Studio) -> None:
        with ui.row().classes("gap-2"):
            self._check = ui.button("Check", on_click=studio.check)
            self._keep = ui.button("Keep", on_click=studio.keep)
            self._undo = ui.button("Undo", on_click=studio.undo).props("outline")
            self._scan = ui.button("Scan", on_click=studio.scan).props("outline")
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
            self._show_look(look)
        self._message.set_text(f"{state.busy} ..." if state.busy else state.message)
        for button, free in (
            (self._check, look is not None),
            (self._keep, state.offer is not None),
            (self._undo, True),
            (self._scan, look is not None),
        ):
            button.set_enabled(free and not state.busy)
        self._blend.set_visibility(state.offer is not None)
        shown = state.offer if state.offer is not None else state.cloud
        if shown is not self._cloud_shown:
            self._cloud_shown = shown
            self._show_clouds()

    def _show_look(self, look: Look) -> None:
        self._sentence.set_text(look.sentence)
        self._sentence.classes(add=GOOD if look.good else BAD, remove=BAD if look.good else GOOD)
        self._image.set_source(f"/frame.jpg?{self._seen}")
        self._image.set_content(dots(look))
        for name, meter in self._meters.items():
            meter.set_value(round(look.meters[name], 2))

    def _show_clouds(self, *_: object) -> None:
        """The last scan; or, while a rig is offered, what the capture looks like with the old rig or the new."""
        offer, cloud = self._studio.state.offer, self._studio.state.cloud
        middle = None
        if offer is not None:
            after = bool(self._blend.value)
            middle, cloud = np.median(offer.after.points, axis=0), offer.after if after else offer.before
            self._caption.set_text("after: with the new rig" if after else "before: with the rig as it is in the file")
        else:
            self._caption.set_text("" if cloud is None else f"{len(cloud)} points")
        self._scene.clear()
        if cloud is not None and len(cloud):
            with self._scene:
                points, colors = placed(cloud, middle)
                self._scene.point_cloud(points, colors, point_size=0.05)
            self._scene.move_camera(x=0, y=-0.8 * VIEW, z=0.2 * VIEW, look_at_x=0, look_at_y=0, look_at_z=0, duration=0)


def _meter(ui: Any, name: str) -> Any:
    with ui.row().classes("w-full items-center gap-2 no-wrap"):
        ui.label(name).classes("w-24")
        return ui.linear_progress(0, show_value=False, size="12px").props(f'aria-label="{name}"')


def _bump(studio: Studio, degrees: Any) -> Callable[[], None]:
    return lambda: studio.bump(float(degrees.value or 0.0))


def dots(look: Look) -> str:
    """SVG of the points that the decoder found, some of them where they are many."""
    points = look.points.camera_px
    step = max(1, -(-len(points) // MOST_DOTS))
    radius = max(look.picture.shape[1] / 320, 1.5)
    circles = "".join(f'<circle cx="{x + 0.5:.1f}" cy="{y + 0.5:.1f}" r="{radius:.1f}"/>' for x, y in points[::step])
    return f'<g fill="none" stroke="#00e5ff" stroke-width="{radius / 2:.1f}">{circles}</g>'


def placed(cloud: Cloud, middle: Any = None) -> tuple[Sequence[Any], Sequence[Any]]:
    """Points and colours for the scene, whose z points up: (x, z, -y) of the camera's frame, about the middle."""
    step = max(1, -(-len(cloud) // MOST_POINTS))
    points, colors = cloud.points[::step], cloud.colors[::step]
    about = points - (np.median(points, axis=0) if middle is None else middle)
    size = max(float(np.percentile(np.linalg.norm(about, axis=1), 95)), 1e-9)
    about = np.clip(about * (0.5 * VIEW / size), -5 * VIEW, 5 * VIEW)
    return np.column_stack([about[:, 0], about[:, 2], -about[:, 1]]).round(4).tolist(), (colors / 255).round(3).tolist()
