"""How far each centre may be off, from how its neighbours scatter."""

from __future__ import annotations

import numpy as np

from retrue.decoding.blocks.lines import DIRECTIONS, middles
from retrue.decoding.blocks.surface import Joints
from retrue.geometry.arrays import FloatArray
from retrue.geometry.compiling import OUT_STACK, compiled, numba

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
    lines = np.full((len(DIRECTIONS), *position.shape[:2]), np.nan)
    _bend_changes(position - middles(position, joints), lines)
    known = np.isfinite(lines)
    # The mean of two squared normal coordinates has its median at ln 2.
    usual = max(float(np.median(lines[known])) / np.log(2), LEAST**2) if known.any() else 1.0
    own = np.where(known, lines, 0.0).sum(axis=0)
    sigma = np.sqrt(np.maximum((PRIOR * usual + own) / (PRIOR + known.sum(axis=0)), LEAST**2))
    return np.where(np.isfinite(position[..., 0]), sigma, np.nan)


@compiled(numba.void(numba.types.Array(numba.float64, 4, "C"), OUT_STACK))
def _bend_changes(bend: FloatArray, lines: FloatArray) -> None:
    """`lines` (4, rows, columns) <- variance of one coordinate from the change of `bend` (4, rows, columns, 2)."""
    _, rows, columns, _ = bend.shape
    for k, (down, right) in enumerate(DIRECTIONS):
        for r in range(rows):
            for c in range(columns):
                i, j = r + down, c + right
                after = i < rows and 0 <= j < columns and np.isfinite(bend[k, i, j, 0])
                i, j = r - down, c - right
                before = i >= 0 and 0 <= j < columns and np.isfinite(bend[k, i, j, 0])
                if not np.isfinite(bend[k, r, c, 0]) or not (after or before):
                    continue
                total = 0.0
                for x in range(2):
                    next_one = bend[k, r + down, c + right, x] if after else 0.0
                    last_one = bend[k, r - down, c - right, x] if before else 0.0
                    usual = (next_one + last_one) / 2 if after and before else next_one + last_one
                    total += (bend[k, r, c, x] - usual) ** 2
                lines[k, r, c] = total / 2 / (GAIN if after and before else END_GAIN)
