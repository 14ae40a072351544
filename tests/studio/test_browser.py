"""The studio as people use it, in headless Chromium: from an empty folder to a rig that was bumped and mended."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
import tomllib
import urllib.error
import urllib.request
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

import retrue
from retrue.devices.drivers import make_rig
from retrue.devices.setup import parse_setup
from retrue.geometry.transform import direction_angle, rotation_angle
from tests.docs.pages import DOCS, ROOT, blocks

CODE = "from retrue.cli.main import main; import sys; sys.exit(main())"
PATIENCE = 60_000  # ms
# NiceGUI behaves in another way where it takes itself to be tested by its own tools.
ENVIRONMENT = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST", "NICEGUI"))}
if "PYTHONPATH" in ENVIRONMENT:  # also where a server runs in another folder
    ENVIRONMENT["PYTHONPATH"] = os.pathsep.join(
        str(Path(path).absolute()) for path in ENVIRONMENT["PYTHONPATH"].split(os.pathsep)
    )
SCREENS = (1280, 900), (390, 844)


def started(words: Sequence[str], folder: Path) -> subprocess.Popen[str]:
    """`retrue` with those words, in that folder."""
    command = [sys.executable, "-c", CODE, *words]
    return subprocess.Popen(
        command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=ENVIRONMENT, cwd=folder
    )


class Server:
    """`retrue studio --simulated`, or what else `words` say, in a folder, until it is ended."""

    def __init__(self, folder: Path, words: Sequence[str] = ("--simulated",)) -> None:
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.port = free.getsockname()[1]
        words = ["studio", *words, "--folder", str(folder), "--port", str(self.port)]
        self.process = started(words, folder.parent)
        assert self.process.stderr is not None
        found = re.search(r"open (http://\S+) ", self.process.stderr.readline())
        assert found is not None
        self.address = found[1]

    def end(self, how: signal.Signals = signal.SIGINT) -> tuple[int, str]:
        """Exit status, and what it printed after its address."""
        self.process.send_signal(how)
        out, err = self.process.communicate(timeout=60)
        return self.process.returncode, out + err


def opened(browser: Any, address: str, complaints: list[str], **how: Any) -> Any:
    from playwright.sync_api import expect

    expect.set_options(timeout=PATIENCE)
    page = browser.new_context(**how).new_page()
    page.set_default_timeout(PATIENCE)
    page.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    for _ in range(300):
        try:
            page.goto(address)
            break
        except Exception:  # not listening yet
            page.wait_for_timeout(200)
    return page


def answered(address: str, headers: dict[str, str]) -> int:
    """The status, as soon as somebody answers."""
    end = time.monotonic() + PATIENCE / 1000
    while True:
        try:
            with urllib.request.urlopen(urllib.request.Request(address, headers=headers), timeout=10) as answer:
                return answer.status
        except urllib.error.HTTPError as error:
            with error:
                return error.code
        except OSError:  # nobody listens yet
            assert time.monotonic() < end
            time.sleep(0.1)


def press(page: Any, button: str, answer: str) -> None:
    from playwright.sync_api import expect

    page.get_by_role("button", name=button, exact=True).click()
    expect(page.get_by_role("status")).to_contain_text(re.compile(answer), timeout=PATIENCE)


def require_fitting(page: Any, name: str) -> None:
    """Wide and narrow, light and dark, nothing hangs over the screen's edge."""
    for width, height in SCREENS:
        page.set_viewport_size({"width": width, "height": height})
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme=scheme)
            page.wait_for_function(
                "scheme => document.body.classList.contains('body--dark') === (scheme === 'dark')", arg=scheme
            )
            assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), (name, width, scheme)
    page.set_viewport_size({"width": 1280, "height": 900})


def errors_deg(folder: Path) -> tuple[float, float]:
    """Of the rig in place to where its devices are: rotation, and direction of t."""
    found, true = (retrue.read_rig(folder / name).projector_from_camera for name in ("rig.json", "simulated-rig.json"))
    return float(np.degrees(rotation_angle(found.R @ true.R.T))), float(np.degrees(direction_angle(found.t, true.t)))


def require_accurate(folder: Path) -> None:
    """As exact as a pose from one picture is to be, a calibration from nothing included."""
    rotation, direction = errors_deg(folder)
    assert rotation < 0.10
    assert direction < 0.25


def test_from_an_empty_folder_to_a_rig_that_is_calibrated_bumped_and_mended(browser: Any, tmp_path: Path):
    from playwright.sync_api import expect

    complaints = list[str]()
    folder = tmp_path / "studio"
    server = Server(folder)
    try:
        page = opened(browser, server.address, complaints, viewport={"width": 1280, "height": 900})
        expect(page.get_by_text(re.compile(r"^good: \d+ blocks are seen"))).to_be_visible(timeout=PATIENCE)
        assert page.url == f"http://127.0.0.1:{server.port}/"  # the token does not stay in the address bar
        expect(page.locator("svg circle").first).to_be_attached()
        expect(page.get_by_role("status")).to_have_text("there is no rig yet: calibrate it")
        for name in ("Check", "Keep", "Undo", "Scan"):
            expect(page.get_by_role("button", name=name, exact=True)).to_be_disabled()
        require_fitting(page, "1-empty")

        page.get_by_role("button", name="Calibrate", exact=True).click()
        expect(page.get_by_text(re.compile("[3-8] of 8 poses"))).to_be_visible(timeout=PATIENCE)
        server.end(signal.SIGKILL)  # in the middle
        taken = sorted(path.name for path in (folder / "calibration").glob("pose-*"))
        assert len(taken) >= 3
        assert not (folder / "rig.json").exists()

        server = Server(folder)
        page = opened(browser, server.address, complaints, viewport={"width": 1280, "height": 900})
        page.get_by_role("button", name="Calibrate", exact=True).click()
        expect(page.locator("polygon.wish")).to_be_attached(timeout=PATIENCE)
        require_fitting(page, "2-calibrating")
        expect(page.get_by_text(re.compile("^calibrated: "))).to_be_visible(timeout=2 * PATIENCE)
        expect(page.get_by_text("8 of 8 poses")).to_be_visible()
        assert {path.name for path in (folder / "calibration").glob("pose-*")} > set(taken)
        require_fitting(page, "3-calibrated")
        press(page, "Keep", "^kept as entry 1 ")
        calibrated = retrue.read_rig(folder / "rig.json")
        require_accurate(folder)

        press(page, "Scan", "points written to scan-")
        expect(page.get_by_text(re.compile(r"^good: \d+ blocks are seen"))).to_be_visible()  # no board is held any more
        require_fitting(page, "4-scanned")
        page.get_by_role("switch", name="Watch").click()
        expect(page.get_by_role("img", name=re.compile("drift over time, [1-9]"))).to_be_visible(timeout=PATIENCE)
        press(page, "Check", "^good: ")
        page.get_by_role("button", name="Bump", exact=True).click()
        expect(page.get_by_role("status")).to_contain_text(
            re.compile(r"^drifted: points are \d+ mm off at \d+ mm .*; press Check"), timeout=PATIENCE
        )
        expect(page.get_by_role("status")).to_have_class(re.compile("text-orange"))
        require_fitting(page, "5-watched")
        page.get_by_role("switch", name="Watch").click()
        expect(page.get_by_role("status")).to_contain_text("not watched any more", timeout=PATIENCE)
        other = opened(browser, server.address, complaints, viewport={"width": 390, "height": 844}, color_scheme="dark")
        press(other, "Check", "^drifted: .* recalibrated: keep the new rig, or undo")
        expect(page.get_by_role("status")).to_contain_text("recalibrated", timeout=PATIENCE)  # both tabs show the same
        expect(page.get_by_text("left: with the rig as it is in the file; right: with the new rig")).to_be_visible()
        space = page.frame_locator("iframe")
        expect(space.locator(".space[data-ready]")).to_be_visible(timeout=PATIENCE)
        space.get_by_label("From before to after").fill("20")
        canvas = space.locator("canvas").bounding_box()
        assert canvas is not None
        assert min(canvas["width"], canvas["height"]) > 200
        require_fitting(page, "6-drifted")
        assert retrue.read_rig(folder / "rig.json") == calibrated  # nothing is written before it is kept
        press(page, "Keep", "^kept as entry 2 ")
        require_accurate(folder)

        server.end(signal.SIGKILL)
        kept = (folder / "rig.json").read_bytes()
        server = Server(folder)
        page = opened(browser, server.address, complaints, viewport={"width": 1280, "height": 900})
        press(page, "Check", "^good: ")
        assert (folder / "rig.json").read_bytes() == kept
        press(page, "Undo", "undone")
        assert retrue.read_rig(folder / "rig.json").projector_from_camera == calibrated.projector_from_camera
        page.get_by_role("button", name="Check", exact=True).focus()  # and by keyboard
        page.keyboard.press("Enter")
        expect(page.get_by_role("status")).to_contain_text("drifted", timeout=PATIENCE)
        # A server that is killed refuses, or breaks off what it was sending.
        killed = ("REFUSED", "CONNECTION_RESET", "EMPTY_RESPONSE", "CONTENT_LENGTH_MISMATCH", "WebSocket")
        assert [line for line in complaints if not any(word in line for word in killed)] == []
        status, said = server.end()
        assert (status, said) == (0, "ended\n")
    finally:
        server.process.kill()
        server.process.communicate()


def test_the_quick_start_opens_the_studio_as_it_stands(tmp_path: Path):
    page = (DOCS / "quick-start.md").read_text(encoding="utf-8")
    calls = [line for block in blocks(page) if block.language == "sh" for line in block.text.splitlines()]
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    assert calls == ['pip install ".[studio]"', "retrue studio --simulated", "retrue studio setup.toml"]
    assert "studio" in extras
    (setup,) = [block.text for block in blocks(page) if block.language == "toml"]
    parsed = parse_setup(setup)
    make_rig(parsed)  # each setting is one that its driver has
    (tmp_path / "setup.toml").write_text((DOCS / "try" / "setup.toml").read_text())
    for call in calls[1:]:
        process = started(call.split()[1:], tmp_path)
        try:
            assert process.stderr is not None
            found = re.search(r"open (http://127\.0\.0\.1:8090/\?token=\S+) ", process.stderr.readline())
            assert found is not None
            assert answered(found[1].partition("?")[0], {}) == 401  # somebody is there, who asks for the token
        finally:
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=60)


def test_a_fleet_is_seen_from_what_its_watch_has_left(browser: Any, tmp_path: Path):
    from playwright.sync_api import expect

    for name, verdict in (("cell 1", "good"), ("cell 2", "drifted")):
        begin = datetime(2026, 11, 27, 8, tzinfo=UTC)
        lines = [
            {
                "time": (begin + timedelta(minutes=minute)).isoformat(), "event": "frame", "verdict": verdict,
                "unit": "m", "reason": "", "drift": {"displacement": 1e-4 * minute}, "temperature": 20 + minute / 10,
            }
            for minute in range(30)
        ]  # fmt: skip
        (tmp_path / "out" / name).mkdir(parents=True)
        (tmp_path / "out" / name / "events.jsonl").write_text("\n".join(map(json.dumps, lines)))
    server = Server(tmp_path / "studio", ["--fleet", str(tmp_path / "out")])
    try:
        complaints = list[str]()
        page = opened(browser, server.address, complaints)
        assert page.url.endswith("/fleet")
        expect(page.get_by_role("row")).to_have_count(3)
        expect(page.get_by_role("row", name="cell 2")).to_contain_text("drifted")
        said = "drift, at most 2.9 mm; 20 to 22.9 degrees"
        expect(page.get_by_role("img").first).to_have_attribute("aria-label", said)
        for width, height in SCREENS:
            page.set_viewport_size({"width": width, "height": height})
            assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), width
        assert not complaints
        assert answered(f"http://127.0.0.1:{server.port}/fleet", {}) == 401
        assert not (tmp_path / "studio").exists()
    finally:
        assert server.end()[0] == 0
    words = ["studio", "--fleet", str(tmp_path / "none")]
    done = subprocess.run([sys.executable, "-c", CODE, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert f"{tmp_path / 'none'}: expected the folder of `retrue watch fleet.toml --out DIR`" in done.stderr


def test_nobody_gets_in_without_the_token_and_a_port_in_use_is_one_sentence(tmp_path: Path):
    shown = ["--fleet", str(tmp_path)]  # no rig, which would decode all the while
    server = Server(tmp_path, shown)
    try:
        address = f"http://127.0.0.1:{server.port}/"
        for headers, status in (({}, 401), ({"Host": "evil.example"}, 403), ({"Origin": "http://evil.example"}, 403)):
            assert answered(address, headers) == status
        words = ["studio", *shown, "--port", str(server.port)]
        command = [sys.executable, "-c", CODE, *words]
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=ENVIRONMENT)
        assert done.returncode == 2
        assert f"cannot listen on 127.0.0.1:{server.port}: " in done.stderr
        assert done.stderr.count("\n") == 1
    finally:
        server.end()
