"""What is asked of a worker. Paths and plain values travel to it and back, and pictures never."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from retrue.batch.job import Capture, Limits


@dataclass(frozen=True, slots=True)
class Look:
    """Look at one capture: decode it, or take what was decoded before; verify; make a cloud.

    Attributes
    ----------
    points : where what was decoded is kept, or lies; None where nobody will ask again.
    cloud : where to; None for none.
    """

    name: str
    capture: Capture
    pattern: Path | None
    rig: Path
    limits: Limits
    verify: bool
    points: Path | None = None
    cloud: Path | None = None


@dataclass(frozen=True, slots=True)
class Renew:
    """Recalibrate from captures that were decoded."""

    name: str
    points: tuple[Path, ...]
    rig: Path
    limits: Limits
    out: Path


def work(task: Look | Renew) -> dict[str, Any]:
    """Either task, under one name for every scheduler; who only hands it in needs none of what it takes."""
    from retrue.batch.worker import look, renew

    return look(task) if isinstance(task, Look) else renew(task)


def paths_of(task: Look | Renew) -> tuple[Path, ...]:
    """What the task leaves that the next one with another rig writes over."""
    left = task.out if isinstance(task, Renew) else task.cloud
    return () if left is None else (left,)


def is_kept(task: Look | Renew) -> bool:
    """Whether what was decoded still lies there, where others count on it."""
    return isinstance(task, Renew) or task.cloud is not None or task.points is None or lies(task.points)


def lies(path: Path) -> bool:
    """Whether there is such a file; `Path.exists` takes three times as long, and there are thousands."""
    return os.path.exists(path)  # noqa: PTH110
