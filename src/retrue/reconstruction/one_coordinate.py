"""Columns or rows alone: a camera's ray meets the plane that the projector lights through one of its columns."""

from __future__ import annotations

import numpy as np

from retrue.correspondences import Correspondences
from retrue.geometry.arrays import FloatArray
from retrue.rig import Rig

STEPS = 4
"""A lens bends the plane of a column; the coordinate that is not known moves by less than 1e-6 px after so many."""


def completed_projector_px(rig: Rig, points: Correspondences) -> FloatArray:
    """(N, 2) projector pixels whose unknown coordinate is where the camera's ray meets the plane of the known one.

    With x the camera's undistorted ray and y the projector's, of which one coordinate, i, is known, the depth solves
    Z (y_i (R x)_3 - (R x)_i) = t_i - y_i t_3, and the point's projection has the other. The lens makes y_i depend on
    both pixel coordinates: that of the last step is used, from the middle of the projector's picture on.

    Parameters
    ----------
    rig : its projector's pixels are those of `points`.
    points : of which one projector coordinate is known.

    Returns
    -------
    NaN where the ray meets the plane behind either device or nowhere, or beyond the projector's picture.

    >>> from retrue import Camera, RigidTransform
    >>> camera = Camera((640, 480), [[500, 0, 320], [0, 500, 240], [0, 0, 1]])
    >>> rig = Rig(camera, camera, RigidTransform(np.eye(3), [-100.0, 0, 0]))
    >>> completed_projector_px(rig, Correspondences([[420, 260]], [[370, np.nan]])).tolist()
    [[370.0, 260.0]]
    """
    (known,) = points.axes
    other = 1 - known
    R, t = rig.projector_from_camera.R, rig.projector_from_camera.t
    rays = rig.camera.unproject(points.camera_px)
    turned = rays @ R[:, :2].T + R[:, 2]
    found = points.projector_px.copy()
    found[:, other] = (rig.projector.size[other] - 1) / 2
    with np.errstate(all="ignore"):
        for _ in range(STEPS):
            y = rig.projector.unproject(found)[:, known]
            depth = (t[known] - y * t[2]) / (y * turned[:, 2] - turned[:, known])
            depth[~(depth > 0)] = np.nan
            found[:, other] = rig.projector.project(depth[:, None] * turned + t)[:, other]
    found[~rig.projector.contains(found)] = np.nan
    return found
