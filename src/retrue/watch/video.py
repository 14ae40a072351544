"""A video file, a network stream or a camera as a source of frames."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from retrue.errors import FileError
from retrue.files.video import read_video
from retrue.watch.frame import Frame, Position


@dataclass(frozen=True, slots=True)
class VideoSource:
    """Frames by number. A file goes on where it was; a stream or a camera goes on with what it shows now."""

    source: Path | str | int
    position: Position = field(default_factory=dict[str, Any])

    @property
    def live(self) -> bool:
        """All but a file."""
        return not isinstance(self.source, Path)

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        """Every frame; the hash of its capture is that of its pixels."""
        first = self.position.get("next", 0)
        if type(first) is not int or first < 0:
            raise FileError(str(self.source), f"the saved position is none of a video: {first!r}")
        for number, picture in read_video(self.source, first):
            name = f"frame {number}"
            digest = hashlib.sha256(picture.data).hexdigest()
            yield Frame(name, picture, {"next": number + 1}, {"name": name, "sha256": digest})
            if stop.is_set():
                return
