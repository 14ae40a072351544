"""Which ways the lines run, place by place: two directions, from the directions of the picture's edges."""

from __future__ import annotations

import cv2
import numpy as np

from retrue.geometry.arrays import FloatArray, Image

CELL = 8  # px: edges are gathered in squares of that side
REACH = 4  # cells to every side whose edges speak for a place
TURNS = 36  # directions that edges are gathered in, over half a turn
LEAST_ANGLE = 6  # of those, between the two families
FARTHEST = 6  # of those, from the usual direction of a family
USUAL_SHARE = 0.05  # of the usual weight, that the usual direction has everywhere


def line_directions(picture: Image) -> FloatArray:
    """(2, h, w, 2) unit vectors (x, y) along the lines of both families at each pixel of `picture` (h, w, 3).

    The first family is the more upright one, and points down; the second points to the right.
    """
    votes = _votes(picture)
    total = votes.sum(axis=(0, 1))
    usual = _two_peaks(total[None, None])[0, 0]
    if not _upright(usual[0]) > _upright(usual[1]):
        usual = usual[::-1]
    usual_share = USUAL_SHARE * total / len(votes.reshape(-1, TURNS))
    turns = np.arange(TURNS)
    height, width = picture.shape[:2]
    field = np.empty((2, height, width, 2))
    for family, (middle, other) in enumerate((usual, usual[::-1])):
        distance = np.abs((turns - middle + TURNS / 2) % TURNS - TURNS / 2)
        to_other = np.abs((turns - other + TURNS / 2) % TURNS - TURNS / 2)
        open_turns = (distance <= FARTHEST) & (distance < to_other)
        turn = _peak(np.where(open_turns, votes + usual_share, 0.0))
        angle = np.pi / TURNS * turn
        double = np.stack([np.cos(2 * angle), np.sin(2 * angle)], axis=-1)
        double = np.asarray(cv2.resize(double, (width, height), interpolation=cv2.INTER_LINEAR))
        angle = np.arctan2(double[..., 1], double[..., 0]) / 2
        vector = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        field[family] = np.where((vector[..., 1 - family] < 0)[..., None], -vector, vector)
    return field


def _upright(turn: float) -> float:
    return float(np.sin(np.pi / TURNS * turn) ** 2)


def _votes(picture: Image) -> FloatArray:
    """(rows, columns, TURNS) how many edges run each way about each cell of the picture.

    Each pixel votes by the channel that changes most, with the root of how much: a print's few strong edges do not
    outvote many faint lines.
    """
    smooth = cv2.GaussianBlur(picture, (0, 0), 0.8)
    gx, gy = (np.asarray(cv2.Sobel(smooth, cv2.CV_32F, *order)) for order in ((1, 0), (0, 1)))
    strength = gx * gx + gy * gy
    strongest = strength.argmax(axis=-1)[..., None]
    gx, gy, strength = (np.take_along_axis(a, strongest, -1)[..., 0] for a in (gx, gy, strength))
    weight = strength**0.25
    weight[strength < np.percentile(strength, 50) * 0.5] = 0.0
    turn = np.arctan2(gx, -gy) * (TURNS / np.pi) % TURNS  # a line runs across its gradient
    below = np.floor(turn)
    share = turn - below
    rows, columns = -(-picture.shape[0] // CELL), -(-picture.shape[1] // CELL)
    y, x = np.mgrid[: picture.shape[0], : picture.shape[1]] // CELL
    cell = (y * columns + x) * TURNS
    votes = np.zeros(rows * columns * TURNS)
    for at, part in ((below, 1 - share), (below + 1, share)):
        votes += np.bincount((cell + at.astype(np.int64) % TURNS).ravel(), (weight * part).ravel(), len(votes))
    votes = votes.reshape(rows, columns, TURNS)
    side = 2 * REACH + 1
    for k in range(TURNS):
        votes[..., k] = cv2.blur(votes[..., k], (side, side), borderType=cv2.BORDER_REPLICATE)
    return (np.roll(votes, 1, -1) + 2 * votes + np.roll(votes, -1, -1)) / 4


def _two_peaks(votes: FloatArray) -> FloatArray:
    """(..., 2) the two turns, LEAST_ANGLE or more apart, that together have the most votes."""
    first = np.argmax(votes, axis=-1)
    apart = np.abs((np.arange(TURNS) - first[..., None] + TURNS / 2) % TURNS - TURNS / 2)
    second = np.where(apart >= LEAST_ANGLE, votes, 0.0)
    return np.stack([_peak(np.where(apart < LEAST_ANGLE, votes, 0.0)), _peak(second)], axis=-1)


def _peak(votes: FloatArray) -> FloatArray:
    """(...) turn of the most votes, between the turns by a parabola."""
    top = votes.argmax(axis=-1)
    left, middle, right = (np.take_along_axis(votes, (top + k)[..., None] % TURNS, -1)[..., 0] for k in (-1, 0, 1))
    bend = left - 2 * middle + right
    return top + np.where(bend < 0, 0.5 * (left - right) / np.where(bend < 0, bend, 1.0), 0.0).clip(-0.5, 0.5)
