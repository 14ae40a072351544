"""A random walk over a grid along its links, which smooths what lies there and crosses no edge."""

from __future__ import annotations

from retrue.geometry.arrays import BoolArray, FloatArray

STEP_WEIGHT = 16.0  # that a step spreads from where all neighbours are linked


def walked(values: FloatArray, right: FloatArray | BoolArray, down: FloatArray | BoolArray, steps: int) -> FloatArray:
    """What `values` (rows, columns, ...) are summed to after steps that stay with weight 2 and take each link with 1,
    along the rows and then along the columns: binomial weights, `STEP_WEIGHT` a step in all.

    Parameters
    ----------
    right, down : 1 where cells are linked to the next of their row (rows, columns - 1, ...), of their column
        (rows - 1, columns, ...); else 0.

    >>> import numpy as np
    >>> one = np.array([[0.0, 1.0, 0.0]])
    >>> walked(one, np.array([[1.0, 0.0]]), np.empty((0, 3)), 1).tolist()
    [[2.0, 4.0, 0.0]]
    """
    for _ in range(steps):
        across = 2 * values
        across[:, 1:] += right * values[:, :-1]
        across[:, :-1] += right * values[:, 1:]
        values = 2 * across
        values[1:] += down * across[:-1]
        values[:-1] += down * across[1:]
    return values
