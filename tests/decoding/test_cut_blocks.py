"""Blocks of which an edge has cut a part: where they are placed, and what is doubted of them."""

import numpy as np
import pytest

from retrue.decoding.blocks.growth import Surfaces
from retrue.decoding.blocks.rims import at_rims
from retrue.decoding.surface import Joints

SIDE, PITCH, DUTY, SCALE = 6, 18.0, 0.6, 10
DOUBT = 0.5  # px, of all blocks as they come
HALF = PITCH * DUTY / 2


def centres() -> np.ndarray:
    row, column = np.mgrid[:SIDE, :SIDE]
    return 20.3 + PITCH * np.stack([column, row], axis=-1)


def drawn(hidden, behind: int = 20) -> np.ndarray:
    """A picture of SIDE x SIDE blocks with noise; where `hidden` (x, y) is true, something as bright as `behind`."""
    length = int(2 * 20 + PITCH * (SIDE - 1))
    y, x = (np.mgrid[: length * SCALE, : length * SCALE] - (SCALE - 1) / 2) / SCALE
    near = (np.abs(x[0] - centres()[0, :, :1]) < HALF).any(axis=0)  # of a block's column, or row
    lit = near & near[:, None]
    fine = np.where(hidden(x, y), behind, np.where(lit, 200, 20))
    picture = fine.reshape(length, SCALE, length, SCALE).mean(axis=(1, 3))[..., None]
    noise = np.random.default_rng(0).normal(size=(length, length, 3))
    return np.clip(picture + noise, 0, 255).astype(np.uint8)


def placed(picture: np.ndarray, off: np.ndarray, apart: bool = False) -> Surfaces:
    """Blocks that were measured so far `off`; of the last column `apart` only one linked to the others."""
    joints = Joints(np.ones((SIDE, SIDE - 1), bool), np.ones((SIDE - 1, SIDE), bool))
    joints.right[:, -1] = not apart
    joints.right[2, -1] = True
    doubt, none = np.full((SIDE, SIDE), DOUBT), np.full((SIDE, SIDE), np.nan)
    return at_rims(picture, Surfaces(centres() + off, np.full((SIDE, SIDE, 3), 180.0), doubt, none, joints), DUTY)


@pytest.mark.parametrize("behind", [20, 120], ids=["dark", "lit"])
@pytest.mark.parametrize("cut", [0.6, 2.0, 4.0])
def test_a_cut_block_is_where_its_whole_side_says(cut, behind):
    last = centres()[0, -1, 0]
    off = np.zeros((SIDE, SIDE, 2))
    off[:, -1, 0] = -cut / 2
    found = placed(drawn(lambda x, y: x > last + HALF - cut, behind), off)
    error = found.position - centres()
    assert np.abs(error[1:-1, -1]).max() < 0.1
    assert (np.abs(error[1:-1, -1, 0]) < 3 * found.doubt[1:-1, -1]).all()
    assert found.doubt[1:-1, -1].max() < 0.2


def test_whole_blocks_stay():
    found = placed(drawn(lambda x, y: x < 0), np.zeros((SIDE, SIDE, 2)))
    assert np.abs(found.position - centres()).max() < 0.05
    assert np.allclose(found.doubt[1:-1, 1:-1], DOUBT)


@pytest.fixture(scope="module")
def whole() -> np.ndarray:
    return drawn(lambda x, y: x < 0)


@pytest.mark.parametrize("seed", range(40))
def test_no_clutter_beyond_an_edge_moves_a_block_further_than_a_cut_does(whole, seed):
    """What stands there may look like sides of blocks; five of these made steps that grew from round to round."""
    picture = whole.copy()
    coarse = np.random.default_rng(seed).integers(0, 255, (17, 17, 3), dtype=np.uint8)
    column = int(centres()[0, -1, 0]) - 2
    picture[:, column:] = np.kron(coarse, np.ones((8, 8, 1), np.uint8))[: len(picture), column : len(picture)]
    found = placed(picture, np.zeros((SIDE, SIDE, 2)))
    assert np.abs(found.position - centres()).max() < PITCH / 4


def test_an_edge_aslant_moves_both_coordinates_no_more_than_they_are_off():
    corner = centres()[0, -1]
    found = placed(drawn(lambda x, y: (x - corner[0]) - (y - corner[1]) > HALF), np.zeros((SIDE, SIDE, 2)))
    assert np.abs(found.position[0, -1] - corner).max() < 0.3


def test_a_block_that_may_be_cut_on_either_side_stays_and_is_doubted_by_half_of_what_it_lacks():
    cut, last = 2.0, centres()[0, -1, 0]
    off = np.zeros((SIDE, SIDE, 2))
    off[:, -1, 0] = -cut / 2
    found = placed(drawn(lambda x, y: x > last + HALF - cut), off, apart=True)
    assert np.allclose(found.position[[1, 3], -1], (centres() + off)[[1, 3], -1], atol=0.1)
    assert np.allclose(found.doubt[[1, 3], -1], cut / 2, atol=0.2)
