"""Files that are written whole or not at all, and read whole, but never more of them than a limit."""

from __future__ import annotations

import os
import secrets
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from retrue.errors import FileError

CHUNK, PIPE = 2**22, 2**16  # bytes at a time: at most, and of what does not say how much it holds


@contextmanager
def replaced_file(path: str | Path, *, alone: bool = False) -> Generator[BinaryIO]:
    """A binary file to write to, that takes the place of `path` only when the block ends without an error.

    Whatever happens, `path` holds the old bytes or the new, never half of them. A caller who holds a lock is
    `alone`: the bytes wait under one name, so that processes that are killed leave one stray file, not many.
    Raises `FileError` where the folder cannot be written.
    """
    path = Path(path)
    try:
        handle, temporary = _opened_beside(path, alone)
    except OSError as error:
        raise FileError(path, f"cannot be written: {error.strerror or error}") from error
    try:
        with os.fdopen(handle, "wb") as stream:
            with suppress(FileNotFoundError):
                temporary.chmod(path.stat().st_mode & 0o777)
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(path)
        sync_folder(path.parent)
    except OSError as error:
        raise FileError(path, f"cannot be written: {error.strerror or error}") from error
    finally:
        temporary.unlink(missing_ok=True)


def sync_folder(folder: Path) -> None:
    """Make names in the folder last through a power cut; some systems cannot, and then nothing is lost by it."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _opened_beside(path: Path, alone: bool) -> tuple[int, Path]:
    temporary = path.with_name(f".{path.name}.part" if alone else f".{path.name}.{secrets.token_hex(6)}.part")
    if alone:
        temporary.unlink(missing_ok=True)  # a link laid there is not followed
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
    return os.open(temporary, flags, 0o666), temporary  # less the umask, which a process of threads cannot ask for


def read_text(path: str | Path, limit: int) -> str:
    """The file as text (UTF-8, with or without a byte-order mark); `FileError` as by `read_bytes`."""
    content = read_bytes(path, limit)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(path, f"expected text (UTF-8), found other bytes at offset {error.start}") from error


def read_bytes(path: str | Path, limit: int) -> bytes:
    """The file, which also may be a pipe; one of more than `limit` bytes is a `FileError` before it is read."""
    path = Path(path)
    chunks: list[bytes] = []
    found = 0
    try:
        if path.is_dir():
            raise FileError(path, "expected a file, found a folder")
        with path.open("rb", buffering=0) as stream:
            size = os.fstat(stream.fileno()).st_size  # 0 of what is no file
            if size > limit:
                raise FileError(path, f"expected at most {limit} bytes, found {size}; is this the right file?")
            room = max(PIPE, size + 1)  # read() takes it all, however little comes
            while found <= limit and (chunk := stream.read(min(CHUNK, room))):
                chunks.append(chunk)
                found += len(chunk)
    except FileError:
        raise
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from error
    except ValueError as error:  # a NUL in the name
        raise FileError(path, f"cannot be read: {error}") from error
    if found > limit:
        raise FileError(path, f"expected at most {limit} bytes, found more; is this the right file?")
    return b"".join(chunks)


def read_tail(path: Path, length: int) -> list[bytes]:
    """Lines of the last so many bytes of a file, the first perhaps cut; raises OSError."""
    with path.open("rb") as stream:
        stream.seek(max(0, stream.seek(0, os.SEEK_END) - length))
        return stream.read(length).split(b"\n")
