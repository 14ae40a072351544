"""Files read whole, but never more of them than a limit."""

from __future__ import annotations

import os
from pathlib import Path

from retrue.errors import FileError

CHUNK = 2**22  # bytes at a time, so that memory is taken only for what is there


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
            while found <= limit and (chunk := stream.read(CHUNK)):
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
