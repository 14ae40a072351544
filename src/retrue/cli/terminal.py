"""What reaches the terminal beside the answer: notes, progress with the time left, and color.

Notes and progress go to stderr, so that they never mix with what a program reads from stdout.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TextIO

GREEN, YELLOW, RED = "32", "33", "31"
CLEAR_LINE = "\r\x1b[K"
SOON = 2.0  # seconds: what takes no longer is not foretold


@dataclass
class Terminal:
    """How much to say; set once for each command."""

    quiet: bool = False
    verbose: bool = False
    started: float = field(default_factory=time.perf_counter)

    def start(self, *, quiet: bool, verbose: bool) -> None:
        """A command begins."""
        self.quiet, self.verbose, self.started = quiet, verbose, time.perf_counter()

    def note(self, message: str) -> None:
        """What was found on the way; with --verbose, after how many seconds."""
        if not self.quiet:
            stamp = f"[{time.perf_counter() - self.started:7.3f} s] " if self.verbose else ""
            print(f"{CLEAR_LINE if sys.stderr.isatty() else ''}{stamp}{message}", file=sys.stderr, flush=True)

    def detail(self, message: str) -> None:
        """What only --verbose tells."""
        if self.verbose:
            self.note(message)

    def status(self, message: str) -> None:
        """What is being done, written over by what comes next; only where somebody watches."""
        if self.verbose:
            self.note(message)
        elif sys.stderr.isatty() and not self.quiet:
            print(f"{CLEAR_LINE}{message}", end="", file=sys.stderr, flush=True)

    def progress(self, name: str) -> Callable[[int, int], None]:
        """Call it with (done, total): shows both, and about how long the rest will take."""
        began = time.perf_counter()

        def show(done: int, total: int) -> None:
            if not self.quiet and sys.stderr.isatty():
                left = time_left(time.perf_counter() - began, done, total)
                print(f"{CLEAR_LINE}{name}: {done} of {total}{left}", end="", file=sys.stderr, flush=True)

        return show

    def clear(self) -> None:
        """Take away what was written over."""
        if sys.stderr.isatty():
            print(CLEAR_LINE, end="", file=sys.stderr, flush=True)


terminal = Terminal()


def time_left(seconds: float, done: int, total: int) -> str:
    """In words, from the time that was needed so far; nothing where that says nothing.

    >>> time_left(30.0, 10, 50), time_left(1000.0, 1, 10), time_left(30.0, 50, 50)
    (', about 2 min left', ', about 2.5 h left', '')
    """
    if not 0 < done < total:
        return ""
    left = seconds / done * (total - done)
    if left < SOON:
        return ""
    if left < 100:
        return f", about {left:.0f} s left"
    return f", about {left / 60:.0f} min left" if left < 5400 else f", about {left / 3600:.1f} h left"


def colored(text: str, color: str, stream: TextIO) -> str:
    """The text in that color, if the stream is a terminal that wants it."""
    return f"\x1b[1;{color}m{text}\x1b[0m" if wants_color(stream) else text


def wants_color(stream: TextIO) -> bool:
    """Whether it is a terminal, and nobody asked for none (https://no-color.org)."""
    return stream.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
