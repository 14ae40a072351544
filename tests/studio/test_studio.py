"""The studio's life without pages: look, bump, check, keep, undo, scan; and after it was killed."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import retrue
from retrue.devices.drivers import LiveRig
from retrue.devices.options import SimulatedOptions
from retrue.devices.setup import Setup, parse_setup
from retrue.devices.simulated_rig import SimulatedRig, default_rig
from retrue.errors import DeviceError, FileError
from retrue.files.rigs import write_rig
from retrue.studio.look import look_at
from retrue.studio.studio import State, Studio

SETUP = parse_setup('[camera]\ndriver = "simulated"\n[projector]\ndriver = "simulated"\n')


def wait(studio: Studio, until: Callable[[State], object], seconds: float = 60.0) -> State:
    end = time.monotonic() + seconds
    while not until(studio.state):
        assert time.monotonic() < end, studio.state.message
        time.sleep(0.02)
    return studio.state


def asked(studio: Studio, wish: Callable[[], None]) -> State:
    """What stands when it is done."""
    studio._set(message="")
    wish()
    return wait(studio, lambda state: state.message and not state.busy)


@pytest.fixture
def studio(tmp_path: Path) -> Iterator[Studio]:
    """Of a rig that is calibrated already."""
    write_rig(tmp_path / "rig.json", default_rig(SimulatedOptions()))
    studio = Studio(SETUP, tmp_path)
    studio.start()
    yield studio
    studio.stop()


def test_a_bump_is_found_kept_and_undone(studio: Studio):
    look = wait(studio, lambda state: state.look is not None and state.number > 4).look
    assert look is not None
    assert look.good, look.sentence
    assert look.sentence.startswith("good: ")
    assert set(look.meters) == {"light", "clipping", "focus", "stillness", "blocks"}
    assert min(look.meters.values()) > 0.7

    before = retrue.read_rig(studio.rig_path)
    assert asked(studio, studio.check).message.startswith("good: ")
    asked(studio, lambda: studio.bump(3.0))
    state = asked(studio, studio.check)
    assert state.verification is not None
    assert state.verification.verdict == "drifted"
    said = r"drifted: points are \d+ mm off at \d+ mm \(sigma \S+ mm\), turned by \S+ deg; recalibrated: keep the .*"
    assert re.fullmatch(said, state.message)
    assert state.offer is not None
    assert len(state.offer.before) > 500
    assert retrue.read_rig(studio.rig_path) == before  # nothing is written before it is kept

    assert asked(studio, studio.keep).message == "kept as entry 2 of the history"
    kept = retrue.read_rig(studio.rig_path)
    turn = kept.projector_from_camera.R @ before.projector_from_camera.R.T
    assert np.degrees(np.arccos((np.trace(turn) - 1) / 2)) == pytest.approx(3.0, abs=0.3)
    assert asked(studio, studio.check).message.startswith("good: ")

    state = asked(studio, studio.scan)
    assert state.cloud is not None
    (scan,) = studio.folder.glob("scan-*.ply")
    assert state.message == f"{len(state.cloud)} points written to {scan.name}"

    assert asked(studio, studio.undo).message.startswith("undone")
    assert retrue.read_rig(studio.rig_path).projector_from_camera == before.projector_from_camera
    assert asked(studio, studio.keep).message == "there is nothing to keep: check the rig first"


def test_frames_that_no_page_shows_are_not_decoded(studio: Studio, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("retrue.studio.studio.REFRESH", 1e6)
    number = wait(studio, lambda state: state.look is not None).number
    frame, taken = SimulatedRig.frame, list[int]()
    monkeypatch.setattr(SimulatedRig, "frame", lambda rig: taken.append(1) or frame(rig))
    assert wait(studio, lambda _: len(taken) > 10).number <= number + 1  # one may have been under way
    number = studio.state.number
    asked(studio, studio.check)
    wait(studio, lambda state: state.number == number + 1)  # what was asked for is seen at once


def test_a_studio_that_was_killed_goes_on_with_the_rig_that_was_kept(studio: Studio, tmp_path: Path):
    wait(studio, lambda state: state.look is not None)
    asked(studio, lambda: studio.bump(2.0))
    asked(studio, studio.check)
    asked(studio, studio.keep)
    kept = studio.rig_path.read_bytes()
    again = Studio(SETUP, tmp_path)  # the first one still runs, as if it had been killed
    again.start()
    wait(again, lambda state: state.look is not None)
    assert asked(again, again.check).message.startswith("good: ")
    assert again.rig_path.read_bytes() == kept
    assert len(retrue.read_history(again.rig_path)) == 2
    again.stop()


def test_a_camera_that_goes_away_is_named_and_gone_on_with(studio: Studio, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("retrue.studio.studio.PAUSE", 0.05)
    wait(studio, lambda state: state.look is not None)
    with monkeypatch.context() as away:

        def gone(_rig: object) -> None:
            raise DeviceError("simulated camera", "sends no frames any more: is it plugged in?")

        away.setattr("retrue.devices.simulated_rig.SimulatedRig.frame", gone)
        state = wait(studio, lambda state: state.look is None)
        assert state.message == "simulated camera: sends no frames any more: is it plugged in?"
    assert wait(studio, lambda state: state.look is not None).message == "back again"


def test_a_disk_that_is_full_is_one_sentence_and_what_was_offered_can_be_kept_later(
    studio: Studio, monkeypatch: pytest.MonkeyPatch
):
    def no_room(*_: object) -> None:
        raise FileError(studio.rig_path, "cannot be written: No space left on device")

    wait(studio, lambda state: state.look is not None)
    with monkeypatch.context() as full:
        full.setattr("retrue.studio.studio.write_rig", no_room)
        assert "No space left" in asked(studio, lambda: studio.bump(2.0)).message
    assert asked(studio, studio.check).message.startswith("good: ")  # not bumped either
    asked(studio, lambda: studio.bump(2.0))
    assert asked(studio, studio.check).offer is not None
    before = studio.rig_path.read_bytes()
    with monkeypatch.context() as full:
        full.setattr("retrue.studio.studio.write_in_place", no_room)
        state = asked(studio, studio.keep)
        assert state.message == f"{studio.rig_path}: cannot be written: No space left on device"
        assert state.offer is not None
    assert studio.rig_path.read_bytes() == before
    assert asked(studio, studio.keep).message == "kept as entry 2 of the history"


def test_without_a_rig_nothing_is_checked_and_it_says_what_to_do(tmp_path: Path):
    studio = Studio(SETUP, tmp_path)
    studio.start()
    wait(studio, lambda state: state.look is not None)
    for wish in (studio.check, studio.scan):
        assert asked(studio, wish).message == "there is no rig yet: calibrate it"
    assert asked(studio, studio.keep).message == "there is nothing to keep: check the rig first"
    assert asked(studio, lambda: studio.calibrate("rubbish")).message.startswith("board: expected chessboard:")
    assert asked(studio, studio.fit).message == "no calibration is going on"
    assert studio.state.calibration is None
    assert not (tmp_path / "calibration").exists()
    studio.stop()


def test_a_rig_is_watched_until_that_is_switched_off_even_by_the_next_studio(
    studio: Studio, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("retrue.studio.studio.WATCH_SECONDS", 0.0)
    wait(studio, lambda state: state.look is not None)
    assert asked(studio, lambda: studio.watch(True)).watching
    wait(studio, lambda state: len(state.readings) >= 2)
    assert {reading.verdict for reading in studio.state.readings} == {"good"}
    asked(studio, lambda: studio.bump(3.0))
    state = wait(studio, lambda state: state.message.startswith("drifted: "))
    last = state.readings[-1]
    assert last.verdict == "drifted"
    assert last.drift is not None
    assert last.sigma is not None
    assert last.drift > 10 * last.sigma
    studio.stop()
    again = Studio(SETUP, tmp_path)
    assert again.state.watching
    assert again.state.readings == tuple(studio._drift.readings)


def test_one_sentence_says_what_to_do():
    demo = Path(retrue.__file__).parent / "demo_data"
    pattern, image = retrue.read_pattern(demo / "pattern.json"), retrue.read_image(demo / "scene.jpg")
    assert isinstance(pattern, retrue.ColorGrid)
    assert look_at(pattern, image).good
    assert look_at(pattern, image, image).good
    assert look_at(pattern, image, np.roll(image, 40, axis=1)).sentence == "hold still"
    assert look_at(pattern, image // 12).sentence.startswith("too dark: ")
    assert look_at(pattern, np.minimum(image.astype(int) * 12, 255).astype(np.uint8)).sentence.startswith("clipped: ")
    assert look_at(pattern, np.ascontiguousarray(image[:, ::-1])).sentence.startswith("mirrored: ")
    blurred = look_at(pattern, cv2.GaussianBlur(image, (0, 0), 3))
    assert blurred.sentence.startswith("out of focus: turn the lens of the camera or the projector")
    sharp, soft = (look_at(pattern, picture).meters["focus"] for picture in (image, cv2.GaussianBlur(image, (0, 0), 1)))
    assert sharp > soft > blurred.meters["focus"]
    plain = np.full_like(image, 120)
    assert not look_at(pattern, plain).good
    assert "focus" not in look_at(pattern, plain).meters  # nothing tells


@dataclass
class Unsettable:
    """A camera that neither tells its exposure nor lets it be set."""

    camera: Any
    name: str = "camera 0"
    triggered: bool = False
    exposure_ms: float | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self.camera, name)


def test_devices_that_are_not_there_are_named_and_waited_for_and_one_that_clips_is_used_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    problems = [
        DeviceError("screen 1", "there is no display: log in to a desktop, or set DISPLAY or WAYLAND_DISPLAY"),
        DeviceError(
            "screen 1", "there is no such screen, found 1, numbered 0 to 0: switch the projector on, plug it in"
        ),
        DeviceError("camera 0", "cannot be opened: is it plugged in?"),
    ]
    waiting, seen = list(problems), list[str]()
    rig = SimulatedRig(SimulatedOptions(bright_ms=2.0))

    def made(*_: object) -> LiveRig:
        if waiting:
            raise waiting.pop(0)
        return LiveRig(Unsettable(rig.camera), rig.projector)

    monkeypatch.setattr("retrue.studio.studio.make_rig", made)
    monkeypatch.setattr("retrue.studio.studio.PAUSE", 0.2)
    studio = Studio(Setup({"driver": "opencv"}, {"driver": "window"}), tmp_path)
    studio.start()

    def looks(state: State) -> bool:
        if state.message and state.message not in seen:
            seen.append(state.message)
        return state.look is not None

    state = wait(studio, looks)
    studio.stop()
    assert seen[:3] == [str(problem) for problem in problems]
    assert re.fullmatch(
        r"camera 0: \d+ % of the picture is clipped under white, and its exposure cannot be .*", state.message
    )
    assert state.look is not None
    assert state.look.sentence.startswith("clipped: ")
