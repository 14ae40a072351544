"""What a worker does: decode a capture, verify it, make its cloud; or recalibrate from several."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

from retrue.batch.job import Capture, options_of
from retrue.batch.tasks import Look, Renew
from retrue.correspondences import Correspondences, each_once, same_points
from retrue.errors import FileError, RetrueError
from retrue.files.captures import pictures_size, read_capture
from retrue.files.kept_points import keep_points, read_kept_points
from retrue.files.models import write_cloud
from retrue.files.patterns import read_pattern
from retrue.files.remote import Remote, UnfetchedError, fetched
from retrue.files.rigs import read_rig, write_rig
from retrue.plain_json import plain
from retrue.rasters import check_extent, check_pattern, check_pictures, check_rasters
from retrue.recalibration.recalibrate import recalibrate
from retrue.recalibration.result import Accepted, Verification, unattended
from retrue.recalibration.verify import verify
from retrue.reconstruction.reconstruct import reconstruct
from retrue.rig import Rig

T = TypeVar("T")
HOLDS = "the captures together say that the rig still holds"
DISAGREE = "the captures do not agree on one pose: the rig, or something before it, was still moving"


def look(task: Look) -> dict[str, Any]:
    """How many correspondences, what `verify` says, and the cloud; or why not."""
    rig = _cached(task.rig, _date(task.rig), read_rig)
    try:
        points = _points(task, rig)
        result: dict[str, Any] = {"correspondences": len(points)}
        if task.verify:
            result |= _verification_values(verify(rig, [points], options_of(task.limits, "verify")))
        if task.cloud is None:
            return result
        cloud = reconstruct(rig, points, options_of(task.limits, "reconstruct"))
    except RetrueError as error:
        why = error.problem if isinstance(error, FileError) else str(error)
        return {"lost" if _may_pass(error) else "failed": why}
    task.cloud.parent.mkdir(parents=True, exist_ok=True)
    write_cloud(task.cloud, cloud)
    return result | {"points": len(cloud.points)}


def renew(task: Renew) -> dict[str, Any]:
    """A rig that all these captures agree with, written; or the reason why there is none."""
    rig = read_rig(task.rig)
    captures = [points for points in map(_kept, task.points) if points is not None]
    if len(captures) < len(task.points):
        return {"lost": "what was decoded of them before was damaged; run the batch again"}
    captures = each_once(captures, same_points)  # a copy tells no more
    try:
        result = unattended(recalibrate(rig, captures, options_of(task.limits, "recalibrate")))
        if not isinstance(result, Accepted):
            return {"refused": result.reason}
        if result.unchanged:
            return {"refused": HOLDS}
        options = options_of(task.limits, "verify")
        verdicts = [verify(result.rig, [points], options).verdict for points in captures]
    except RetrueError as error:
        return {"refused": str(error)}
    if "drifted" in verdicts or "good" not in verdicts:
        return {"refused": DISAGREE}
    task.out.parent.mkdir(parents=True, exist_ok=True)
    write_rig(task.out, result.rig)
    change, sigma = result.evidence.change, result.evidence.sigma
    return {
        "reason": result.reason,
        "change": None if change is None else plain(asdict(change)),
        "sigma": None if sigma is None else plain(asdict(sigma)),
    }


def _points(task: Look, rig: Rig) -> Correspondences:
    """Decoded, and of this rig; kept where somebody will ask again."""
    if task.points is not None and (kept := _kept(task.points)) is not None:
        return kept
    pattern = None
    if task.pattern is not None:
        pattern = _cached(task.pattern, _date(task.pattern), read_pattern)
        check_pattern(rig, pattern.projector_size, task.pattern)
    with _at_hand(task.capture) as capture:
        if pattern is not None and (size := pictures_size(capture)) is not None:
            check_pictures(rig, size, capture)
        points = read_capture(capture, pattern)
        check_rasters(rig, points, capture)
        check_extent(rig, points, capture)
    if task.points is not None:
        task.points.parent.mkdir(parents=True, exist_ok=True)
        keep_points(task.points, points)
    return points


def _kept(path: Path) -> Correspondences | None:
    """What was decoded before; what is damaged is removed, and as good as none."""
    try:
        return read_kept_points(path) if path.exists() else None
    except FileError:
        with suppress(OSError):
            path.unlink()
        return None


def _may_pass(error: RetrueError) -> bool:
    """Whether another try may have more luck: it is the disk, a permission or the network, and not the capture."""
    return isinstance(error, UnfetchedError) or isinstance(error.__cause__, OSError)


def _at_hand(capture: Capture) -> AbstractContextManager[Path]:
    return fetched(capture) if isinstance(capture, Remote) else nullcontext(capture)


@lru_cache(maxsize=16)
def _cached(path: Path, _date: int, read: Callable[[Path], T]) -> T:
    """What many captures have in common, read once."""
    return read(path)


def _date(path: Path) -> int:
    return path.stat().st_mtime_ns if path.exists() else 0


def _verification_values(found: Verification) -> dict[str, Any]:
    return {
        "verdict": found.verdict,
        "reason": found.reason,
        "epipolar_rms_px": plain(found.epipolar_rms_px),
        "drift": None if found.drift is None else plain(asdict(found.drift)),
        "drift_sigmas": plain(found.drift_sigmas),
        "sigma": None if found.sigma is None else plain(asdict(found.sigma)),
        "working_distance": plain(found.working_distance),
    }
