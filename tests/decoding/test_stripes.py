"""One picture of coloured stripes gives one coordinate along every line; anything else gives nothing."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from retrue.decoding.decode import decode
from retrue.decoding.lines.decode_stripes import stripe_direction
from retrue.patterns.line_grid import LineGrid, make_line_grid

GRID = make_line_grid((420, 330))
COLUMNS, ROWS = replace(GRID, rows=None), replace(GRID, columns=None)


def seen(grid: LineGrid, turn: float = 0.0, step: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """The stripes as a camera sees them, and the projector pixel (h, w, 2) that each of its pixels sees."""
    y, x = np.mgrid[0:330, 0:440].astype(np.float32)
    a, b = x - 220, y - 165
    u = 210 + 0.9 * (np.cos(turn) * a + np.sin(turn) * b) + 2e-4 * a * b
    v = 165 + 0.9 * (np.cos(turn) * b - np.sin(turn) * a)
    if step:
        u = np.where(b > 30, u + 23, u)
    where = np.stack([u, v], axis=-1).astype(np.float32)
    shown = cv2.GaussianBlur(grid.render().astype(np.float32), (0, 0), 0.7)
    lit = cv2.remap(shown, where[..., 0], where[..., 1], cv2.INTER_LINEAR, borderValue=(0, 0, 0))
    mixed = lit @ np.array([[0.5, 0.1, 0.0], [0.1, 0.8, 0.1], [0.0, 0.15, 0.7]], np.float32)
    noisy = 12 + mixed + np.random.default_rng(2).normal(0, 2.0, mixed.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8), where


def errors(points, where: np.ndarray, axis: int) -> np.ndarray:
    there = cv2.remap(where[..., axis], *points.camera_px.T.astype(np.float32)[:, None], cv2.INTER_LINEAR)[0]
    return points.projector_px[:, axis] - there


@pytest.mark.parametrize(("grid", "axis"), [(COLUMNS, 0), (ROWS, 1)])
@pytest.mark.parametrize("turn", [0.0, 0.4, -0.8, 1.57])
def test_stripes_tell_one_coordinate(grid, axis, turn):
    picture, where = seen(grid, turn)
    points = decode(grid, picture)
    assert points.axes == (axis,)
    assert len(points) > (1500 if turn == -0.8 else 2500)
    error = errors(points, where, axis)
    assert np.mean(np.abs(error) > 2) <= 0.003
    assert np.median(np.abs(error)) < 0.15
    assert points.camera_sigma_px is not None
    assert 0.3 < np.median(np.abs(error)) / 0.6745 / points.camera_sigma_px[0] < 1.5


def test_a_step_is_not_read_over():
    picture, where = seen(COLUMNS, step=True)
    points = decode(COLUMNS, picture)
    assert len(points) > 4000
    assert np.mean(np.abs(errors(points, where, 0)) > 2) <= 0.003


def test_points_carry_what_jobs_use():
    points = decode(COLUMNS, seen(COLUMNS)[0])
    assert points.cells is not None
    line = points.cells[:, 1]
    assert np.array_equal(points.projector_px[:, 0], COLUMNS.columns.middles()[line])
    assert np.array_equal(points.light_class, np.array(COLUMNS.columns.sequence)[line])
    assert (points.camera_size, points.projector_size) == ((440, 330), (420, 330))


@pytest.mark.parametrize(
    ("image", "advice"),
    [
        (np.zeros((120, 160, 3), np.uint8), "too dark"),
        (np.random.default_rng(1).integers(0, 255, (120, 160, 3)).astype(np.uint8), ""),
        (seen(replace(COLUMNS, columns=GRID.rows))[0][:, ::-1], ""),
    ],
    ids=["dark", "noise", "other colours"],
)
def test_nothing_else_is_read(image, advice):
    points = decode(COLUMNS, image)
    assert len(points) == 0
    assert points.card.advice[0].startswith(advice)


def test_another_sequence_is_not_read():
    order = np.random.default_rng(3).permutation(66)
    other = replace(COLUMNS, columns=replace(GRID.columns, sequence=tuple(np.array(GRID.columns.sequence)[order])))
    points = decode(other, seen(COLUMNS)[0])
    assert len(points) == 0
    assert "not this pattern" in points.card.advice[0]


def test_directions_are_those_of_the_lines():
    picture, _ = seen(COLUMNS, 0.4)
    along = stripe_direction(picture)[100:230, 120:320]
    assert np.degrees(np.arctan2(along[..., 0], along[..., 1])) == pytest.approx(
        np.full(along.shape[:2], -np.degrees(0.4)), abs=4
    )
