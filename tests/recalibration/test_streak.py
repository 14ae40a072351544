"""The decision logic, alone."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from retrue.errors import InputError
from retrue.recalibration.streak import (
    Drifted,
    Streak,
    after_drifted,
    after_good,
    after_refusal,
    after_unknown,
    attempts,
    is_due,
)
from retrue.watch.options import WatchOptions

OPTIONS = WatchOptions(drifted_frames=3, joint_frames=2, remembered_frames=5, forget_after=4)


def after(word: str, streak: Streak = Streak(), options: WatchOptions = OPTIONS) -> Streak:  # noqa: B008
    """The streak after frames: g good, d drifted, u unknown, r a refused attempt. Later frames are less sure."""
    for number, letter in enumerate(word, start=1):
        if letter == "g":
            streak = after_good()
        elif letter == "u":
            streak = after_unknown(streak, options)
        elif letter == "r":
            streak = after_refusal(streak)
        else:
            streak = after_drifted(streak, Drifted(number, 0.1 * number), options)
    return streak


@pytest.mark.parametrize(
    ("word", "due"),
    [
        ("", False),
        ("dd", False),
        ("ddd", True),
        ("ddgd", False),
        ("ddgddd", True),
        ("dudud", True),
        ("dduuud", True),
        ("dduuuud", False),
        ("dddr", False),
        ("dddrdd", False),
        ("dddrddd", True),
        ("uuuuuuddd", True),
    ],
)
def test_when_it_is_time(word, due):
    assert is_due(after(word), OPTIONS) is due


def test_the_surest_frames_are_solved_first_and_then_the_newest():
    assert attempts(after("ddddd"), OPTIONS) == [(1, 2), (3, 4, 5)]


def test_frames_that_would_be_tried_twice_are_tried_once():
    options = WatchOptions(drifted_frames=3, joint_frames=5)
    assert attempts(after("ddd", options=options), options) == [(1, 2, 3)]


def test_an_unknown_uncertainty_comes_last():
    streak = after_drifted(after("dd"), Drifted(3, float("inf")), OPTIONS)
    assert attempts(streak, OPTIONS)[0] == (1, 2)


@given(st.text("gdur", max_size=60))
def test_memory_is_bounded_and_no_streak_outlives_a_good_frame(word):
    streak = after(word)
    assert len(streak.drifted) <= OPTIONS.remembered_frames
    since_good = word.rpartition("g")[2]
    assert {frame.number for frame in streak.drifted} <= {
        number for number, letter in enumerate(word, start=1) if letter == "d" and number > len(word) - len(since_good)
    }


@pytest.mark.parametrize(
    "bad",
    [
        {"drifted_frames": 0},
        {"remembered_frames": 2},
        {"queue": 0},
        {"poll_seconds": float("nan")},
        {"idle_seconds": -1.0},
    ],
)
def test_options_that_make_no_sense(bad):
    with pytest.raises(InputError, match=next(iter(bad))):
        WatchOptions(**bad)
