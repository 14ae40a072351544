"""Line grids: every three neighbours unique, rendered as the spec says, read back from their own picture."""

import numpy as np
import pytest

from retrue.errors import InputError
from retrue.patterns.line_grid import COLUMN_COLORS, LineGrid, Lines, de_bruijn, make_line_grid
from retrue.patterns.line_picture import read_line_picture

TWO = ((255, 0, 0), (0, 0, 255))


@pytest.mark.parametrize(("colors", "window"), [(2, 3), (4, 3), (3, 4)])
def test_every_window_once(colors, window):
    sequence = de_bruijn(colors, window)
    windows = {sequence[k : k + window] for k in range(len(sequence) - window + 1)}
    assert len(windows) == colors**window == len(sequence) - window + 1


@pytest.mark.parametrize("size", [(800, 600), (1920, 1080), (640, 480), (1024, 768)])
def test_fits_and_fills_the_projector(size):
    grid = make_line_grid(size)
    for lines, side in ((grid.columns, size[0]), (grid.rows, size[1])):
        middles = lines.middles()
        assert middles[0] - lines.width / 2 + 0.5 >= 0
        assert middles[-1] + lines.width / 2 - 0.5 <= side - 1
        assert middles[-1] - middles[0] > 0.85 * side
        assert lines.width < 0.5 * lines.pitch


def test_columns_lie_over_rows():
    grid = LineGrid((9, 8), Lines(TWO, (0,), 2, 3, 1), Lines(TWO, (1,), 4, 3, 1))
    picture = grid.render()
    assert picture[0, 2].tolist() == picture[4, 2].tolist() == [255, 0, 0]
    assert picture[4, 5].tolist() == [0, 0, 255]
    assert picture[0, 5].tolist() == [0, 0, 0]


@pytest.mark.parametrize("absent", ["columns", "rows", None])
def test_read_from_its_own_picture(absent):
    grid = make_line_grid((640, 480))
    families = {"columns": grid.columns, "rows": grid.rows} | ({absent: None} if absent else {})
    grid = LineGrid(grid.projector_size, **families)
    read = read_line_picture(grid.render())
    assert np.array_equal(read.render(), grid.render())
    for name, lines in families.items():
        found = getattr(read, name)
        assert (found is None) == (lines is None)
        if lines is not None:
            assert (found.origin, found.pitch, found.width) == (lines.origin, lines.pitch, lines.width)


def test_rows_over_columns_are_read_too():
    grid = make_line_grid((640, 480))
    rows_only = LineGrid((640, 480), rows=grid.rows).render()
    picture = np.where(rows_only.max(axis=-1, keepdims=True) > 0, rows_only, grid.render())
    assert np.array_equal(read_line_picture(picture).render(), grid.render())


def test_other_pictures_are_no_line_grids():
    noise = np.random.default_rng(1).integers(0, 255, (60, 80, 3)).astype(np.uint8)
    spoilt = make_line_grid((640, 480)).render()
    spoilt[100:140, 200:260] = 255
    uneven = make_line_grid((640, 480)).render()[:, np.r_[0:100, 103:640]]
    for picture in (noise, spoilt, uneven, np.zeros((60, 80, 3), np.uint8), noise.astype(np.uint16)):
        with pytest.raises(InputError, match="expected a picture of a line grid") as caught:
            read_line_picture(picture)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("make", "complaint"),
    [
        (lambda: Lines(TWO, (), 5, 8, 3), "one line or more"),
        (lambda: Lines(TWO, (0, 2), 5, 8, 3), "indices 0 .. 1"),
        (lambda: Lines(TWO, (0, 1), 5, 3, 3), "width < pitch"),
        (lambda: Lines(TWO, (0, 1), 5, 8, float("nan")), "width: expected more than 0, found nan"),
        (lambda: LineGrid((100, 80)), "found neither"),
        (lambda: LineGrid((100, 80), Lines(TWO, (0, 1), 0, 8, 3)), "columns between"),
        (lambda: LineGrid((100, 80), rows=Lines(TWO, (0, 1), 75, 8, 3)), "rows between"),
        (lambda: make_line_grid((200, 600)), "a width of 264 pixels or more"),
    ],
)
def test_mistakes_are_named(make, complaint):
    with pytest.raises(InputError, match=complaint):
        make()


def test_rows_and_columns_share_no_color():
    grid = make_line_grid()
    assert not set(grid.columns.colors) & set(grid.rows.colors)
    assert grid.columns.colors == COLUMN_COLORS
