"""Text files, read whole, but never more than a limit."""

from __future__ import annotations

from pathlib import Path

from retrue.errors import FileError


def read_text(path: str | Path, limit: int) -> str:
    """The file as text (UTF-8, with or without a byte-order mark).

    A file of more than `limit` bytes is refused before it is read. Raises `FileError`.
    """
    path = Path(path)
    try:
        if path.is_dir():
            raise FileError(path, "expected a file, found a folder")
        if path.stat().st_size > limit:
            raise FileError(
                path, f"expected at most {limit} bytes, found {path.stat().st_size}; is this the right file?"
            )
        with path.open("rb") as stream:
            content = stream.read(limit + 1)
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from error
    except FileError:
        raise
    except ValueError as error:  # a NUL in the name
        raise FileError(path, f"cannot be read: {error}") from error
    if len(content) > limit:
        raise FileError(path, f"expected at most {limit} bytes, found more; is this the right file?")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(path, f"expected text (UTF-8), found other bytes at offset {error.start}") from error
