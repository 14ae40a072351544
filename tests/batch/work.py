"""What workers of a test do; in a module of its own, for they import it."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any


def fragile(task: tuple[str, str]) -> dict[str, Any]:
    """Dies, dies the first time, or fails, as asked."""
    path, what = Path(task[0]), task[1]
    if what == "raise":
        raise ZeroDivisionError("because")
    if what == "die" or (what == "die once" and not path.exists()):
        path.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return {}


def pids(path: str) -> dict[str, Any]:
    """Says which process it is, and works for a while."""
    with Path(path).open("a") as stream:
        stream.write(f"{os.getpid()}\n")
    time.sleep(1.0)
    return {}
