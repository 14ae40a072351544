"""Tells somebody of an event, by webhook and by command; a slow or broken one holds up no watch."""

from __future__ import annotations

import json
import queue
import subprocess
import threading
import urllib.request
from types import TracebackType
from typing import Any

from retrue.watch.events import Event
from retrue.watch.fleet_file import Alarm

PATIENCE = 10.0  # seconds for a webhook or a command
MOST_WAITING = 1000  # alarms; older ones are dropped


class Alarms:
    """Sends alarms from a thread of its own while the block lasts."""

    def __init__(self, alarm: Alarm) -> None:
        self._alarm = alarm
        self._waiting: queue.Queue[bytes | None] = queue.Queue(MOST_WAITING)
        self._thread = threading.Thread(target=self._send_all, daemon=True)
        self.failed = 0

    def __enter__(self) -> Alarms:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self._put(None)
        self._thread.join(timeout=2 * PATIENCE)

    def observe(self, event: Event, rig: str) -> None:
        """Tell of it, where it is one to be told of."""
        if event["event"] in self._alarm.events:
            self._put(json.dumps({**event, "rig": rig}, allow_nan=False).encode())

    def _put(self, message: bytes | None) -> None:
        while True:
            try:
                self._waiting.put_nowait(message)
            except queue.Full:
                with_room = self._waiting.get()
                self.failed += with_room is not None
            else:
                return

    def _send_all(self) -> None:
        while (message := self._waiting.get()) is not None:
            for send in (self._post, self._run):
                try:
                    send(message)
                except (OSError, ValueError, subprocess.SubprocessError):
                    self.failed += 1

    def _post(self, message: bytes) -> None:
        if self._alarm.webhook is not None:
            headers: dict[str, Any] = {"Content-Type": "application/json"}
            request = urllib.request.Request(self._alarm.webhook, message, headers)
            with urllib.request.urlopen(request, timeout=PATIENCE):
                pass

    def _run(self, message: bytes) -> None:
        if self._alarm.command:
            subprocess.run(self._alarm.command, input=message, timeout=PATIENCE, check=True, stdout=subprocess.DEVNULL)
