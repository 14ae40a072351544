"""A lock that processes take on an open file; the system gives it back when the holder dies, however it dies."""

from __future__ import annotations

import io
import os
import sys
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from retrue.errors import FileError

LOCK_PATIENCE = 30.0  # seconds; nobody holds a lock for longer than it takes to write a few files
RETRY_PAUSE = 0.01  # seconds between two tries

if sys.platform == "win32":
    import msvcrt

    FAR = 2**62  # a byte that no file reaches: Windows would keep others from reading the one that is locked

    def _try_lock(handle: int) -> None:
        os.lseek(handle, FAR, os.SEEK_SET)
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)

    def _unlock(handle: int) -> None:
        os.lseek(handle, FAR, os.SEEK_SET)
        msvcrt.locking(handle, msvcrt.LK_UNLCK, 1)

else:
    import fcntl

    def _try_lock(handle: int) -> None:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)

    def _unlock(handle: int) -> None:
        fcntl.flock(handle, fcntl.LOCK_UN)


def not_waiting(path: str, flags: int) -> int:
    """For `open`: a pipe that somebody laid where a file should be must not keep us until another end opens."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0), 0o666)


@contextmanager
def locked(path: Path, handle: int, patience: float = LOCK_PATIENCE) -> Generator[None]:
    """Hold an open file alone, against all others that open it and ask for it in the same way.

    Raises `FileError`, naming `path`, when it stays taken for `patience` seconds.
    """
    end = time.monotonic() + patience
    while True:
        try:
            _try_lock(handle)
            break
        except OSError as error:
            if time.monotonic() >= end:
                raise FileError(path, f"in use by another process ({error.strerror}); try again later") from error
            time.sleep(RETRY_PAUSE)
    try:
        yield
    finally:
        _unlock(handle)


@contextmanager
def held_file(path: Path, patience: float = LOCK_PATIENCE) -> Generator[io.FileIO]:
    """A file open for reading and appending, made where it is not there, and held alone.

    A holder may remove it: who waited for it then opens another. Raises `FileError`, also for what is no file.
    """
    while True:
        try:
            if path.exists() and not path.is_file():
                raise FileError(path, "expected a file, found something else")
            stream = io.FileIO(path, "a+b", opener=not_waiting)
        except OSError as error:
            raise FileError(path, f"cannot be written: {error.strerror or error}") from error
        with stream, locked(path, stream.fileno(), patience):
            if path.exists() and os.path.samestat(path.stat(), os.fstat(stream.fileno())):
                yield stream
                return
