"""Every option declares what it may be, and holds to it."""

from dataclasses import MISSING, dataclass, fields
from importlib import import_module
from math import inf, nan, nextafter
from pkgutil import walk_packages
from typing import Any, get_args, get_type_hints

import pytest

import retrue
from retrue.cli.main import main
from retrue.errors import InputError
from retrue.ranges import Range, check_ranges, declared_ranges, ranged

MODULES = [name for _, name, _ in walk_packages(retrue.__path__, "retrue.") if name.endswith(("options", "verify"))]
CLASSES = sorted(
    {
        value
        for module in map(import_module, MODULES)
        for name, value in vars(module).items()
        if isinstance(value, type) and name.endswith("Options")
    },
    key=lambda kind: kind.__name__,
)
LIMITS = [(kind, name, allowed) for kind in CLASSES for name, allowed in declared_ranges(kind).items()]
each_limit = pytest.mark.parametrize(
    ("kind", "name", "allowed"), LIMITS, ids=[f"{k.__name__}.{n}" for k, n, _ in LIMITS]
)


def is_number(hint: Any) -> bool:
    return bool({int, float} & {hint, *get_args(hint)})


def test_every_number_of_every_options_class_declares_its_range() -> None:
    assert {kind.__name__ for kind in CLASSES} == {
        "AcceptOptions", "CadOptions", "CalibrationOptions", "CreepOptions", "MergeOptions", "RecalibrateOptions",
        "ReconstructOptions", "RecordOptions", "SimulateOptions", "SimulatedOptions", "StreakOptions",
        "VerifyOptions", "WatchOptions",
    }  # fmt: skip
    for kind in CLASSES:
        hints = get_type_hints(kind)
        assert {item.name for item in fields(kind) if is_number(hints[item.name])} == set(declared_ranges(kind)), kind


def wrong_values(allowed: Range) -> list[Any]:
    step = 1 if allowed.whole else 0
    below = allowed.least if allowed.above else allowed.least - step if step else nextafter(allowed.least, -inf)
    beyond = allowed.most + step if step else nextafter(allowed.most, inf)
    wrong = [nan, -inf, below, "0.5", True, [1.0]]
    wrong += [beyond] if allowed.most < inf else []
    wrong += [allowed.least + 1.5] if allowed.whole else []
    return wrong


@each_limit
def test_a_number_out_of_its_range_is_refused(kind: type, name: str, allowed: Range) -> None:
    for wrong in wrong_values(allowed):
        with pytest.raises(InputError) as refused:
            kind(**{name: wrong})
        assert str(refused.value) == f"{name}: expected {allowed}, found {wrong!r}"


@each_limit
def test_the_default_and_the_ends_of_a_range_are_within(kind: type, name: str, allowed: Range) -> None:
    default = next(item.default for item in fields(kind) if item.name == name)
    assert default is not MISSING
    assert default is None or default in allowed
    assert allowed.most in allowed or allowed.whole
    assert (allowed.least in allowed) is not allowed.above


@each_limit
def test_none_means_not_given_only_where_it_is_the_default(kind: type, name: str, allowed: Range) -> None:
    if next(item.default for item in fields(kind) if item.name == name) is None:
        assert getattr(kind(**{name: None}), name) is None
    else:
        with pytest.raises(InputError, match=f"^{name}: expected .*, found None$"):
            kind(**{name: None})


def test_what_is_expected_is_said_in_words() -> None:
    assert [str(Range(0, 1)), str(Range(0)), str(Range(0, above=True)), str(Range(0, 5, above=True))] == [
        "0 to 1", "0 or more", "more than 0", "more than 0, at most 5",
    ]  # fmt: skip
    assert str(Range(4, whole=True)) == "a whole number, 4 or more"


def test_numbers_of_numpy_are_numbers() -> None:
    import numpy as np

    @dataclass(frozen=True)
    class Some:
        share: float = ranged(0.5, 0, 1)
        count: int = ranged(3, 1)

        def __post_init__(self) -> None:
            check_ranges(self)

    assert Some(np.float32(0.25), np.int64(2)) == Some(0.25, 2)
    with pytest.raises(InputError, match="count: expected a whole number, 1 or more, found"):
        Some(count=np.float64(2.0))  # type: ignore[arg-type]


def test_the_command_line_says_it_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recalibrate", "rig.json", "points.csv", "--out", "new.json", "--max-outliers", "nan"]) == 2
    assert capsys.readouterr().err == "retrue: --max-outliers: expected 0 to 1, found nan\n"
    assert main(["recalibrate", "rig.json", "points.csv", "--out", "new.json", "--min-points", "2"]) == 2
    assert capsys.readouterr().err == "retrue: --min-points: expected a whole number, 4 or more, found 2\n"
