"""Which block is whose neighbour: a grid without global directions, as perspective and depth edges leave it."""

from __future__ import annotations

import numpy as np

from retrue.decoding.blocks.blobs import Blocks
from retrue.decoding.nearest import nearest_of_all
from retrue.geometry.arrays import FloatArray, IntArray
from retrue.kernels import links as kernel

CANDIDATES = 8  # nearest blobs that may be one of the four neighbours, or one of the four diagonal ones
NONE = -1


class Links:
    """Four neighbours of each blob, counter-clockwise in a frame of the blob's own.

    Attributes
    ----------
    neighbour : (N, 4) index of the neighbour in direction k, or -1; k and k + 2 are opposite.
    turn : (N, 4) quarter turns to add to a direction of this blob to get the same one of the neighbour.
    around : (N, 9) the 3x3 window about each blob in its own frame, row by row, or -1.
    around_turn : (N, 9) quarter turns to the frame of each of them.
    """

    __slots__ = ("around", "around_turn", "neighbour", "turn")

    def __init__(self, neighbour: IntArray, turn: IntArray) -> None:
        self.neighbour, self.turn = neighbour, turn
        self.around, self.around_turn = np.full((len(neighbour), 9), NONE), np.zeros((len(neighbour), 9), np.int64)
        kernel.fill_windows(neighbour, turn, self.around, self.around_turn)


def link_blocks(blocks: Blocks) -> Links:
    """Neighbours along the two directions of the blocks' own sides.

    The second moments M of a blob tell the parallelogram that perspective made of the square: in the
    frame M^-1/2 the block is a square again and its neighbours lie at right angles, at equal distances,
    however steep the surface. What is left is a rotation, and that is the fourfold mean of the directions
    to the neighbours. Only mutual links stay.
    """
    count = len(blocks)
    if count < 9:
        return Links(np.full((count, 4), NONE), np.zeros((count, 4), np.int64))
    near = np.ascontiguousarray(nearest_of_all(blocks.centre, blocks.centre, min(CANDIDATES + 1, count))[1][:, 1:])
    chosen, neighbour, turn = (np.empty((count, 4), np.int64) for _ in range(3))
    room = np.empty((near.shape[1], 3))
    kernel.choose_neighbours(blocks.centre, _whitening(blocks), blocks.area(), near, room, chosen)
    kernel.keep_mutual(chosen, neighbour, turn)
    return Links(neighbour, turn)


def lengths_and_bends(blocks: Blocks, links: Links) -> tuple[FloatArray, FloatArray]:
    """Of each link (N, 4): its length in standard deviations of the block it starts from, and its change to the link
    before or after it, the lesser one, over its length; NaN where there is none."""
    length, bend = np.empty(links.neighbour.shape), np.empty(links.neighbour.shape)
    kernel.measure_links(blocks.centre, _whitening(blocks), links.neighbour, links.turn, length, bend)
    return length, bend


def _whitening(blocks: Blocks) -> FloatArray:
    """(N, 3) xx, xy, yy of M^-1/2."""
    root = np.empty((len(blocks), 3))
    kernel.whiten(blocks.shape, root)
    return root
