"""The studio without its pages: one thread that owns the devices, looks all the time, and does what it is asked."""

from __future__ import annotations

import hashlib
import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from retrue.calibration.result import Calibrated
from retrue.correspondences import Correspondences
from retrue.decoding.decode import decode
from retrue.devices.drivers import LiveRig, make_rig
from retrue.devices.exposure import find_exposure
from retrue.devices.recorder import Recorder
from retrue.devices.setup import Setup
from retrue.devices.shown_pictures import Picture, black_and_white
from retrue.errors import DeviceError, FileError, InputError, RetrueError
from retrue.files.history import capture_record, read_history, roll_back, write_in_place
from retrue.files.models import write_cloud
from retrue.files.rigs import read_rig, write_rig
from retrue.geometry.arrays import Image
from retrue.patterns.color_grid import ColorGrid, make_color_grid
from retrue.recalibration.recalibrate import recalibrate
from retrue.recalibration.result import Accepted
from retrue.recalibration.verify import verify
from retrue.reconstruction.reconstruct import reconstruct
from retrue.rig import Rig
from retrue.studio.calibrating import Calibrating, begun
from retrue.studio.drift_log import DriftLog, Reading, drift_in_words
from retrue.studio.look import Look, look_at
from retrue.studio.state import Offer, State

Wish = tuple[str, Callable[[LiveRig, ColorGrid], None]]
"""What is done in words, and the work."""
PAUSE = 1.0  # seconds until a device that is not there is tried again
REFRESH = 0.25  # seconds between two looks, as pages show them: frames in between are for nobody
WATCH_SECONDS = 5.0  # between two looks of a watch
OLD_FRAMES = 8  # that may wait in a camera
NO_RIG = "there is no rig yet: calibrate it"


@dataclass
class Studio:
    """Of one setup; rig, history, poses and scans lie in `folder`. Others use `state`, and the methods that ask.

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
    _calibrating: Calibrating | None = None
    _held_for: int = -1
    _scene: str = ""
    _looked: float = 0.0
    _watched: float = 0.0

    def __post_init__(self) -> None:
        self._drift = DriftLog(self.folder / "watch.jsonl")
        self._set(watching=self._drift.on, readings=tuple(self._drift.readings), rig_there=self.rig_path.exists())

    @property
    def rig_path(self) -> Path:
        return self.setup.rig or self.folder / "rig.json"

    @property
    def simulated(self) -> bool:
        """Whether the rig can be bumped from here."""
        return self.setup.camera["driver"] == "simulated"

    @property
    def begun(self) -> str:
        """The board of a calibration that can be gone on with; empty where there is none that can be read."""
        try:
            return begun(self._poses)
        except RetrueError:
            return ""

    @property
    def unit(self) -> str:
        """Of the rig; empty where there is none that can be read."""
        try:
            return self._rig().unit
        except RetrueError:
            return ""

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
        """Write the offered or calibrated rig in place; its history keeps the old one."""
        self._ask("writing the rig", self._keep)

    def undo(self) -> None:
        """Put back the rig that stood there before; an offer is dropped instead, where there is one."""
        self._ask("putting the rig back", self._undo)

    def scan(self) -> None:
        """Record pattern, white and black; reconstruct in true colours, and write the cloud."""
        self._ask("scanning", self._scan)

    def calibrate(self, board: str) -> None:
        """Begin to take poses of that board, or go on with those of a calibration that was begun."""
        self._ask("looking for the board", lambda live, pattern: self._begin(live, pattern, board))

    def fit(self) -> None:
        """The result of the poses so far."""
        self._ask("calibrating", lambda _live, _pattern: self._required().fit())

    def add_poses(self) -> None:
        """Take more poses after a result."""
        self._ask("going on", lambda _live, _pattern: self._required().go_on())

    def start_over(self) -> None:
        """Put the poses so far away, and take new ones."""

        def again(live: LiveRig, pattern: ColorGrid) -> None:
            calibrating = self._required()
            calibrating.put_away()
            self._begin(live, pattern, calibrating.board)

        self._ask("starting over", again)

    def leave(self) -> None:
        """Stop taking poses; they stay on the disk, and `calibrate` goes on with them."""
        self._ask("leaving", lambda live, _pattern: self._end_calibration(live))

    def watch(self, on: bool) -> None:
        """Check the rig every few seconds, or no longer."""

        def switch(_live: LiveRig, _pattern: ColorGrid) -> None:
            self._drift.switch(on)
            self._watched = 0.0
            self._set(watching=on, message="the rig is watched" if on else "the rig is not watched any more")

        self._ask("switching the watch", switch)

    def bump(self, degrees: float) -> None:
        """Turn the projector of a simulated rig."""

        def turn(live: LiveRig, _pattern: ColorGrid) -> None:
            if live.simulated is None:
                raise InputError("only a simulated rig can be bumped from here")
            before = live.simulated.true_rig.projector_from_camera
            live.simulated.bump((0.3 * degrees, 0.9 * degrees, 0.3 * degrees))
            try:
                write_rig(self._truth, live.simulated.true_rig)
            except FileError:
                live.simulated.move_to(before)
                raise
            self._set(message=f"the projector was turned by {degrees:g} deg", verification=None, offer=None)

        self._ask("bumping the rig", turn)

    @property
    def _poses(self) -> Path:
        return self.folder / "calibration"

    @property
    def _truth(self) -> Path:
        """Where a simulated rig really stands: as much as hardware would, that outlives us."""
        return self.folder / "simulated-rig.json"

    def _ask(self, what: str, work: Callable[[LiveRig, ColorGrid], None]) -> None:
        self._wishes.put((what, work))

    def _set(self, **changes: object) -> None:
        self.state = replace(self.state, **changes)  # type: ignore[arg-type]

    def _run(self) -> None:
        """Open the devices and look, again and again, until we are to stop: what goes away may come back."""
        gone = ""
        while not self._ended.is_set():
            try:
                with make_rig(self.setup, self._known_rig()) as live:
                    self._set(message="back again" if gone else self.state.message)
                    gone = ""
                    self._serve(live)
            except RetrueError as error:
                gone = str(error)
                self._set(look=None, busy="", message=gone)
                self._ended.wait(PAUSE)

    def _known_rig(self) -> Rig | None:
        """Where simulated devices stand, if anybody said."""
        paths = [self._truth, self.rig_path] if self.simulated else []
        return next((read_rig(path) for path in paths if path.exists()), None)

    def _serve(self, live: LiveRig) -> None:
        if live.simulated is not None:
            self._scene = live.simulated.options.scene
            write_rig(self._truth, live.simulated.true_rig)
        pattern = make_color_grid(live.projector.size)
        self._expose(live)
        live.projector.show(self._shown(live, pattern))
        before: Image | None = None
        while not self._ended.is_set():
            try:
                what, work = self._wishes.get_nowait()
            except queue.Empty:
                before = self._look(live, pattern, before)
                continue
            self._set(busy=what, message="")
            try:
                work(live, pattern)
            except DeviceError:
                raise
            except RetrueError as error:
                self._set(message=str(error))
            finally:
                self._set(busy="", rig_there=self.rig_path.exists())
            live.projector.show(self._shown(live, pattern))
            self._looked = 0.0
            before = self._look(live, pattern, self._settled(live))  # what was seen before it is no more

    def _expose(self, live: LiveRig) -> None:
        """Once, where nobody said how long; a camera that cannot be told is used as it is."""
        if "exposure_ms" in self.setup.camera or live.simulated is not None:
            return
        try:
            find_exposure(live.camera, live.projector)
        except DeviceError as error:
            self._set(message=str(error))

    def _shown(self, live: LiveRig, pattern: ColorGrid) -> Picture:
        return pattern.render() if self._calibrating is None else black_and_white(live.projector.size)[1]

    def _look(self, live: LiveRig, pattern: ColorGrid, before: Image | None) -> Image:
        picture = live.camera.frame().picture
        number = self.state.number + 1
        if self._calibrating is None:
            if time.monotonic() < self._looked:
                return picture
            self._looked = time.monotonic() + REFRESH
            look = look_at(pattern, picture, before)
            self._set(number=number, look=look, calibration=None)
            self._watch(look)
            return picture
        self._hold(live, self._calibrating)
        try:
            progress = self._calibrating.step(live, picture)
        except DeviceError:
            raise
        except RetrueError as error:  # a full disk: what was found stays wanted
            self._set(message=str(error))
            return picture
        nothing = Correspondences(np.empty((0, 2)), np.empty((0, 2)))
        look = Look(picture, nothing, progress.sentence, progress.good)
        self._set(number=number, look=look, calibration=progress)
        return picture

    def _watch(self, look: Look) -> None:
        """One reading, when it is time."""
        if not (self.state.watching and time.monotonic() >= self._watched and self.rig_path.exists()):
            return
        self._watched = time.monotonic() + WATCH_SECONDS
        try:
            found = verify(read_rig(self.rig_path), [look.points])
            self._drift.add(Reading.of(found))
        except RetrueError as error:
            self._set(message=str(error))
            return
        last = self.state.readings[-1].verdict if self.state.readings else "good"
        self._set(readings=tuple(self._drift.readings))
        if found.verdict != last and found.verdict == "drifted":
            self._set(message=f"drifted: {drift_in_words(found, self.unit)}; press Check")

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
        words = f"drifted: {drift_in_words(found, rig.unit)}; recalibrated: keep the new rig, or undo"
        self._set(offer=offer, message=words)

    def _keep(self, live: LiveRig, _pattern: ColorGrid) -> None:
        calibrating = self._calibrating
        if calibrating is not None and isinstance(calibrating.result, Calibrated):
            entry = write_in_place(self.rig_path, calibrating.result, list(map(capture_record, calibrating.records())))
            calibrating.put_away()
            self._end_calibration(live)
        elif self.state.offer is not None:
            look = self.state.look
            digest = hashlib.sha256(b"" if look is None else look.picture.tobytes()).hexdigest()
            entry = write_in_place(self.rig_path, self.state.offer.result, [{"name": "studio", "sha256": digest}])
        else:
            raise InputError("there is nothing to keep: check the rig first")
        self._set(offer=None, verification=None, message=f"kept as entry {entry.id} of the history")

    def _undo(self, _live: LiveRig, _pattern: ColorGrid) -> None:
        if self.state.offer is not None:
            self._set(offer=None, message="left as it was")
        elif not read_history(self.rig_path, last=1):
            self._set(message="there is nothing to undo")
        else:
            entry = roll_back(self.rig_path)
            self._set(verification=None, message=f"undone: entry {entry.id} of the history")

    def _scan(self, live: LiveRig, pattern: ColorGrid) -> None:
        rig = self._rig()
        black, white = black_and_white(live.projector.size)
        live.projector.show(white)
        self._settled(live)
        shown = [white, black, pattern.render()]
        frames = Recorder(live.camera, live.projector).record_held(shown)
        frames = frames or Recorder(live.camera, live.projector).record(shown)
        cloud = reconstruct(rig, decode(pattern, [frame.picture for frame in reversed(frames)]))
        path = self.folder / f"scan-{datetime.now(UTC):%Y%m%d-%H%M%S}.ply"
        write_cloud(path, cloud)
        self._set(cloud=cloud, message=f"{len(cloud)} points written to {path.name}")

    def _begin(self, live: LiveRig, pattern: ColorGrid, board: str) -> None:
        self._calibrating = None
        calibrating = Calibrating(self._poses, board, pattern, live.camera.frame().picture)
        if live.simulated is not None:
            calibrating.wished()  # raises where nobody could hold it
        self._held_for = -1
        self._calibrating = calibrating
        self._set(offer=None, verification=None)

    def _required(self) -> Calibrating:
        if self._calibrating is None:
            raise InputError("no calibration is going on")
        return self._calibrating

    def _end_calibration(self, live: LiveRig) -> None:
        self._calibrating = None
        self._set(calibration=None)
        if live.simulated is not None:
            live.simulated.set_scene(self._scene)

    def _hold(self, live: LiveRig, calibrating: Calibrating) -> None:
        """Whoever holds the board of a simulated rig does as the guide says."""
        if live.simulated is not None and self._held_for != len(calibrating.captures):
            self._held_for = len(calibrating.captures)
            live.simulated.hold(calibrating.wished())

    def _rig(self) -> Rig:
        if not self.rig_path.exists():
            raise InputError(NO_RIG)
        return read_rig(self.rig_path)

    def _settled(self, live: LiveRig) -> Image:
        """A frame of now: older ones may wait in the camera."""
        for _ in range(0 if live.camera.triggered else OLD_FRAMES):
            live.camera.frame()
        return live.camera.frame().picture
