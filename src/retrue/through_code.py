"""Two cameras that see one projected code: their pixels, matched through the projector's."""

from __future__ import annotations

from typing import cast

import numpy as np

from retrue.correspondences import Correspondences, require_both_axes, require_points
from retrue.errors import InputError
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.robust import MAD_TO_SIGMA

NEIGHBOURS = 12
FEWEST = 4
FARTHEST_PX = 3.0
"""Projector pixels, or so many times the usual spacing of the second camera's points, whichever is more."""
OUTLIER = 6.0  # robust sigmas
SAME_PX = 1e-6  # of a code whose points are places of the pattern, such as centres of blocks


def match_through_code(first: Correspondences, second: Correspondences) -> Correspondences:
    """Pixels of the first camera with those of the second that see the same projector pixels.

    Around each projector pixel of the first camera, the nearest points of the second one fix an affine map
    projector -> second camera; where they lie on two surfaces it fits none of them, and the point is left out.
    Of a colour grid the centres of the same blocks are matched as they are.

    Parameters
    ----------
    first, second : what each camera decoded of one projection, both coordinates known.

    Returns
    -------
    Correspondences
        `camera_px` of the first camera, `projector_px` of the second, which stands for the projector.

    Raises
    ------
    InputError : the cameras decoded codes of projectors of different sizes.
    CaptureError : of a code of one coordinate.

    >>> x, y = np.meshgrid(np.arange(0.0, 40, 2), np.arange(0.0, 30, 2))
    >>> projector = np.stack([x.ravel(), y.ravel()], axis=-1)
    >>> left = Correspondences(projector * 1.5 + 7, projector)
    >>> right = Correspondences(projector[:, ::-1] + [0.25, 0.5], projector + [0.3, 0.1])
    >>> match = match_through_code(left, right)
    >>> bool(np.allclose(match.projector_px, (match.camera_px - 7)[:, ::-1] / 1.5 + [0.15, 0.2]))
    True
    """
    from scipy.spatial import KDTree

    for points, name in ((first, "first"), (second, "second")):
        require_points(points)
        require_both_axes(points, name)
    if first.projector_size and second.projector_size and first.projector_size != second.projector_size:
        raise InputError("second: expected what the same projector showed, found a pattern of another size")
    if len(first) == 0 or len(second) < FEWEST:
        return _matched(first.select(np.zeros(len(first), dtype=bool)), np.empty((0, 2)), second)
    tree = KDTree(second.projector_px)

    def nearest(places: FloatArray, count: int) -> tuple[FloatArray, IntArray]:
        return cast("tuple[FloatArray, IntArray]", tree.query(places, count))

    spacing = float(np.median(nearest(second.projector_px[:: max(1, len(second) // 2000)], 2)[0][:, 1]))
    distance, rows = nearest(first.projector_px, min(NEIGHBOURS, len(second)))
    near = distance <= max(FARTHEST_PX, 3 * spacing)
    offsets = second.projector_px[rows] - first.projector_px[:, None]
    there, off, known = _affine(offsets, second.camera_px[rows], near)
    same = distance[:, 0] < SAME_PX
    there = np.where(same[:, None], second.camera_px[rows[:, 0]], there)
    known |= same
    off = np.where(same, 0.0, off)
    if (fitted := known & ~same).any():
        usual = max(MAD_TO_SIGMA * float(np.median(off[fitted])), 1e-3)
        known &= off <= OUTLIER * usual
    return _matched(first.select(known), there[known], second)


def _matched(first: Correspondences, there: FloatArray, second: Correspondences) -> Correspondences:
    return Correspondences(
        first.camera_px,
        there,
        confidence=first.confidence,
        colors=first.colors,
        cells=first.cells,
        camera_size=first.camera_size,
        projector_size=second.camera_size,
    )


def _affine(offsets: FloatArray, pixels: FloatArray, near: BoolArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Of each point (N, K, 2) -> (N, K, 2): the pixel at offset zero, the RMS of the fit, and whether there is one.

    Where the neighbours do not surround the point, no map is taken further than they reach.
    """
    weight = near[:, :, None].astype(np.float64)
    count = weight.sum(axis=1)
    middle = (offsets * weight).sum(axis=1) / np.maximum(count, 1)
    centre = (pixels * weight).sum(axis=1) / np.maximum(count, 1)
    basis, rest = (offsets - middle[:, None]) * weight, (pixels - centre[:, None]) * weight
    normal = np.einsum("nki,nkj->nij", basis, basis)
    a, b, d = normal[:, 0, 0], normal[:, 0, 1], normal[:, 1, 1]
    determinant = a * d - b * b
    spread = np.sqrt((a + d) / np.maximum(count[:, 0], 1))
    known = (count[:, 0] >= FEWEST) & (determinant > 1e-3 * (a + d) ** 2)
    known &= np.linalg.norm(middle, axis=1) <= spread
    safe = np.where(known, determinant, 1.0)
    inverse = np.stack([np.stack([d, -b], -1), np.stack([-b, a], -1)], -2) / safe[:, None, None]
    slope = inverse @ np.einsum("nki,nkj->nij", basis, rest)
    there = centre - np.einsum("ni,nij->nj", middle, slope)
    off = (rest - np.einsum("nki,nij->nkj", basis, slope)) * weight
    return there, np.sqrt((off**2).sum(axis=(1, 2)) / np.maximum(count[:, 0], 1)), known
