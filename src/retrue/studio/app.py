"""The studio's server, through NiceGUI: its page, and the live picture."""

from __future__ import annotations

import logging
import socket
from importlib import import_module
from typing import Any

from retrue.errors import InputError
from retrue.files.images import jpeg
from retrue.studio.drawings import in_space
from retrue.studio.guard import Guard
from retrue.studio.page import Page
from retrue.studio.studio import Studio

HOST = "127.0.0.1"
BROKEN_OFF = "No response returned."  # what Starlette raises for a request that ends before its answer


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
    """Whether a line of the server's log is: not that a tab was closed, or we ended, while it waited for an answer."""
    error = record.exc_info[1] if record.exc_info else None
    return not (isinstance(error, RuntimeError) and str(error) == BROKEN_OFF)


def serve(studio: Studio, token: str, port: int) -> None:
    """Until it is interrupted; only who has the token is let in."""
    nicegui = require_nicegui()
    app, ui = nicegui.app, nicegui.ui
    responses = import_module("starlette.responses")
    app.add_middleware(Guard, token=token, port=port)
    logging.getLogger("uvicorn.error").addFilter(worth_saying)

    @app.get("/frame.jpg")
    def frame() -> Any:
        look = studio.state.look
        headers = {"Cache-Control": "no-store"}
        if look is None:
            return responses.Response(status_code=404, headers=headers)
        return responses.Response(jpeg(look.picture), media_type="image/jpeg", headers=headers)

    @app.get("/space")
    def space() -> Any:
        page = in_space(studio.state.offer, studio.state.cloud)
        return responses.HTMLResponse(page, headers={"Cache-Control": "no-store"})

    @ui.page("/", title="retrue studio")
    def page() -> None:
        Page(ui, studio)

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
