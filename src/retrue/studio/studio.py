"""The studio without its pages: one thread that owns the devices, looks all the time, and does what it is asked."""

from __future__ import annotations

import hashlib
import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

from retrue.decoding.decode import decode
from retrue.devices.drivers import LiveRig, make_rig
from retrue.devices.recorder import Recorder
from retrue.devices.setup import Setup
from retrue.devices.shown_pictures import black_and_white
from retrue.errors import DeviceError, InputError, RetrueError
from retrue.files.history import read_history, roll_back, write_in_place
from retrue.files.models import write_cloud
from retrue.files.rigs import read_rig, write_rig
from retrue.geometry.arrays import Image
from retrue.patterns.color_grid import ColorGrid, make_color_grid
from retrue.recalibration.recalibrate import recalibrate
from retrue.recalibration.result import Accepted, Verification
from retrue.recalibration.verify import verify
from retrue.reconstruction.cloud import Cloud
from retrue.reconstruction.reconstruct import reconstruct
from retrue.rig import Rig
from retrue.studio.look import Look, look_at

Wish = tuple[str, Callable[[LiveRig, ColorGrid], None]]
"""What is done in words, and the work."""
PAUSE = 1.0  # seconds until a device that is not there is tried again


@dataclass(frozen=True, slots=True, eq=False)
class Offer:
    """A recalibrated rig that waits for a word: keep it, or leave it."""

    result: Accepted
    before: Cloud
    after: Cloud


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """All that a page shows; a new one replaces it, so that whoever reads it sees one moment.

    Attributes
    ----------
    number : grows with every look.
    look : at the latest frame; None before the first.
    busy : what is being done; empty where nothing is.
    message : what came of the last thing that was asked, or what is wrong with a device.
    verification : of the last check.
    offer : after a check that found the rig drifted and could tell its new pose.
    cloud : the last scan.
    """

    number: int = 0
    look: Look | None = None
    busy: str = ""
    message: str = ""
    verification: Verification | None = None
    offer: Offer | None = None
    cloud: Cloud | None = None


@dataclass
class Studio:
    """Of one setup; rig, history and scans lie in `folder`. Others use `state`, and the methods that ask.

    Attributes
    ----------
    rig_path : of the rig that is looked after; that of the setup, or rig.json in the folder.
    """

    setup: Setup
    folder: Path
    state: State = field(default_factory=State)
    _wishes: queue.Queue[Wish] = field(default_factory=lambda: queue.Queue[Wish]())
    _ended: threading.Event = field(default_factory=threading.Event)
    _thread: threading.Thread | None = None

    @property
    def rig_path(self) -> Path:
        return self.setup.rig or self.folder / "rig.json"

    @property
    def simulated(self) -> bool:
        """Whether the rig can be bumped from here."""
        return self.setup.camera["driver"] == "simulated"

    def start(self) -> None:
        """Begin to look."""
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Finish what is being done, and let go of the devices."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join(timeout=10.0)

    def check(self) -> None:
        """Verify the rig; where it has drifted, find its new pose and offer it."""
        self._ask("checking", self._check)

    def keep(self) -> None:
        """Write the offered rig in place; its history keeps the old one."""
        self._ask("writing the rig", self._keep)

    def undo(self) -> None:
        """Put back the rig that stood there before; an offer is dropped instead, where there is one."""
        self._ask("putting the rig back", self._undo)

    def scan(self) -> None:
        """Record pattern, white and black; reconstruct in true colours, and write the cloud."""
        self._ask("scanning", self._scan)

    def bump(self, degrees: float) -> None:
        """Turn the projector of a simulated rig."""

        def turn(live: LiveRig, _pattern: ColorGrid) -> None:
            if live.simulated is None:
                raise InputError("only a simulated rig can be bumped from here")
            live.simulated.bump((0.3 * degrees, 0.9 * degrees, 0.3 * degrees))
            self._set(message=f"the projector was turned by {degrees:g} deg", verification=None, offer=None)

        self._ask("bumping the rig", turn)

    def _ask(self, what: str, work: Callable[[LiveRig, ColorGrid], None]) -> None:
        self._wishes.put((what, work))

    def _set(self, **changes: object) -> None:
        self.state = replace(self.state, **changes)  # type: ignore[arg-type]

    def _run(self) -> None:
        """Open the devices and look, again and again, until we are to stop: what goes away may come back."""
        gone = ""
        while not self._ended.is_set():
            try:
                known = read_rig(self.rig_path) if self.rig_path.exists() else None
                with make_rig(self.setup, known) as live:
                    if gone:
                        self._set(message="back again")
                    gone = ""
                    self._serve(live)
            except RetrueError as error:
                gone = str(error)
                self._set(look=None, busy="", message=gone)
                self._ended.wait(PAUSE)

    def _serve(self, live: LiveRig) -> None:
        if live.simulated is not None and not self.rig_path.exists():
            write_rig(self.rig_path, live.simulated.true_rig)
        pattern = make_color_grid(live.projector.size)
        shown = pattern.render()
        live.projector.show(shown)
        before: Image | None = None
        while not self._ended.is_set():
            try:
                what, work = self._wishes.get_nowait()
            except queue.Empty:
                picture = live.camera.frame().picture
                self._set(number=self.state.number + 1, look=look_at(pattern, picture, before))
                before = picture
                continue
            self._set(busy=what, message="")
            try:
                work(live, pattern)
            except DeviceError:
                raise
            except RetrueError as error:
                self._set(message=str(error))
            finally:
                self._set(busy="")
            live.projector.show(shown)
            before = None

    def _check(self, live: LiveRig, pattern: ColorGrid) -> None:
        rig = self._rig()
        picture = self._settled(live)
        points = decode(pattern, picture)
        found = verify(rig, [points])
        self._set(verification=found, offer=None, message=f"{found.verdict}: {found.reason}")
        if found.verdict != "drifted":
            return
        result = recalibrate(rig, [points])
        if not isinstance(result, Accepted):
            self._set(message=f"drifted, but this picture cannot tell the new pose: {result.reason}")
            return
        offer = Offer(result, reconstruct(rig, points), reconstruct(result.rig, points))
        self._set(offer=offer, message=f"drifted: {found.reason}; recalibrated: {result.reason}")

    def _keep(self, _live: LiveRig, _pattern: ColorGrid) -> None:
        if self.state.offer is None:
            raise InputError("there is nothing to keep: check the rig first")
        look = self.state.look
        digest = hashlib.sha256(b"" if look is None else look.picture.tobytes()).hexdigest()
        entry = write_in_place(self.rig_path, self.state.offer.result, [{"name": "studio", "sha256": digest}])
        self._set(offer=None, verification=None, message=f"kept as entry {entry.id} of the history")

    def _undo(self, _live: LiveRig, _pattern: ColorGrid) -> None:
        if self.state.offer is not None:
            self._set(offer=None, message="left as it was")
        elif not read_history(self.rig_path):
            self._set(message="there is nothing to undo")
        else:
            entry = roll_back(self.rig_path)
            self._set(verification=None, message=f"undone: entry {entry.id} of the history")

    def _scan(self, live: LiveRig, pattern: ColorGrid) -> None:
        rig = self._rig()
        black, white = black_and_white(live.projector.size)
        frames = Recorder(live.camera, live.projector).record([pattern.render(), black, white])
        points = decode(pattern, [frame.picture for frame in frames])
        cloud = reconstruct(rig, points)
        path = self.folder / f"scan-{datetime.now(UTC):%Y%m%d-%H%M%S}.ply"
        write_cloud(path, cloud)
        self._set(cloud=cloud, message=f"{len(cloud)} points written to {path.name}")

    def _rig(self) -> Rig:
        if not self.rig_path.exists():
            raise InputError(f"{self.rig_path.name} is not there yet: calibrate the rig first, with retrue calibrate")
        return read_rig(self.rig_path)

    def _settled(self, live: LiveRig) -> Image:
        """A frame of now: older ones may wait in the camera."""
        for _ in range(0 if live.camera.triggered else 8):
            live.camera.frame()
        return live.camera.frame().picture
