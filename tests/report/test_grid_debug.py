import numpy as np
import pytest

from retrue.decoding.blocks.decode_color_grid import inspect_color_grid
from retrue.patterns.color_grid import make_color_grid
from retrue.report.grid_debug import grid_pictures

pytest.importorskip("matplotlib")


def test_each_step_is_drawn_also_of_nothing():
    grid = make_color_grid((320, 240), 10, 13)
    shown = np.pad(grid.render(), ((40, 40), (40, 40), (0, 0)), mode="edge")
    seen, nothing = grid_pictures(inspect_color_grid(grid, shown)), grid_pictures(inspect_color_grid(grid, shown * 0))
    assert list(seen) == ["1-blocks", "2-links", "3-colours", "4-decoded", "5-rejected"] == list(nothing)
    for name, png in seen.items():
        assert png.startswith(b"\x89PNG")
        assert png != nothing[name]
