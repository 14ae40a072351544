"""How far each centre may be off, from how its neighbours scatter."""

from __future__ import annotations

import numpy as np

from retrue.decoding.grid_surface import DIRECTIONS, Joints, middles, shifted
from retrue.geometry.arrays import FloatArray

LEAST = 0.02  # px, standard deviation of the best centres
PRIOR = 4.0  # lines that the noise of the whole picture counts as
GAIN = 4.375  # variance of a fourth difference x[-2]/4 - x[-1] + 3/2 x[0] - x[1] + x[2]/4, over that of x
END_GAIN = 5.0  # the same of a third difference x[-1]/2 - 3/2 x[0] + 3/2 x[1] - x[2]/2


def noise_of(position: FloatArray, joints: Joints) -> FloatArray:
    """Standard deviation per axis (rows, columns) of centres at `position` (rows, columns, 2).

    Along each row, column and diagonal of a smooth surface the second differences hardly change, so their changes are
    noise. One block has up to four lines of its own, of two coordinates: they are averaged with the noise of the whole
    picture, as if that were PRIOR lines more.
    """
    bend = position - middles(position, joints)
    lines = np.full(bend.shape[:3], np.nan)
    for k, (down, right) in enumerate(DIRECTIONS):
        after, before = shifted(bend[k], (down, right), np.nan), shifted(bend[k], (-down, -right), np.nan)
        inner = ((bend[k] - (before + after) / 2) ** 2).mean(axis=-1) / GAIN
        end = ((bend[k] - np.where(np.isfinite(before), before, after)) ** 2).mean(axis=-1) / END_GAIN
        lines[k] = np.where(np.isfinite(inner), inner, end)
    known = np.isfinite(lines)
    # The mean of two squared normal coordinates has its median at ln 2.
    usual = max(float(np.median(lines[known])) / np.log(2), LEAST**2) if known.any() else 1.0
    own = np.where(known, lines, 0.0).sum(axis=0)
    sigma = np.sqrt(np.maximum((PRIOR * usual + own) / (PRIOR + known.sum(axis=0)), LEAST**2))
    return np.where(np.isfinite(position[..., 0]), sigma, np.nan)
