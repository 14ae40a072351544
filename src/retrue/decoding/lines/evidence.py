"""Does a surface show this code? Its lines' colours against chance, those that it could not grow over included."""

from __future__ import annotations

import numpy as np

from retrue.decoding.lines.growth import look_ahead
from retrue.decoding.lines.surfaces import Code, Surfaces
from retrue.geometry.arrays import BoolArray, FloatArray, Image, IntArray
from retrue.kernels import places as kernel

SIGNIFICANCE = 4.0  # nats by which a surface must beat chance, by its columns and by its rows


def significant(picture: Image, surfaces: Surfaces, code: Code) -> Surfaces:
    """Only the surfaces whose columns, and whose rows, speak for this place in the code beyond chance.

    Each line of a surface counts once, by what all its crossings say on average: those that are decoded, and those
    beside them where lines cross whose colours are not the code's. A surface that was laid over a wrong place stops
    there.
    """
    surface = np.empty(surfaces.held.size, np.int64)
    kernel.join_linked(surfaces.joints.right, surfaces.joints.down, surface)
    surface = surface.reshape(code.shape)
    row, column = np.nonzero(surfaces.held)
    of_held = code.nats(row, column, surfaces.lights[:, row, column])
    ahead, found, _ = look_ahead(picture, surfaces, surfaces.held)
    other = found.crossing & ~code.right(ahead.target[:, 0], ahead.target[:, 1], found.lights)
    source, target = ahead.source[other], ahead.target[other]
    of_other = code.nats(target[:, 0], target[:, 1], found.lights[:, other])
    owner = np.concatenate([surface[row, column], surface[source[:, 0], source[:, 1]]])
    nats = np.concatenate([of_held, of_other], axis=1)
    rows, columns = np.concatenate([row, target[:, 0]]), np.concatenate([column, target[:, 1]])
    sure = surfaces.held
    for line, of_line, places in ((columns, nats[0], code.shape[1]), (rows, nats[1], code.shape[0])):
        sure &= beats_chance(owner, line, of_line, places, surface.size)[surface]
    return surfaces.only(sure)


def beats_chance(owner: IntArray, line: IntArray, nats: FloatArray, places: int, count: int) -> BoolArray:
    """(count,) whether the lines of each owner, of so many `places` in the code, speak for where they lie.

    Of M crossings: `owner` and `line` (M,), and the `nats` (M,) by which they speak for their line's colour.
    """
    trials = np.log(max(len(np.unique(owner)), 1))
    return _by_line(owner, line, nats, count) > SIGNIFICANCE + np.log(places) + trials


def _by_line(owner: IntArray, line: IntArray, nats: FloatArray, count: int) -> FloatArray:
    """(count,) of each owner the sum over its lines of the mean nats of a line."""
    lines, which = np.unique(np.stack([owner, line]), axis=1, return_inverse=True)
    which = which.ravel()
    mean = np.bincount(which, nats, lines.shape[1]) / np.bincount(which, minlength=lines.shape[1])
    return np.asarray(np.bincount(lines[0], mean, count), dtype=np.float64)
