"""The nearest crossings along two axes are the same compiled and as Python, and as of every two of them in NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from retrue.decoding.lines import crossings
from retrue.decoding.lines.crossings import ASIDE, FARTHEST, LEAST, link
from tests.kernels.plain import plain


def of_every_two(at: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """(N, 4) of each the nearest one ahead along both axes, then behind; of equally near ones the upper one."""
    off = at[None] - at[:, None]
    upper = np.argsort(np.argsort(at[:, 1], kind="stable"))
    found = np.full((len(at), 4), -1)
    for side in range(4):
        direction = (-1 if side > 1 else 1) * axes[:, side % 2]
        ahead = (off * direction[:, None]).sum(axis=2)
        aside = np.abs(off[..., 0] * direction[:, None, 1] - off[..., 1] * direction[:, None, 0])
        square = (np.abs(off[..., 1]) < FARTHEST) & (np.abs(off[..., 0]) < FARTHEST * np.hypot(1, ASIDE))
        there = square & (ahead > LEAST) & (ahead < FARTHEST) & (aside < np.maximum(ASIDE * ahead, LEAST))
        for index in np.flatnonzero(there.any(axis=1)):
            rows = np.flatnonzero(there[index])
            found[index, side] = min(rows, key=lambda row: (ahead[index, row], upper[row]))
    return found


@pytest.mark.parametrize(("count", "grid"), [(0, 0), (1, 0), (250, 0), (250, 3), (250, 9)])
def test_neighbours_are_those_of_every_two(count: int, grid: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(count + grid)
    at = rng.uniform(0, [130, 110], (count, 2))
    at = np.round(at / grid) * grid if grid else at  # then many are as near as each other
    turn = rng.normal(0, 0.3, count) * (grid != 9)
    axes = np.stack([np.cos(turn), np.sin(turn), -np.sin(turn), np.cos(turn)], axis=1).reshape(-1, 2, 2)
    expected = of_every_two(at, axes)
    mutual = expected.copy()
    for side in range(4):
        back = expected[expected[:, side], (side + 2) % 4] if count else expected[:, side]
        mutual[(back != np.arange(count)) | (expected[:, side] < 0), side] = -1
    compiled = link(at, axes).neighbour
    monkeypatch.setattr(crossings, "kernel", plain("crossings"))
    np.testing.assert_array_equal(compiled, mutual)
    np.testing.assert_array_equal(link(at, axes).neighbour, mutual)
    assert (mutual >= 0).any() or count < 2
