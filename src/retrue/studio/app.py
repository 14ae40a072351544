"""The studio's server, through NiceGUI: its page, the live picture, and the page of a fleet."""

from __future__ import annotations

import logging
import socket
from collections.abc import Callable
from importlib import import_module
from typing import Any

from retrue.errors import InputError
from retrue.files.images import jpeg
from retrue.studio.drawings import in_space
from retrue.studio.guard import Guard
from retrue.studio.page import Page
from retrue.studio.studio import Studio

HOST = "127.0.0.1"
FRESH = {"Cache-Control": "no-store"}
BROKEN_OFF = "No response returned."  # what Starlette raises for a request that ends before its answer
ENDED_LATE = "Could not cancel %s tasks within timeout: %s"  # NiceGUI, as it ends; it names those that still run


def require_nicegui() -> Any:
    """NiceGUI; an `InputError` that names the extra, where it is not installed."""
    try:
        return import_module("nicegui")
    except ImportError as error:
        raise InputError("the studio needs nicegui: pip install '.[studio]'") from error


def require_free_port(port: int) -> None:
    """An `InputError` where something listens there already."""
    try:
        with socket.create_server((HOST, port)):
            pass
    except (OSError, OverflowError) as error:
        raise InputError(f"cannot listen on {HOST}:{port}: {error}; choose another --port") from error


def worth_saying(record: logging.LogRecord) -> bool:
    """Whether a line of the server's log is: not that a tab was closed, or we ended, while it waited for an answer.

    Nor that we waited for tasks to end, where none is left.
    """
    error = record.exc_info[1] if record.exc_info else None
    broken_off = isinstance(error, RuntimeError) and str(error) == BROKEN_OFF
    return not (broken_off or (record.msg == ENDED_LATE and record.getMessage().endswith(": ")))


def serve(studio: Studio | None, token: str, port: int, fleet: Callable[[], str] | None = None) -> None:
    """Until it is interrupted; only who has the token is let in. `fleet` makes the page of a fleet, each time anew."""
    nicegui = require_nicegui()
    app, ui = nicegui.app, nicegui.ui
    responses = import_module("starlette.responses")
    app.add_middleware(Guard, token=token, port=port)
    for server in ("uvicorn.error", "nicegui"):
        logging.getLogger(server).addFilter(worth_saying)
    if fleet is not None:

        @app.get("/fleet")
        def fleet_page() -> Any:
            return responses.HTMLResponse(fleet().encode(errors="backslashreplace"), headers=FRESH)

    if studio is None:

        @app.get("/")
        def home() -> Any:
            return responses.RedirectResponse("/fleet")

    else:
        _serve_rig(studio, app, ui, fleet is not None)
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


def _serve_rig(studio: Studio, app: Any, ui: Any, in_fleet: bool) -> None:
    responses = import_module("starlette.responses")

    @app.get("/frame.jpg")
    def frame() -> Any:
        look = studio.state.look
        if look is None:
            return responses.Response(status_code=404, headers=FRESH)
        return responses.Response(jpeg(look.picture), media_type="image/jpeg", headers=FRESH)

    @app.get("/space")
    def space() -> Any:
        return responses.HTMLResponse(in_space(studio.state.offer, studio.state.cloud), headers=FRESH)

    @ui.page("/", title="retrue studio")
    def page() -> None:
        if in_fleet:
            ui.link("Fleet", "/fleet").classes("self-end text-lg")
        Page(ui, studio)

    app.on_startup(studio.start)
    app.on_shutdown(studio.stop)
