"""A simulated camera on the network: its frames as MJPEG over HTTP, on loopback."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Generator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import cv2

from retrue.devices.protocols import CameraDriver


@contextlib.contextmanager
def streaming(camera: CameraDriver, quality: int = 95, port: int = 0) -> Generator[str]:
    """The stream's address, until the block ends; of a free port, where none is named."""
    ended = threading.Event()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
            self.end_headers()
            with contextlib.suppress(OSError):
                while not ended.is_set():
                    picture = camera.frame().picture[..., ::-1]
                    _, content = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])
                    head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(content)}\r\n\r\n"
                    self.wfile.write(head.encode() + content.tobytes() + b"\r\n")

        def log_message(self, format: str, *args: object) -> None: ...

    server = ThreadingHTTPServer(("127.0.0.1", port), Handler)
    server.daemon_threads = True
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}/stream.mjpg"
    finally:
        ended.set()
        server.shutdown()
        server.server_close()
        thread.join()
