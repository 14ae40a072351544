"""One line on a terminal that says how a watch is doing."""

from __future__ import annotations

import shutil
import sys

from retrue.watch.events import Event
from retrue.watch.state import Counts

COLUMNS = ("good", "drifted", "unknown", "bad", "dropped", "recalibrated", "refused")


class StatusLine:
    """Written anew with every event, to stderr; nothing where that is no terminal."""

    def __init__(self, counts: Counts) -> None:
        self._counts = counts
        self._shown = sys.stderr.isatty()

    def observe(self, event: Event) -> None:
        """Show where things stand after this event."""
        if not self._shown:
            return
        text = f"{self._counts.frames} frames"
        for name in COLUMNS:
            if count := getattr(self._counts, name):
                text += f"  {count} {name}"
        if event["event"] == "frame" and event["epipolar_rms_px"] is not None:
            text += f"  {event['epipolar_rms_px']:.2f} px"
        if event["event"] == "frame" and event["drift"] is not None:
            text += f"  {event['drift']['rotation_deg']:.3f} deg off"
        width = shutil.get_terminal_size().columns - 1
        end = "\n" if event["event"] == "stopped" else ""
        print(f"\r{text[:width]:<{width}}", end=end, file=sys.stderr, flush=True)
