"""Every exception that `retrue` raises on purpose.

    RetrueError
    ├── InputError              a value that the caller handed in is not what it must be
    │   └── FileError           the same, of a file: names it
    │       └── CaptureError    a capture whose pictures do not belong together or do not decode
    └── DegenerateError         the data cannot determine what was asked for

A message is one line: what, expected, found, what to do.
"""

from __future__ import annotations

from pathlib import Path


class RetrueError(Exception):
    """Root of the tree; `except RetrueError` catches all that is below."""


class InputError(RetrueError, ValueError):
    """A value that is not what it must be."""


class FileError(InputError):
    """A file (or folder) that cannot be used: says which one and why."""

    def __init__(self, path: str | Path, problem: str) -> None:
        self.path = Path(path)
        self.problem = problem
        super().__init__(f"{path}: {problem}")


class CaptureError(FileError):
    """A capture that does not decode: a picture missing, doubled, late, of another size ..."""


class DegenerateError(RetrueError):
    """The data do not determine what was asked for (three points, collinear points ...)."""
