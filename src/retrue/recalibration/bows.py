"""How a plane may be bowed."""

from __future__ import annotations

import numpy as np

from retrue.geometry.arrays import FloatArray
from retrue.geometry.two_view import FREE, TwoViewPoints

BOWS = 3


def bow_shapes(points: TwoViewPoints) -> FloatArray:
    """(N, 3) three bows of each plane, together of RMS 1, without what a tilt takes up."""
    shapes = np.zeros((len(points), BOWS))
    for plane in range(int(points.plane_index.max(initial=FREE)) + 1):
        mine = np.flatnonzero(points.plane_index == plane)
        if len(mine) < 2 * BOWS:
            continue
        x = points.camera_rays[mine]
        linear = np.column_stack([x, np.ones(len(x))])
        scaled = (x - x.mean(axis=0)) / np.maximum(x.std(axis=0), 1e-300)
        bows = np.stack([scaled[:, 0] ** 2, scaled[:, 0] * scaled[:, 1], scaled[:, 1] ** 2], axis=1)
        bows -= linear @ np.linalg.lstsq(linear, bows, rcond=None)[0]
        shapes[mine] = bows / np.maximum(bows.std(axis=0) * np.sqrt(BOWS), 1e-300)
    return shapes
