"""One picture of the stream, and where streams come from."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from retrue.correspondences import Correspondences
from retrue.geometry.arrays import Image

Position = Mapping[str, Any]
"""Where a source goes on, as plain JSON values that only the source itself understands."""


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """What a source hands over.

    Attributes
    ----------
    name : for people.
    content : a picture, a pair of photographs, or what was decoded already; None where it could not be read, and
        `problem` says why.
    position : where to go on when this frame is done.
    capture : name and SHA-256, for the history of the rig.
    temperature : beside it, where a side file says so.
    """

    name: str
    content: Image | tuple[Image, Image] | Correspondences | None
    position: Position
    capture: Mapping[str, str]
    problem: str = ""
    temperature: float | None = None


class Source(Protocol):
    """A stream of frames."""

    @property
    def live(self) -> bool:
        """Whether frames that nobody takes are gone: then the newest are worth most."""
        ...

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        """All frames from where the source was told to start, until it ends or `stop` is set."""
        ...
