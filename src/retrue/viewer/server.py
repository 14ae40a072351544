"""The page of a scene, served until the block ends."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Generator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from retrue.errors import InputError

LOOPBACK = ("127.0.0.1", "::1", "localhost")


@contextlib.contextmanager
def serving(page: str, host: str, port: int) -> Generator[None]:
    """One page at one address; everything else is not found.

    Raises
    ------
    InputError : nothing can listen there.
    """
    body = page.encode(errors="backslashreplace")

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            # Another site could give its own name this computer's address; a browser would then show it the page.
            called = self.headers.get("Host", "").rpartition(":")[0].strip("[]")
            ours = host not in LOOPBACK or called in LOOPBACK
            self.send_response(200 if self.path == "/" and ours else 404)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.send_header("Cache-Control", "no-store")
            self.send_header("Content-Length", str(len(body) if self.path == "/" and ours else 0))
            self.end_headers()
            if self.path == "/" and ours:
                with contextlib.suppress(ConnectionError):  # the tab was closed before it had it all
                    self.wfile.write(body)

        def log_message(self, format: str, *args: object) -> None:
            """Nobody reads it."""

    try:
        server = ThreadingHTTPServer((host, port), Handler)
    except (OSError, OverflowError) as error:
        raise InputError(f"cannot listen on {host}:{port}: {error}; choose another --port or --host") from error
    server.daemon_threads = True
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
