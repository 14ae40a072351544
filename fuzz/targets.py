"""One target a reader: bytes that anybody may hand over go in, and nothing but a `RetrueError` may come out."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from retrue.calibration.board import parse_board
from retrue.correspondences import Correspondences
from retrue.devices.drivers import make_rig
from retrue.devices.setup import parse_setup
from retrue.errors import RetrueError
from retrue.files.board_captures import read_board_capture
from retrue.files.captures import pictures_size
from retrue.files.foreign_rigs import RIG_FORMATS
from retrue.files.history import history_path, read_history, write_in_place
from retrue.files.images import read_image
from retrue.files.log_parts import records_of_part, write_part
from retrue.files.patterns import read_pattern, write_pattern
from retrue.files.ply import read_ply, write_mesh
from retrue.files.points import read_points, write_points
from retrue.files.rigs import read_device, read_rig, write_rig
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.patterns.color_grid import ColorGrid
from retrue.patterns.gray_code import GrayCode
from retrue.recalibration.result import Accepted, Evidence
from retrue.reconstruction.cloud import Mesh
from retrue.rig import Rig
from retrue.watch.state import WatchState, read_state, write_state

CAMERA = Camera((64, 48), [[70, 0, 32], [0, 71, 24], [0, 0, 1]], [-0.1, 0.01, 0, 0, 0, 0, 0, 0])
SIMPLE = Camera((64, 48), [[70, 0, 32], [0, 71, 24], [0, 0, 1]])
RIG = Rig(CAMERA, CAMERA, RigidTransform.from_rotation_vector([0, 0.1, 0], [-1.0, 0, 0]), "mm", {"rms_px": 0.1})
SIZE = (64, 48)
GRID = ColorGrid((100, 80), ((255, 0, 0), (0, 255, 0)), 19.0, 12.5, (10.5, 12.0), ((0, 1, 0), (1, 1, 0), (1, 0, 0)))
BOARDS = (b"chessboard:7x9:75mm", b"charuco:8x6:30mm:22mm:DICT_4X4_50", b"asymmetric-circles:4x11:.5in")
SETUPS = (
    b'rig = "r.json"\n[camera]\ndriver = "opencv"\ndevice = 0\n[projector]\ndriver = "window"\nsize = [64, 48]\n',
    b'[camera]\ndriver = "genicam"\nproducer = "p.cti"\nfps = 3.5\n[projector]\ndriver = "window"\nscreen = 1\n',
)
LONGEST_ERROR = 1000  # characters


@dataclass(frozen=True, slots=True)
class Target:
    """A reader of a file, and files that it reads."""

    name: str
    read: Callable[[Path], object]
    seeds: Sequence[bytes]

    def __call__(self, content: bytes) -> None:
        """Read a file of that content; whatever is raised but a `RetrueError` is a fault."""
        path = FOLDER / f"{self.name}.json"
        path.write_bytes(content)
        try:
            self.read(path)
        except RetrueError as error:
            if "\n" in str(error) or len(str(error)) > LONGEST_ERROR:
                raise TypeError(f"expected an error of one line that can be read, found {error}") from error


def _written(write: Callable[[Path], object]) -> bytes:
    path = FOLDER / "seed"
    write(path)
    return path.read_bytes()


def _rig_seeds() -> list[bytes]:
    seeds: list[bytes] = []
    for to in RIG_FORMATS:
        for suffix in ("json", "yaml", "xml"):
            try:
                write_rig(FOLDER / f"seed.{suffix}", RIG, to)
            except RetrueError:  # not every format takes every lens
                write_rig(FOLDER / f"seed.{suffix}", Rig(SIMPLE, SIMPLE, RIG.projector_from_camera), to)
            seeds.append((FOLDER / f"seed.{suffix}").read_bytes())
    return list(dict.fromkeys(seeds))


def _history_seed() -> bytes:
    rig = FOLDER / "placed.json"
    write_rig(rig, RIG)
    write_in_place(rig, Accepted(RIG, "because", Evidence(7)))
    return history_path(rig).read_bytes()


def _read_history(path: Path) -> None:
    path.rename(history_path(path))
    read_history(path)


def _part_seed() -> bytes:
    folder = FOLDER / "parts"
    write_part(folder, 1, 2, _history_seed().splitlines())
    return (folder / "000000001-000000002.jsonl.gz").read_bytes()


def _read_setup(path: Path) -> object:
    setup = parse_setup(path.read_text(errors="surrogateescape"), path)
    return None if "simulated" in (setup.camera["driver"], setup.projector["driver"]) else make_rig(setup)


def _read_board(path: Path) -> None:
    parse_board(path.read_bytes().decode("latin-1"))


def _read_board_capture(path: Path) -> None:
    """The file is the white picture of a capture, beside a dark one."""
    folder = path.with_suffix(".capture")
    folder.mkdir(exist_ok=True)
    path.replace(folder / "white.png")
    (folder / "grid.png").write_bytes(cv2.imencode(".png", np.zeros((12, 16, 3), np.uint8))[1].tobytes())
    pictures_size(folder)
    read_board_capture(folder, GRID, parse_board("chessboard:3x3:1mm"))


def _image_seeds() -> list[bytes]:
    ramp = np.add.outer(np.arange(12), np.arange(16)).astype(np.uint8)
    pictures = (ramp, np.stack([ramp] * 3, axis=-1), ramp.astype(np.uint16) * 257)
    seeds = [cv2.imencode(suffix, picture)[1].tobytes() for suffix in (".png", ".tif") for picture in pictures]
    return seeds + [
        cv2.imencode(suffix, picture)[1].tobytes() for suffix in (".jpg", ".bmp") for picture in pictures[:2]
    ]


def _point_seeds() -> list[bytes]:
    px = np.arange(8.0).reshape(4, 2)
    rich = Correspondences(
        px,
        px,
        np.ones(4),
        np.ones(4),
        np.ones(4),
        np.zeros((4, 3), np.uint8),
        np.zeros((4, 2), np.int64),
        light=np.array([1.0, np.nan, 2.5, 0.0]),
        light_class=np.arange(4),
        camera_size=(64, 48),
        projector_size=(32, 24),
    )
    return [_written(partial(write_points, points=points)) for points in (Correspondences(px, px), rich)]


def _pattern_seeds() -> list[bytes]:
    patterns = (GrayCode((64, 48)), GrayCode((64, 48), step=4, offset=(3, 5)), GRID)
    return [_written(partial(write_pattern, pattern=pattern)) for pattern in patterns]


def _mesh_seed() -> bytes:
    mesh = Mesh(np.eye(3), np.zeros((3, 3), np.uint8), np.array([[0, 1, 2]]), "mm")
    return _written(lambda path: write_mesh(path, mesh))


_folder = tempfile.TemporaryDirectory()
FOLDER = Path(_folder.name)
TARGETS = {
    target.name: target
    for target in (
        Target("rig", read_rig, _rig_seeds()),
        Target(
            "rig-sized",
            lambda path: read_rig(path, camera_size=SIZE, projector_size=SIZE, unit="mm"),
            _rig_seeds(),
        ),
        Target("device", lambda path: read_device(path, "camera", size=SIZE), _rig_seeds()),
        Target("board", _read_board, BOARDS),
        Target("board-capture", _read_board_capture, _image_seeds()),
        Target("pattern", read_pattern, _pattern_seeds()),
        Target("points", read_points, _point_seeds()),
        Target("image", read_image, _image_seeds()),
        Target("history", _read_history, [_history_seed()]),
        Target("history-part", lambda path: list(records_of_part(path)), [_part_seed()]),
        Target(
            "state", lambda path: read_state(path, "source"), [_written(lambda p: write_state(p, WatchState("source")))]
        ),
        Target("ply", read_ply, [_mesh_seed()]),
        Target("setup", _read_setup, SETUPS),
    )
}
