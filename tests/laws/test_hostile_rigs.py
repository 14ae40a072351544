"""Rigs that read, but with numbers that no rig has: the jobs answer, refuse, or raise a `RetrueError`."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from retrue import Camera, Correspondences, Rig, RigidTransform, read_rig, recalibrate, reconstruct, verify
from retrue.errors import DegenerateError, InputError, RetrueError
from retrue.files.rig_json import rig_from_json, rig_to_json

CAMERA = Camera((1280, 960), [[1600, 0, 640], [0, 1602, 480], [0, 0, 1]], [-0.1, 0.05, 4e-4, -3e-4, 0])
POSE = RigidTransform.from_rotation_vector([0.05, -0.2, 0.02], [0.35, -0.04, 0.06])
RIG = Rig(CAMERA, CAMERA, POSE, "m", {"covariance": (1e-8 * np.eye(5)).tolist()})
EXTREMES = [0, -1, 1, 1e-300, 1e300, -1e300, 1e160, 1e-160, 1e9, 10**400, True, None, "x", [], {}]


def points() -> Correspondences:
    rng = np.random.default_rng(0)
    pixels = rng.uniform([100, 100], [1180, 860], (80, 2))
    rays = np.column_stack([CAMERA.unproject(pixels), np.ones(len(pixels))])
    rays *= (1.6 / (rays @ np.array([0.25, 0.1, 1.0])) * np.where(pixels[:, 0] < 500, 0.8, 1.0))[:, None]
    return Correspondences(pixels, CAMERA.project(POSE.apply(rays)))


def paths(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """To every value of a document, but for what says which format it is."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    below = [inner for key, item in items if key not in ("format", "version") for inner in paths(item, (*path, key))]
    return below + ([path] if path else [])


PLACES = paths(json.loads(rig_to_json(RIG)))


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # overflow is what these numbers are for
@settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(st.lists(st.tuples(st.sampled_from(PLACES), st.sampled_from(EXTREMES)), min_size=1, max_size=3))
def test_nothing_but_a_retrue_error(edits):
    document = json.loads(rig_to_json(RIG))
    with contextlib.suppress(TypeError, LookupError):  # the place of a later edit may be gone
        for path, value in edits:
            place = document
            for key in path[:-1]:
                place = place[key]
            place[path[-1]] = value
    with contextlib.suppress(RetrueError):
        rig = rig_from_json(Path("rig.json"), document)
        for job in (lambda: verify(rig, [points()]), lambda: recalibrate(rig, [points()])):
            with contextlib.suppress(RetrueError):
                job()
        reconstruct(rig, points())


def test_a_covariance_too_large_for_a_float(tmp_path):
    text = rig_to_json(RIG).replace("[[1e-08,", "[[1" + "0" * 400 + ",")
    (tmp_path / "rig.json").write_text(text)
    with pytest.raises(InputError, match="covariance"):
        verify(read_rig(tmp_path / "rig.json"), [points()])


@pytest.mark.parametrize(("every", "verdict"), [(150, "good"), (10_000, "unknown")])
def test_rows_of_pixels_that_lie_far_apart_are_answered(every, verdict):
    """As of a dense code of which somebody kept every so manyth row: neighbours of a point are on one line with it."""
    across, down = np.meshgrid(np.arange(100.0, 1180.0, 2.0), np.arange(100.0, 860.0, every))
    pixels = np.column_stack([across.ravel(), down.ravel()])
    rays = np.column_stack([(pixels - CAMERA.K[:2, 2]) / 1600, np.ones(len(pixels))])
    straight = Camera(CAMERA.size, [[1600, 0, 640], [0, 1600, 480], [0, 0, 1]])
    rays *= (1.6 / (rays @ np.array([0.25, 0.1, 1.0])) * np.where(pixels[:, 0] < 500, 0.8, 1.0))[:, None]
    noisy = straight.project(POSE.apply(rays)) + np.random.default_rng(0).normal(0, 0.05, pixels.shape)
    rig = Rig(straight, straight, POSE, "m", RIG.evidence)
    assert verify(rig, [Correspondences(pixels, noisy)]).verdict == verdict


@pytest.mark.parametrize("length", [0.0, 1e-200])
@pytest.mark.parametrize(
    "job", [lambda rig, seen: recalibrate(rig, [seen]), lambda rig, seen: verify(rig, [seen]), reconstruct]
)
def test_devices_at_one_place(job, length):
    """As where somebody left zeros for a pose that nobody knows yet."""
    rig = Rig(CAMERA, CAMERA, RigidTransform(POSE.R, [length, 0, 0]))
    with pytest.raises(DegenerateError, match=r"expected a baseline, found t = 0.*give t roughly"):
        job(rig, points())


def test_an_exchange_puts_no_pixel_outside_its_raster(recwarn):
    """Points of another rig's picture, of which hardly one could be the other device's, are not taken for exchanged."""
    small = Camera((64, 48), [[80, 0, 31.5], [0, 80, 23.5], [0, 0, 1]])
    rng = np.random.default_rng(0)
    seen = Correspondences(rng.uniform([700, 500], [1270, 950], (60, 2)), rng.uniform([2, 2], [62, 46], (60, 2)))
    answer = recalibrate(Rig(CAMERA, small, POSE, "m"), [seen])
    assert type(answer.cause).__name__ not in ("DevicesExchanged", "NoneType")
    assert not recwarn.list
