"""What a watch wrote down of each frame, read again: the track of the rig over all of them, and how warm it was."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast

import numpy as np

from retrue.errors import FileError, InputError
from retrue.geometry.arrays import FloatArray, finite_array
from retrue.geometry.transform import RigidTransform
from retrue.plain_json import plain
from retrue.recalibration.axes import NAMES, axes_of_offsets
from retrue.recalibration.creep import SIZE, measured_pose, offset_from
from retrue.recalibration.result import Verification
from retrue.recalibration.track import FEWEST_FRAMES, smoothed

DIGITS = 9  # of a pose: a millionth of a pixel


@dataclass(frozen=True, slots=True, eq=False)
class WatchRecord:
    """Of N frames that could tell where the rig was, on the five axes of `recalibration.axes`, degrees.

    Attributes
    ----------
    times : (N,) when each was handled.
    names : (N,) of the frames.
    frames_deg, frame_sigma_deg : (N, 5) from a pose of reference, of each frame by itself.
    track_deg, sigma_deg : (N, 5) of each frame, given all of them.
    bumps : frames from which on the rig stood elsewhere.
    changes : when another rig was put in place, and why.
    temperatures : (N,) beside the rig; NaN where nobody measured.
    """

    times: list[datetime]
    names: list[str]
    frames_deg: FloatArray
    frame_sigma_deg: FloatArray
    track_deg: FloatArray
    sigma_deg: FloatArray
    bumps: list[int]
    changes: list[tuple[datetime, str]]
    temperatures: FloatArray

    def report(self) -> dict[str, Any]:
        """As JSON has it."""
        frames = zip(self.times, self.names, self.temperatures, self.track_deg, self.sigma_deg, strict=True)
        report = {
            "axes": NAMES,
            "frames": [
                {"time": _told(time), "name": name, "temperature": warm, "moved_deg": moved, "sigma_deg": sigma}
                for time, name, warm, moved, sigma in frames
            ],
            "bumps": [self.names[first] for first in self.bumps],
            "changes": [{"time": _told(time), "kind": kind} for time, kind in self.changes],
        }
        return plain(report)


def supported(found: Verification) -> dict[str, Any] | None:
    """The pose that a frame supports, as the record keeps it, with the covariance of its points, radians squared."""
    measured = measured_pose(found)
    if measured is None:
        return None
    pose, covariance = measured
    return {"R": _rounded(pose.R), "t": _rounded(pose.t), "covariance": _rounded(covariance)}


def read_record(folder: Path, reference: RigidTransform) -> WatchRecord:
    """The record in the folder of a watch, from that pose; lines that do not read are passed over.

    Raises `FileError` where there is none, or fewer than three frames of it tell a pose.
    """
    path = folder / "events.jsonl"
    times, names, warm, changes = list[datetime](), list[str](), list[float](), list[tuple[datetime, str]]()
    measured: list[tuple[FloatArray, FloatArray]] = []
    for event in _events(path):
        try:
            time = datetime.fromisoformat(event["time"])
            time = time if time.tzinfo else time.replace(tzinfo=UTC)
            if event["event"] == "recalibrated":
                changes.append((time, str(event["kind"])))
            elif event["event"] == "rig changed":
                changes.append((time, "by somebody else"))
            if event["event"] != "frame" or event.get("supported") is None:
                continue
            offset = _offset(event["supported"], reference)
        except (AttributeError, KeyError, TypeError, ValueError, InputError):
            continue
        measured.append(offset)
        times.append(time)
        names.append(str(event.get("name")))
        value = event.get("temperature")
        warm.append(float(value) if isinstance(value, float | int) and abs(value) < np.inf else np.nan)
    if len(measured) < FEWEST_FRAMES:
        raise FileError(path, f"expected {FEWEST_FRAMES} frames or more that tell a pose, found {len(measured)}")
    offsets, covariances = (np.stack(part) for part in zip(*measured, strict=True))
    track, rows = smoothed(offsets, covariances), axes_of_offsets(reference.t)
    return WatchRecord(
        times,
        names,
        np.degrees(offsets @ rows.T),
        _sigma_deg(covariances, rows),
        np.degrees(track.offset @ rows.T),
        _sigma_deg(track.covariance, rows),
        track.bumps.tolist(),
        changes,
        np.array(warm, dtype=np.float64),
    )


def _events(path: Path) -> Iterator[Mapping[str, Any]]:
    try:
        with path.open("rb") as stream:
            for line in stream:
                try:
                    event: Any = json.loads(line)
                except (ValueError, RecursionError):  # torn, or not ours
                    continue
                if isinstance(event, dict):
                    yield cast("Mapping[str, Any]", event)
    except OSError as error:
        raise FileError(path, f"expected the record of a watch: {error.strerror or error}") from error


def _offset(supported: Mapping[str, Any], reference: RigidTransform) -> tuple[FloatArray, FloatArray]:
    covariance = finite_array(supported["covariance"], (SIZE, SIZE), "covariance")
    if not np.linalg.eigvalsh(covariance)[0] > 0:
        raise InputError("covariance: expected positive eigenvalues")
    return offset_from(reference, RigidTransform(supported["R"], supported["t"]), covariance)


def _told(time: datetime) -> str:
    return time.isoformat(timespec="milliseconds")


def _sigma_deg(covariances: FloatArray, rows: FloatArray) -> FloatArray:
    return np.degrees(np.sqrt(np.einsum("ij,njk,ik->ni", rows, covariances, rows)))


def _rounded(values: FloatArray) -> list[Any]:
    flat = [float(f"{value:.{DIGITS}g}") for value in values.ravel().tolist()]
    return np.reshape(flat, values.shape).tolist()
