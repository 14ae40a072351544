"""A calibration as it goes: the board found in each frame, poses taken by themselves when it is still, and the result.

Every pose is on the disk before it counts, as a capture that `retrue calibrate` reads, too: a studio that is killed
goes on with them.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from retrue.calibration.board import Board, parse_board
from retrue.calibration.board_capture import see_board
from retrue.calibration.calibrate import calibrate
from retrue.calibration.detection import BoardCorners, glimpse_board
from retrue.calibration.result import Calibrated, RefusedCalibration
from retrue.calibration.views import BoardCapture, picture_size, projected_view
from retrue.devices.drivers import LiveRig
from retrue.devices.recorder import Recorder
from retrue.devices.shown_pictures import black_and_white
from retrue.errors import FileError, InputError
from retrue.files.atomic import read_text, replaced_file
from retrue.files.board_captures import read_board_capture
from retrue.files.capture_folder import write_capture
from retrue.files.patterns import read_pattern, write_pattern
from retrue.geometry.arrays import FloatArray, Image
from retrue.patterns.color_grid import ColorGrid
from retrue.simulation.board_scene import HeldBoard
from retrue.studio.guide import Guide, SeenBoard

AIM = 8  # poses, at which the result is found by itself
FEWEST = 3  # from which it can be asked for
STILL_FRAMES = 2  # steps between frames, one after another, in which no corner moved
STILL = 1 / 1500  # of the picture's width
BOARD_FILE = "board.txt"
LONGEST_BOARD = 1000  # characters


@dataclass(frozen=True, slots=True, eq=False)
class Progress:
    """What a page shows of it.

    Attributes
    ----------
    board : as it was named.
    poses : so many were taken.
    sentence : what to do with the board now. `good` : whether that is to stay as it is.
    outline, wish : (4, 2) the board's outermost points in the camera's picture, as it is held and as it should be.
    camera_cells, projector_cells : of `CELLS`, where the board was.
    result : of the fit; None until there is one, or where poses are added to it.
    """

    board: str
    poses: int
    sentence: str
    good: bool
    outline: FloatArray | None
    wish: FloatArray | None
    camera_cells: frozenset[int]
    projector_cells: frozenset[int]
    result: Calibrated | RefusedCalibration | None


class Calibrating:
    """One calibration, in a folder of its own.

    Attributes
    ----------
    board : its spec, as people write it.
    captures : the poses, by the name of their folder.
    result : of the last fit of all poses; None where poses are to be taken.
    """

    def __init__(self, folder: Path, board: str, pattern: ColorGrid, picture: Image) -> None:
        """Go on with what lies in the folder, which is made where it is not there; of the board that lies there."""
        self._folder, self._pattern = folder, pattern
        there = begun(folder)
        self.board = there or board.strip()
        try:
            self._plan = parse_board(self.board)
        except InputError as error:
            raise FileError(folder / BOARD_FILE, str(error)) if there else error from None
        self._guide = Guide(self._plan, picture_size(picture), pattern.projector_size)
        self.captures: dict[str, BoardCapture] = {}
        self.result: Calibrated | RefusedCalibration | None = None
        self._last: BoardCorners | None = None
        self._still = 0
        self._write_plan()
        for path in sorted(folder.glob("pose-*")):
            with contextlib.suppress(InputError):  # it stays where it is, and does not count
                self._add(path.name, read_board_capture(path, pattern, self._plan))

    def step(self, live: LiveRig, picture: Image) -> Progress:
        """Look at a frame; where the board is worth it and still, take the pose."""
        if self.result is not None:
            return self._progress("look at the result: keep it, or add poses", good=True)
        corners = glimpse_board(picture, self._plan)
        seen = None if corners is None else self._guide.seen(corners)
        if corners is None or seen is None:
            self._last, self._still = None, 0
            return self._progress("hold the board into the outline, all of it")
        moved = np.inf if self._last is None else float(np.abs(corners.pixels - self._last.pixels).max())
        self._last = corners
        self._still = self._still + 1 if moved <= STILL * picture.shape[1] else 0
        if not self._guide.is_worth(seen):
            return self._progress(self._guide.advice(seen), corners)
        if self._still < STILL_FRAMES:
            return self._progress("hold it still", corners)
        self._still = 0
        problem = self._take(live)
        return self._progress(problem or f"taken: pose {len(self.captures)}", corners, good=not problem)

    def fit(self) -> None:
        """Find the rig from the poses so far. Raises `InputError` where they are too few."""
        if len(self.captures) < FEWEST:
            raise InputError(f"{len(self.captures)} poses were taken, expected {FEWEST} or more")
        self.result = calibrate(list(self.captures.values()), self._plan, self._pattern.projector_size)

    def go_on(self) -> None:
        """Take more poses."""
        self.result = None

    def records(self) -> list[Path]:
        """Folders of the poses."""
        return [self._folder / name for name in self.captures]

    def wished(self) -> HeldBoard:
        """The board as the guide wants it held."""
        if self._plan.kind != "chessboard":
            raise InputError(f"the simulated board is a chessboard, found {self._plan.kind}")
        return HeldBoard(self._guide.wish.pose, self._plan.spacing, self._plan.columns, self._plan.rows)

    def put_away(self) -> None:
        """The folder, under a name of its time, so that the next calibration begins anew."""
        away = self._folder.with_name(f"{self._folder.name}-{datetime.now(UTC):%Y%m%d-%H%M%S-%f}")
        try:
            self._folder.rename(away)
        except OSError as error:
            raise FileError(self._folder, f"cannot be renamed: {error.strerror or error}") from error

    def _take(self, live: LiveRig) -> str:
        """Take the pose; else what is in the way."""
        shown = [black_and_white(live.projector.size)[1], self._pattern.render()]
        frames = Recorder(live.camera, live.projector).record_held(shown)
        if frames is None:
            return "it moved: hold it still, or lean it against something"
        pictures = {name: frame.picture for name, frame in zip(("white", "grid"), frames, strict=True)}
        name = f"pose-{datetime.now(UTC):%Y%m%d-%H%M%S-%f}"
        capture = see_board(name, self._pattern, list(pictures.values()), list(pictures), self._plan)
        try:
            self._seen(capture)
        except InputError as error:
            return f"not taken: {error}"
        write_capture(self._folder / name, pictures)
        self._add(name, capture)
        if len(self.captures) >= AIM:
            self.fit()
        return ""

    def _add(self, name: str, capture: BoardCapture) -> None:
        self._guide = replace(self._guide, taken=(*self._guide.taken, self._seen(capture)))
        self.captures[name] = capture

    def _seen(self, capture: BoardCapture) -> SeenBoard:
        """Raises `InputError` where the pose cannot be used."""
        if capture.corners is None:
            raise InputError("the board is not found any more")
        view = projected_view(capture.name, capture.corners, capture.points, self._plan)
        seen = self._guide.seen(capture.corners, view.pixels[1])
        if seen is None:
            raise InputError("the corners of the board tell no pose")
        return seen

    def _write_plan(self) -> None:
        """What the pictures are of: the board's spec, and the pattern."""
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FileError(self._folder, f"cannot be made: {error.strerror or error}") from error
        with replaced_file(self._folder / BOARD_FILE) as stream:
            stream.write(f"{self.board}\n".encode())
        path = self._folder / "pattern.json"
        if not path.exists():
            write_pattern(path, self._pattern)
        elif not np.array_equal(read_pattern(path).render(), self._pattern.render()):
            raise FileError(path, "these poses were lit by another pattern: put their folder away, and begin anew")

    def _progress(self, sentence: str, corners: BoardCorners | None = None, *, good: bool = False) -> Progress:
        guide, asked = self._guide, self.result is None
        return Progress(
            self.board,
            len(self.captures),
            sentence,
            good,
            None if corners is None else outermost(self._plan, corners.pixels),
            outermost(self._plan, guide.wish.camera_px) if asked else None,
            frozenset(guide.covered("camera_px")),
            frozenset(guide.covered("projector_px")),
            self.result,
        )


def begun(folder: Path) -> str:
    """The board of a calibration that was begun there and not kept; empty where none was."""
    path = folder / BOARD_FILE
    return read_text(path, LONGEST_BOARD).strip() if path.exists() else ""


def outermost(board: Board, pixels: FloatArray) -> FloatArray:
    """(4, 2) of the board's points (N, 2), round it."""
    columns = board.grid[0]
    if len(pixels) == len(board.points):
        return pixels[[0, columns - 1, len(pixels) - 1, len(pixels) - columns]]
    sums, differences = pixels.sum(axis=1), pixels[:, 0] - pixels[:, 1]
    return pixels[[sums.argmin(), differences.argmax(), sums.argmax(), differences.argmin()]]


def result_rows(result: Calibrated | RefusedCalibration) -> Mapping[str, str]:
    """What came out and how sure it is, in words, by name."""
    if not isinstance(result, Calibrated):
        return {}
    rig, sigma = result.rig, result.evidence["sigma"]
    rows: dict[str, str] = {}
    for name, device in (("camera", rig.camera), ("projector", rig.projector)):
        width, height = device.size
        own = sigma[name]
        rows[name] = (
            f"{width} x {height}, focal length {device.K[0, 0]:.1f} px (sigma {own.get('fx', 0):.2g}), "
            f"principal point {device.K[0, 2]:.1f}, {device.K[1, 2]:.1f} (sigma {own.get('cx', 0):.2g}, "
            f"{own.get('cy', 0):.2g})"
        )
    pose, t = sigma["projector_from_camera"], rig.projector_from_camera.t
    turn = float(np.linalg.norm([pose[f"r{axis}_deg"] for axis in "xyz"]))
    shift = float(np.linalg.norm([pose[f"t{axis}"] for axis in "xyz"]))
    rows["pose"] = f"{np.linalg.norm(t):.1f} {rig.unit} apart (sigma {shift:.2g}), rotation sigma {turn:.2g} deg"
    error = result.evidence["predicted_error"]
    rows["points"] = f"known to {error['rms']:.2g} {rig.unit} at {error['at_distance']:.4g} {rig.unit}"
    left_out = result.evidence["left_out"]
    rows["left out"] = "; ".join(f"{Path(view['name']).name}: {view['reason']}" for view in left_out) or "nothing"
    return rows
