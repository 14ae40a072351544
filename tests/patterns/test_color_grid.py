"""The colour grid keeps what it promises, proven by exhaustion."""

from itertools import combinations

import numpy as np
import pytest

from retrue.errors import InputError
from retrue.patterns.color_grid import PAPER_COLORS, ColorGrid, make_color_grid
from retrue.patterns.color_grid_code import make_code


def windows_in_four_rotations(grid: ColorGrid) -> np.ndarray:
    """(4, N, 9): every 3x3 window, turned by 0, 1, 2, 3 quarters."""
    code = np.asarray(grid.code, dtype=np.int8)
    windows = np.lib.stride_tricks.sliding_window_view(code, (3, 3)).reshape(-1, 3, 3)
    return np.stack([np.rot90(windows, turn, axes=(1, 2)).reshape(-1, 9) for turn in range(4)])


def least_distance(grid: ColorGrid) -> int:
    """Over all pairs of windows, one of them in any rotation; a window against its own rotations too."""
    turned = windows_in_four_rotations(grid)
    everything = turned.reshape(-1, 9)
    least = 9
    for number, window in enumerate(turned[0]):
        distance = (everything != window).sum(axis=1)
        distance[number] = 9  # itself, unturned
        least = min(least, int(distance.min()))
    return least


@pytest.mark.parametrize(
    ("size", "rows", "columns", "distance"),
    [((1024, 768), 40, 51, 3), ((640, 480), 18, 18, 4), ((640, 480), 9, 13, 4)],
)
def test_windows_differ_in_the_stated_number_of_cells(size, rows, columns, distance):
    grid = make_color_grid(size, rows, columns, seed=4)
    assert least_distance(grid) >= grid.distance
    assert grid.distance >= distance


def test_full_hd_has_more_than_5600_unique_windows():
    grid = make_color_grid((1920, 1080), 56, 100)
    assert least_distance(grid) >= grid.distance == 2


@pytest.mark.parametrize("count", [4, 5, 7])
def test_neighbours_differ_and_colours_are_even(count):
    grid = make_color_grid((1024, 768), 12, 14, colors=PAPER_COLORS[:count])
    code = np.asarray(grid.code)
    assert (code[1:] != code[:-1]).all()
    assert (code[:, 1:] != code[:, :-1]).all()
    share = np.bincount(code.ravel(), minlength=count) / code.size
    assert np.abs(share - 1 / count).max() < 0.04


def test_white_touches_no_white():
    code = np.asarray(make_color_grid().code)
    white = code == PAPER_COLORS.index((255, 255, 255))
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        moved = np.roll(white, (-down, -right), axis=(0, 1))
        inside = np.ones_like(white)
        inside[-1:] &= down == 0
        if right:
            inside[:, -1 if right > 0 else 0] = False
        assert not (white & moved & inside).any()


def test_the_same_seed_gives_the_same_grid():
    first = make_color_grid(seed=3)
    make_code.cache_clear()
    assert make_color_grid(seed=3) == first
    assert make_color_grid(seed=3).code != make_color_grid(seed=4).code


def test_picture_shows_each_block_in_its_colour_and_black_between():
    grid = make_color_grid((200, 150), 6, 8, block=9, gap=7)
    picture = grid.render()
    assert picture.shape == (150, 200, 3)
    lit = np.zeros(picture.shape[:2], dtype=bool)
    for (row, column), colour in np.ndenumerate(np.asarray(grid.code)):
        x, y = grid.centres()[row, column]
        part = slice(round(y - 4), round(y + 5)), slice(round(x - 4), round(x + 5))
        assert (picture[part] == grid.colors[colour]).all()
        lit[part] = True
    assert not picture[~lit].any()
    assert grid.pitch == 16


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"rows": 60, "pitch": 19}, "fit"),
        ({"pitch": 25, "block": 12}, "fit"),
        ({"pitch": 19, "block": 12, "gap": 8}, r"block \+ gap"),
        ({"colors": ((255, 0, 0), (0, 255, 0))}, "colours"),
        ({"rows": 2}, "3 x 3"),
        ({"colors": PAPER_COLORS[:3]}, "unique"),
    ],
)
def test_impossible_grids_are_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        make_color_grid(**{"rows": 40, "columns": 51, **arguments})


def test_distance_is_counted_right():
    """Flip as many cells of a window as the distance allows, less one: it is nobody else's window."""
    grid = make_color_grid((640, 480), 9, 9)
    known = {tuple(window) for window in windows_in_four_rotations(grid).reshape(-1, 9)}
    window = windows_in_four_rotations(grid)[0, 17]
    for cells in combinations(range(9), grid.distance - 1):
        other = window.copy()
        other[list(cells)] = (other[list(cells)] + 1) % 7
        assert tuple(other) not in known
