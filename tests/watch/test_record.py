"""The record of a watch, read again: the track of all frames, bumps, new rigs, and the temperature beside them."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from retrue.errors import FileError
from retrue.geometry.transform import RigidTransform
from retrue.recalibration.axes import NAMES
from retrue.recalibration.result import PoseSigma, Verification
from retrue.report.track_picture import track_picture
from retrue.watch.record import read_record, supported

REFERENCE = RigidTransform.from_rotation_vector([0.01, -0.05, 0.02], [-150.0, 3, 5])
FRAMES, BUMP, BUMP_DEG, CREEP_DEG = 90, 60, 0.5, 0.2
SIGMA = np.radians(0.02)
GOOD = Verification("good", "", 0.1, 400, sigma=PoseSigma(0.04, 0.03, None))


def pose_at(number: int, noise: np.ndarray) -> RigidTransform:
    """Creeps about y from the beginning, and turns about x at the bump."""
    turn = np.radians([BUMP_DEG * (number >= BUMP), CREEP_DEG * number / FRAMES, 0]) + noise
    return RigidTransform.from_rotation_vector(turn, np.zeros(3)) @ REFERENCE


def lines() -> list[str]:
    """As a watch writes them."""
    random, found = np.random.default_rng(0), list[str]()
    for number in range(FRAMES):
        pose = pose_at(number, random.normal(0, SIGMA, 3))
        frame = replace(GOOD, supported_pose=pose, statistical_covariance=np.eye(5) * SIGMA**2)
        time = datetime(2026, 11, 27, 8, tzinfo=UTC) + timedelta(minutes=number)
        event = {"time": time.isoformat(), "event": "frame", "name": f"{number}.png", "temperature": 20 + number / 30}
        found.append(json.dumps(event | {"supported": supported(frame)}))
        if number == BUMP + 3:
            found.append(json.dumps({"time": time.isoformat(), "event": "recalibrated", "kind": "bump"}))
    return found


def written(folder: Path, content: list[str]) -> Path:
    (folder / "events.jsonl").write_text("\n".join(content) + "\n")
    return folder


def test_the_track_of_all_frames_is_nearer_than_each(tmp_path: Path) -> None:
    record = read_record(written(tmp_path, lines()), REFERENCE)
    true = np.array([read_axes(pose_at(number, np.zeros(3))) for number in range(FRAMES)])
    off = record.track_deg - true
    alone = record.frames_deg - true
    assert np.sqrt((off[:, :3] ** 2).mean()) < 0.5 * np.sqrt((alone[:, :3] ** 2).mean())
    assert (np.abs(off[:, :3]) < 4 * record.sigma_deg[:, :3]).all()
    assert record.bumps == [BUMP]
    assert [kind for _, kind in record.changes] == ["bump"]
    assert record.temperatures[[0, -1]].tolist() == [20, 20 + (FRAMES - 1) / 30]
    assert record.report()["axes"] == list(NAMES)
    assert track_picture(record).startswith(b"\x89PNG")


def read_axes(pose: RigidTransform) -> list[float]:
    """The true move on the five axes."""
    from retrue.recalibration.axes import axes_between

    return [one.moved_deg for one in axes_between(REFERENCE, pose, np.eye(5))]


def test_lines_that_do_not_read_are_passed_over(tmp_path: Path) -> None:
    whole = lines()
    spoilt = json.loads(whole[4])
    broken = [
        "",
        "{",
        "[1]",
        '{"event": "frame"}',
        json.dumps({**spoilt, "time": "yesterday"}),
        json.dumps({**spoilt, "supported": None}),
        json.dumps({**spoilt, "supported": {**spoilt["supported"], "covariance": (-np.eye(5)).tolist()}}),
        json.dumps({**spoilt, "supported": {**spoilt["supported"], "R": [[1, 2], [3, 4]]}}),
        json.dumps({**spoilt, "supported": {"R": None}}),
        json.dumps({**spoilt, "supported": 7}),
    ]
    odd = json.dumps({**json.loads(whole[50]), "time": "2026-11-27T09:00:00", "temperature": float("inf")})
    record = read_record(written(tmp_path, [*broken, *whole[:50], odd, *broken]), REFERENCE)
    assert record.names == [f"{number}.png" for number in range(51)]
    assert np.isnan(record.temperatures[50])
    assert track_picture(record).startswith(b"\x89PNG")


def test_what_is_no_record_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"events\.jsonl: expected the record of a watch"):
        read_record(tmp_path, REFERENCE)
    with pytest.raises(FileError, match="expected 3 frames or more that tell a pose, found 2"):
        read_record(written(tmp_path, lines()[:2]), REFERENCE)


def test_a_frame_that_cannot_tell_supports_no_pose() -> None:
    assert supported(GOOD) is None
    unknown = replace(GOOD, verdict="unknown", supported_pose=REFERENCE)
    assert supported(unknown) is None
