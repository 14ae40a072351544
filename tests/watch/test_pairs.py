"""Frames of two cameras become pairs by their time, whichever comes first, and what has no partner is named."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import pytest

from retrue import FileError
from retrue.watch.frame import Frame
from retrue.watch.pairs import PairedSource

PICTURE = np.zeros((2, 2), np.uint8)


@dataclass
class Given:
    """A source that gives frames of those names at once."""

    names: list[str]
    live: bool = False
    problem: str = ""
    raises: Exception | None = None
    temperature: float | None = None
    given: list[str] = field(default_factory=list)

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        for name in self.names:
            self.given.append(name)
            content = None if self.problem else PICTURE
            position, capture = {"after": [0, name], "waiting": []}, {"name": name, "sha256": "f"}
            yield Frame(name, content, position, capture, self.problem, self.temperature)
        if self.raises is not None:
            raise self.raises


def paired(left: list[str], right: list[str]) -> list[tuple[str, str]]:
    source = PairedSource(Given(left), Given(right))
    return [(frame.name, frame.problem) for frame in source.frames(threading.Event())]


def test_numbers_pair_and_the_frame_without_a_partner_is_named() -> None:
    found = paired([f"l{n}.png" for n in (1, 2, 3, 5)], [f"r{n}.png" for n in (1, 3, 4, 5)])
    assert found == [
        ("l1.png, r1.png", ""),
        ("l2.png", "no frame of the other camera is of its time"),
        ("l3.png, r3.png", ""),
        ("r4.png", "no frame of the other camera is of its time"),
        ("l5.png, r5.png", ""),
    ]


def test_time_stamps_pair_within_a_quarter_of_a_step() -> None:
    stamps = [1_000_000_000 + 50_000_000 * k for k in range(8)]
    left = [f"{stamp}.png" for stamp in stamps]
    right = [f"{stamp + 4_000_000 * (-1) ** k}.png" for k, stamp in enumerate(stamps) if k != 3]
    found = paired(left, right)
    assert [name for name, problem in found if problem] == [left[3]]
    assert sum(not problem for _, problem in found) == 7


def test_names_without_numbers_pair_in_their_order() -> None:
    assert paired(["a.png", "b.png"], ["c.png", "d.png"]) == [("a.png, c.png", ""), ("b.png, d.png", "")]


def test_a_camera_that_runs_ahead_waits_and_fills_no_memory() -> None:
    ahead, never = Given([f"{n}.png" for n in range(1000)]), threading.Event()

    @dataclass
    class Silent:
        live: bool = False

        def frames(self, stop: threading.Event) -> Iterator[Frame]:
            stop.wait(0.3)
            yield from ()

    source = PairedSource(ahead, Silent())
    first = next(source.frames(never))
    assert first.problem
    assert len(ahead.given) < 20


def test_a_restart_reads_again_what_waited() -> None:
    source = PairedSource(Given(["1.png", "2.png", "3.png"]), Given(["2.png", "3.png"]))
    positions = [frame.position for frame in source.frames(threading.Event())]
    assert "2.png" in positions[0]["first"]["waiting"] or positions[0]["first"]["after"][1] == "1.png"
    assert positions[-1]["second"]["waiting"] == []


def test_a_frame_that_cannot_be_read_spoils_its_pair_alone() -> None:
    source = PairedSource(Given(["1.png"], problem="damaged"), Given(["1.png"]))
    (frame,) = source.frames(threading.Event())
    assert frame.content is None
    assert frame.problem == "1.png: damaged"


def test_what_a_source_raises_is_raised() -> None:
    source = PairedSource(Given(["1.png"], raises=FileError("left", "cannot be read")), Given(["1.png"]))
    with pytest.raises(FileError, match="left: cannot be read"):
        list(source.frames(threading.Event()))


def test_a_temperature_of_either_photograph_is_that_of_the_pair() -> None:
    for left, right in ((21.5, None), (None, 21.5), (21.5, 30.0)):
        source = PairedSource(Given(["1.png"], temperature=left), Given(["1.png"], temperature=right))
        assert [frame.temperature for frame in source.frames(threading.Event())] == [21.5]
