"""What is known of each rig of a fleet, served on this machine: a page, the same as JSON, and the metrics."""

from __future__ import annotations

import json
import threading
from collections.abc import Mapping, Sequence
from datetime import datetime
from html import escape
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import Any

from retrue.errors import InputError
from retrue.watch.events import Event
from retrue.watch.metrics import Metrics
from retrue.watch.rig_status import RigStatus

WIDTH, HEIGHT = 480, 90  # of a drawing, pixels
STYLE = (
    "body{font:15px system-ui,sans-serif;margin:2rem;max-width:70rem}div{overflow-x:auto}"
    "table{border-collapse:collapse}"
    "td,th{padding:.3rem .8rem;text-align:left;border-bottom:1px solid #8884}.drifted,.failed{color:#c33}"
    ".good{color:#282}svg{background:#8881}polyline{fill:none;stroke:#38c;stroke-width:1.5}.warm{stroke:#d82;stroke-width:1}line{stroke:#c33}"
    "@media(prefers-color-scheme:dark){body{background:#181818;color:#ddd}}"
)


class Status:
    """Serves / (a page), /status.json and /metrics on a port of this machine while the block lasts.

    `rigs` is what is known of them before; it is kept up to date.
    """

    def __init__(self, rigs: Mapping[str, RigStatus], port: int, metrics: Metrics | None) -> None:
        self.rigs = rigs
        self._metrics = metrics
        self._lock = threading.Lock()
        try:
            self._server = ThreadingHTTPServer(("127.0.0.1", port), self._handler())
        except (OSError, OverflowError) as error:
            raise InputError(f"port {port} cannot be served: {error}") from error
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)

    def __enter__(self) -> Status:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self._server.shutdown()
        self._server.server_close()

    @property
    def port(self) -> int:
        """The one that is served, also where any free one (0) was asked for."""
        return self._server.server_port

    def observe(self, event: Event, rig: str) -> None:
        """One event of a rig."""
        with self._lock:
            self.rigs[rig].observe(event)

    def document(self) -> dict[str, Any]:
        """All of it, as plain JSON values."""
        with self._lock:
            return {name: rig.document() for name, rig in self.rigs.items()}

    def _answer(self, path: str) -> tuple[bytes, str] | None:
        if path == "/":
            return status_page(self.document()).encode(errors="backslashreplace"), "text/html; charset=utf-8"
        if path == "/status.json":
            return json.dumps(self.document(), allow_nan=False).encode(), "application/json"
        if path == "/metrics" and self._metrics is not None:
            return self._metrics.text(), "text/plain; version=0.0.4; charset=utf-8"
        return None

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        answer = self._answer

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                found = answer(self.path.partition("?")[0])
                if found is None:
                    self.send_error(404)
                    return
                self.send_response(200)
                self.send_header("Content-Type", found[1])
                self.send_header("Content-Length", str(len(found[0])))
                self.end_headers()
                self.wfile.write(found[0])

            def log_message(self, format: str, *args: Any) -> None:
                """Nothing: who asks when is no event of a rig."""

        return Handler


def status_page(document: Mapping[str, Mapping[str, Any]]) -> str:
    """The page: a row a rig, and how it drifted. It loads nothing, and asks again every ten seconds."""
    rows = "".join(_row(name, rig) for name, rig in document.items())
    head = "".join(f"<th>{name}</th>" for name in ("rig", "state", "frames", "new rigs", "last frame", "drift, mm"))
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        '<meta http-equiv="refresh" content="10">'
        f"<title>retrue: {len(document)} rigs</title><style>{STYLE}</style><h1>{len(document)} rigs</h1>"
        f"<div><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div></html>"
    )


def _row(name: str, rig: Mapping[str, Any]) -> str:
    word = rig["verdict"] if rig["state"] == "watching" else rig["state"]
    bad = f", {rig['bad']} bad" if rig["bad"] else ""
    warm = "" if rig["temperature"] is None else f"<br>{rig['temperature']:g} degrees"
    last = rig["last"][:19].replace("T", " ")
    cells = (
        f"<b>{escape(name)}</b>",
        f'<span class="{escape(word)}" title="{escape(rig["reason"])}">{escape(word)}</span>',
        f"{rig['frames']}{bad}",
        f"{rig['recalibrated']}",
        f"{escape(last)}{warm}",
        _drawing(rig["drift_mm"], rig["temperatures"], rig["changes"]),
    )
    return f"<tr>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>"


def _drawing(drift: Sequence[Sequence[Any]], warmth: Sequence[Sequence[Any]], changes: Sequence[Sequence[str]]) -> str:
    """Drift over time, and the temperature from its lowest to its highest; a red line where it was recalibrated."""
    points, warm = _known(drift), _known(warmth)
    if len(points) < 2:
        return ""
    begin, end = points[0][0], points[-1][0]
    top = max(max(off for _, off in points), 1e-9)

    def across(time: float) -> float:
        return WIDTH * (time - begin) / max(end - begin, 1e-9)

    def line(curve: Sequence[tuple[float, float]], low: float, high: float) -> str:
        span = max(high - low, 1e-9)
        return " ".join(
            f"{across(time):.1f},{HEIGHT - (HEIGHT - 8) * (value - low) / span:.1f}" for time, value in curve
        )

    marks = "".join(
        f'<line x1="{x:.1f}" x2="{x:.1f}" y1="0" y2="{HEIGHT}"><title>{escape(kind)}</title></line>'
        for time, kind in changes
        if 0 <= (x := across(datetime.fromisoformat(time).timestamp())) <= WIDTH
    )
    said, curve = f"drift, at most {top:.3g} mm", ""
    if len(warm) > 1:
        low, high = (pick(value for _, value in warm) for pick in (min, max))
        said += f"; {low:g} to {high:g} degrees"
        curve = f'<polyline class="warm" points="{line(warm, low, high)}"/>'
    return (
        f'<svg width="{WIDTH}" height="{HEIGHT}" role="img" aria-label="{said}">'
        f'{marks}{curve}<polyline points="{line(points, 0.0, top)}"/></svg> {top:.3g}'
    )


def _known(curve: Sequence[Sequence[Any]]) -> list[tuple[float, float]]:
    """Seconds and value, where there is one."""
    return [(datetime.fromisoformat(time).timestamp(), value) for time, value in curve if value is not None]
