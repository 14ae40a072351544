"""What users get is a value: nobody writes into it, and the same numbers make it equal."""

from __future__ import annotations

import pickle
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import FrozenInstanceError, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import retrue
from tests.examples import examples, public_values
from tests.recalibration.scenes import RIG

VALUES = public_values()


def arrays_in(value: Any, name: str) -> Iterator[tuple[str, np.ndarray]]:
    if isinstance(value, np.ndarray):
        yield name, value
    elif is_dataclass(value):
        for item in fields(value):
            yield from arrays_in(getattr(value, item.name), f"{name}.{item.name}")
    elif isinstance(value, retrue.PlanarPose):
        for part in ("R", "translation_over_distance", "normal"):
            yield f"{name}.{part}", getattr(value, part)
    elif isinstance(value, Mapping):
        for key, inner in value.items():
            yield from arrays_in(inner, f"{name}[{key!r}]")
    elif isinstance(value, Sequence) and not isinstance(value, str):
        for index, inner in enumerate(value):
            yield from arrays_in(inner, f"{name}[{index}]")


def test_there_is_an_example_of_every_public_value() -> None:
    assert set(VALUES) <= set(examples())


@pytest.mark.parametrize("name", VALUES)
def test_no_array_can_be_written_to(name: str) -> None:
    for where, array in arrays_in(examples()[name], name):
        assert not array.flags.writeable, where
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


@pytest.mark.parametrize("name", VALUES)
def test_no_field_can_be_set(name: str) -> None:
    value: Any = examples()[name]
    for item in fields(value) if is_dataclass(value) else ():
        with pytest.raises((FrozenInstanceError, TypeError)):  # TypeError: of a class with slots, before Python 3.12
            setattr(value, item.name, None)


@pytest.mark.parametrize("name", [name for name in VALUES if name != "PlanarPose"])
def test_a_copy_is_equal_and_has_the_same_hash(name: str) -> None:
    value = examples()[name]
    copies = [deepcopy(value), pickle.loads(pickle.dumps(value))]
    for copy in copies:
        assert copy is not value
        assert copy == value
        assert hash(copy) == hash(value)
        assert not any(array.flags.writeable for _, array in arrays_in(copy, name))
    assert len({value, *copies}) == 1
    assert value != "something else"


def test_a_caller_keeps_arrays_of_his_own() -> None:
    camera_px, colors = np.array([[1.0, 2.0]]), np.array([[10, 20, 30]], dtype=np.uint8)
    points = retrue.Correspondences(camera_px, camera_px, colors=colors)
    camera_px[:] = 0
    colors[:] = 0
    assert points.camera_px.tolist() == [[1.0, 2.0]]
    assert points.colors is not None
    assert points.colors.tolist() == [[10, 20, 30]]


def test_every_number_of_a_rig_counts() -> None:
    camera, pose = RIG.camera, RIG.projector_from_camera
    others = [
        replace(RIG, unit="mm"),
        replace(RIG, evidence={"rms_px": 0.1}),
        replace(RIG, camera=replace(camera, size=(1280, 961))),
        replace(RIG, camera=replace(camera, K=camera.K * (1 + 1e-12 * np.eye(3)[0]))),
        replace(RIG, camera=replace(camera, distortion=[*camera.distortion, 0, 0, 0])),
        replace(RIG, projector_from_camera=replace(pose, t=pose.t * (1 + 1e-12))),
    ]
    assert replace(RIG) == RIG
    for other in others:
        assert other != RIG
    assert len({RIG, replace(RIG), *others}) == 7


def test_minus_zero_is_zero_and_nan_is_nan() -> None:
    plus, minus = (retrue.RigidTransform(np.eye(3), [zero, 0.0, 1.0]) for zero in (0.0, -0.0))
    assert plus == minus
    assert hash(plus) == hash(minus)
    missing = [retrue.Correspondences([[1, 2]], [[3, 4]], confidence=[np.nan], card={"rms": np.nan}) for _ in range(2)]
    assert missing[0] == missing[1]
    assert hash(missing[0]) == hash(missing[1])


def test_a_rig_reads_back_equal(tmp_path: Path) -> None:
    calibrated = examples()["Calibrated"]
    assert isinstance(calibrated, retrue.Calibrated)
    retrue.write_rig(tmp_path / "rig.json", calibrated.rig)
    assert retrue.read_rig(tmp_path / "rig.json") == calibrated.rig


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"colors": [[0.5, 0, 0]]}, "colors: expected numbers that uint8 holds, found others as float64"),
        ({"colors": [[300, 0, 0]]}, "colors: expected numbers that uint8 holds, found others as int64"),
        ({"colors": [10]}, "colors: expected shape N x 3, found 1"),
        ({"cells": [[0.5, 1.0]]}, "cells: expected numbers that int64 holds, found others as float64"),
        ({"confidence": 1.0}, "confidence: expected shape N, found a number"),
        ({"confidence": [1.0, 1.0]}, "confidence: expected 1 rows as in camera_px, found 2"),
        ({"confidence": ["high"]}, "confidence: expected numbers, found text"),
    ],
)
def test_columns_that_are_none(wrong: dict[str, Any], said: str) -> None:
    with pytest.raises(retrue.InputError) as raised:
        retrue.Correspondences([[1, 2]], [[3, 4]], **wrong)
    assert str(raised.value) == said
