"""Folders, videos and the queue: nothing twice, nothing lost, nothing half-written, nothing without bound."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from retrue.errors import FileError
from retrue.files.images import SUFFIXES, write_png
from retrue.files.video import read_video
from retrue.watch.folder import FolderSource
from retrue.watch.frame_queue import FrameQueue
from retrue.watch.options import WatchOptions
from retrue.watch.temperature import last_reading, side_temperature
from retrue.watch.video import VideoSource

from .stream import SimulatedSource, frame

QUICK = WatchOptions(poll_seconds=0.005, settle_seconds=0.02, patience_seconds=0.1, idle_seconds=0.05)
PICTURE = np.arange(48, dtype=np.uint8).reshape(6, 8)
PNG = cv2.imencode(".png", PICTURE)[1].tobytes()


def drop(folder: Path, *names: str) -> None:
    for name in names:
        write_png(folder / name, PICTURE)


def taken(source: FolderSource) -> list:
    return list(source.frames(threading.Event()))


def test_pictures_come_once_in_the_order_of_arrival(tmp_path):
    drop(tmp_path, "b.png")
    time.sleep(0.02)
    drop(tmp_path, "a.png")
    (tmp_path / "notes.txt").write_text("stray")
    (tmp_path / ".hidden.png").write_bytes(PNG)
    (tmp_path / "folder.png").mkdir()
    frames = taken(FolderSource(tmp_path, QUICK))
    assert [item.name for item in frames] == ["b.png", "a.png"]
    assert all(np.array_equal(item.content, PICTURE) for item in frames)
    assert taken(FolderSource(tmp_path, QUICK, frames[-1].position)) == []
    (again,) = taken(FolderSource(tmp_path, QUICK, frames[0].position))
    assert again.name == "a.png"


def test_a_side_file_tells_the_temperature(tmp_path):
    (tmp_path / "1.json").write_text('{"temperature": 21.5, "gain": 2}')
    (tmp_path / "2.txt").write_text("2026-11-27T08:00:00, 19.25\n")
    (tmp_path / "3.json").write_text("{")
    (tmp_path / "4.json").write_text('{"temperature": "warm"}')
    (tmp_path / "5.txt").write_text("nan")
    found = [side_temperature(tmp_path / name) for name in ("1.json", "2.txt", "3.json", "4.json", "5.txt", "6.txt")]
    assert found == [21.5, 19.25, None, None, None, None]


def test_a_table_beside_a_photograph_is_no_frame_but_tells_its_temperature(tmp_path):
    drop(tmp_path, "1.png", "2.png")
    (tmp_path / "1.csv").write_text("2026-11-27T08:00:00;18.5\n")
    frames = taken(FolderSource(tmp_path, QUICK, suffixes=SUFFIXES))
    assert sorted((item.name, item.temperature) for item in frames) == [("1.png", 18.5), ("2.png", None)]


def test_a_half_written_picture_is_waited_for(tmp_path):
    source = FolderSource(tmp_path, WatchOptions(poll_seconds=0.005, settle_seconds=0.02, idle_seconds=0.4))
    (tmp_path / "slow.png").write_bytes(PNG[:30])

    def finish() -> None:
        time.sleep(0.15)
        drop(tmp_path, "quick.png")
        with (tmp_path / "slow.png").open("ab") as stream:
            stream.write(PNG[30:])

    writer = threading.Thread(target=finish)
    writer.start()
    frames = taken(source)
    writer.join()
    assert sorted(item.name for item in frames) == ["quick.png", "slow.png"]
    assert all(item.problem == "" for item in frames)


def test_a_broken_picture_is_passed_over_and_holds_nobody_up(tmp_path):
    (tmp_path / "broken.png").write_bytes(PNG[:30])
    drop(tmp_path, "good.png")
    good, broken = taken(FolderSource(tmp_path, QUICK))
    assert (good.name, good.position["waiting"]) == ("good.png", ["broken.png"])
    assert (broken.name, broken.content) == ("broken.png", None)
    assert broken.problem.startswith("not a picture")
    assert broken.position["waiting"] == []
    (again,) = taken(FolderSource(tmp_path, QUICK, good.position))
    assert again.name == "broken.png"


def test_a_broken_picture_is_told_before_a_backlog_is_done(tmp_path):
    (tmp_path / "broken.png").write_bytes(PNG[:30])
    time.sleep(0.02)
    drop(tmp_path, *(f"{number:02}.png" for number in range(40)))
    names = []
    for item in FolderSource(tmp_path, QUICK).frames(threading.Event()):
        names.append(item.name)
        time.sleep(0.01)
    assert names.index("broken.png") < 30
    assert sorted(names) == [*(f"{number:02}.png" for number in range(40)), "broken.png"]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("time,temperature\n2026-11-27T08:00:00,21.5\n2026-11-27T08:01:00,22.25\n", 22.25),
        ("08:00;21\n08:01;nan\n", 21.0),
        ("21.5\n22", 21.5),  # the last line is being written
        ("time,temperature\n", None),
        ("", None),
    ],
)
def test_the_last_temperature_is_read(tmp_path, text, value):
    path = tmp_path / "temperature.csv"
    assert last_reading(path) is None
    path.write_text("x\n" * 5000 + text)
    assert last_reading(path) == value
    assert last_reading(None) is None


def test_a_picture_that_goes_again_is_forgotten(tmp_path):
    (tmp_path / "broken.png").write_bytes(PNG[:30])
    source = FolderSource(tmp_path, WatchOptions(poll_seconds=0.005, settle_seconds=0, idle_seconds=0.05))
    remover = threading.Timer(0.1, (tmp_path / "broken.png").unlink)
    remover.start()
    assert taken(source) == []
    remover.join()


def test_a_picture_written_again_is_another_frame(tmp_path):
    drop(tmp_path, "a.png")
    (first,) = taken(FolderSource(tmp_path, QUICK))
    time.sleep(0.02)
    drop(tmp_path, "a.png")
    (second,) = taken(FolderSource(tmp_path, QUICK, first.position))
    assert second.name == "a.png"


@pytest.mark.parametrize("position", [{"after": 3}, {"after": [1, "a"]}, {"next": 5}])
def test_a_position_of_something_else_is_refused(tmp_path, position):
    with pytest.raises(FileError, match="position"):
        taken(FolderSource(tmp_path, QUICK, position))


def test_no_folder_is_an_error(tmp_path):
    with pytest.raises(FileError, match="folder"):
        taken(FolderSource(tmp_path / "none", QUICK))


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    path = tmp_path / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.CAP_OPENCV_MJPEG, cv2.VideoWriter.fourcc(*"MJPG"), 25, (64, 48))
    for number in range(12):
        writer.write(np.full((48, 64, 3), (0, 0, 20 * number), np.uint8))
    writer.release()
    return path


def test_a_video_is_red_green_blue_and_goes_on_at_the_frame(clip):
    frames = list(VideoSource(clip).frames(threading.Event()))
    assert [int(item.content[..., 0].mean().round(-1)) for item in frames] == [20 * number for number in range(12)]
    assert frames[5].content[..., 2].max() < 20
    rest = list(VideoSource(clip, frames[8].position).frames(threading.Event()))
    assert [item.name for item in rest] == ["frame 9", "frame 10", "frame 11"]
    assert rest[0].capture == frames[9].capture
    assert list(VideoSource(clip, frames[11].position).frames(threading.Event())) == []


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"#EXTM3U\n/etc/passwd\n",
        b"ffconcat version 1.0\nfile /etc/passwd\n",
        b"RIFF\0\0\0\0AVI rubbish",
        b"\0\0\0\x18ftypmp42\0\0\0\0mp42isom" + bytes(500),
    ],
)
def test_what_is_no_video_is_refused_and_nobody_else_speaks(tmp_path, capfd, content):
    (tmp_path / "a.avi").write_bytes(content)
    with pytest.raises(FileError, match=r"a\.avi: "):
        list(read_video(tmp_path / "a.avi"))
    assert capfd.readouterr() == ("", "")


def test_a_live_queue_drops_the_oldest_and_counts(tmp_path):
    queue = FrameQueue(3, drops=True)
    queue.fill_from(SimulatedSource(10), threading.Event())
    stop = threading.Event()
    names = []
    while (item := queue.take(stop)) is not None:
        names.append(item.name)
    assert names == ["frame 7", "frame 8", "frame 9"]
    assert (queue.take_dropped(), queue.take_dropped()) == (7, 0)


def test_any_other_queue_waits(tmp_path):
    queue = FrameQueue(2, drops=False)
    stop = threading.Event()
    grabber = threading.Thread(target=queue.fill_from, args=(SimulatedSource(10), stop))
    grabber.start()
    names = []
    while (item := queue.take(stop)) is not None:
        time.sleep(0.005)
        names.append(item.name)
    grabber.join()
    assert names == [f"frame {number}" for number in range(10)]
    assert queue.take_dropped() == 0


def test_a_queue_that_is_stopped_lets_both_sides_go():
    queue = FrameQueue(1, drops=False)
    stop = threading.Event()
    grabber = threading.Thread(target=queue.fill_from, args=(SimulatedSource(1000), stop))
    grabber.start()
    stop.set()
    grabber.join(timeout=5)
    assert not grabber.is_alive()
    assert queue.take(stop) is None


def test_what_a_source_raises_comes_after_what_it_gave():
    class Failing(SimulatedSource):
        def frames(self, stop):
            yield frame("only", None)
            raise FileError("camera", "unplugged")

    queue = FrameQueue(4, drops=False)
    stop = threading.Event()
    queue.fill_from(Failing(0), stop)
    assert queue.take(stop).name == "only"
    with pytest.raises(FileError, match="unplugged"):
        queue.take(stop)
