"""Files in object stores, by their addresses (`s3://bucket/rig-1/*.jpg`), by fsspec: needs the extra `.[remote]`."""

from __future__ import annotations

import tempfile
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from importlib import import_module
from pathlib import Path, PurePosixPath
from typing import Any

from retrue.errors import FileError, InputError


class UnfetchedError(FileError):
    """What a store did not give; another time it may."""


@dataclass(frozen=True, slots=True)
class Remote:
    """A file there, or a folder.

    Attributes
    ----------
    address : all of it, with its protocol.
    stamp : changes when the file does; of a folder, when one of its files does.
    modified : seconds since 1970; None where the store does not say.
    folder : whether it is one: a common beginning of several names.
    """

    address: str
    stamp: str
    modified: float | None
    folder: bool = False

    @property
    def path(self) -> PurePosixPath:
        """What is behind the protocol, as `bucket/rig-1/7.jpg`."""
        return PurePosixPath(self.address.rpartition("://")[2])


def is_address(text: str) -> bool:
    """Whether it names something in a store, not on a disk.

    >>> is_address("s3://bucket/rig-1/*.jpg"), is_address("captures/*.jpg")
    (True, False)
    """
    return "://" in text


def listed(pattern: str) -> list[Remote]:
    """What the glob names, folders too; asked for at once. Raises `InputError` in one line, whatever the store says."""
    if "::" in pattern:
        raise InputError(f"{pattern}: expected one address, found several behind each other")
    try:
        store, path = _store(pattern)
        found: Mapping[str, Mapping[str, Any]] = store.glob(path, detail=True)
        return [_remote(store, name, about) for name, about in found.items()]
    except Exception as error:  # of any library that knows a store, or of none that does
        raise InputError(f"{pattern}: {_line(error)}") from error


@contextmanager
def fetched(remote: Remote) -> Generator[Path]:
    """A copy on this disk, under the same name, for as long as the block lasts. Raises `UnfetchedError`."""
    with tempfile.TemporaryDirectory(prefix="retrue-") as folder:
        local = Path(folder) / remote.path.name
        try:
            store, path = _store(remote.address)
            end = "/" if remote.folder else ""  # says that it is what lies within that is wanted
            store.get(f"{path}{end}", f"{local}{end}", recursive=remote.folder)
        except Exception as error:
            raise UnfetchedError(remote.address, f"cannot be fetched: {_line(error)}") from error
        yield local


def _store(address: str) -> tuple[Any, str]:
    """The store, and the path in it."""
    try:
        core: Any = import_module("fsspec.core")
    except ImportError as error:
        raise InputError("expected fsspec, found none; pip install '.[remote]'") from error
    return core.url_to_fs(address)


def _remote(store: Any, name: str, about: Mapping[str, Any]) -> Remote:
    folder = about["type"] == "directory"
    inside: Mapping[str, Mapping[str, Any]] = store.find(name, detail=True) if folder else {name: about}
    times = [_modified(item) for item in inside.values()]
    modified = None if None in times else max((time for time in times if time is not None), default=None)
    stamp = [f"{path} {_version(item)}" for path, item in sorted(inside.items())]
    return Remote(store.unstrip_protocol(name), "\n".join(stamp), modified, folder)


def _version(about: Mapping[str, Any]) -> str:
    """Size, and whatever else the store calls a file's version: no two stores agree on its name."""
    keys = ("ETag", "etag", "md5Hash", "content_md5", "generation", "LastModified", "last_modified", "mtime", "created")
    return " ".join([str(about.get("size")), *(f"{key}={about[key]}" for key in keys if about.get(key) is not None)])


def _modified(about: Mapping[str, Any]) -> float | None:
    for key in ("LastModified", "last_modified", "updated", "mtime", "created"):
        value: Any = about.get(key)
        if isinstance(value, int | float):
            return float(value)
        if isinstance(value, str):
            value = datetime.fromisoformat(value)
        if isinstance(value, datetime):
            return value.timestamp()
    return None


def _line(error: Exception) -> str:
    kind = "" if isinstance(error, InputError) else f"{type(error).__name__}: "
    return " ".join(f"{kind}{error}".split())
