"""Codes off by one shift, on any surface: moved back, they lie on their epipolar lines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.camera import Camera
from retrue.geometry.robust import CUTOFF, biweight_level
from retrue.geometry.two_view import FREE, TwoViewPoints, behind, epipolar_residuals
from retrue.kernels import copies as kernel
from retrue.recalibration.lens import LENS_PARAMETERS, changed_device
from retrue.recalibration.parts import A_COPY, FEWEST_OF_A_PART, LOUD, MOST_COPIES, SHARE_OF_A_PART, Part
from retrue.recalibration.posterior import Posterior

DRAWN = 24  # points whose pairs tell a shift
REFINED = 4  # steps of least squares
PARALLEL = 1e-5  # of the other axis: what lines of a rectified rig tell of a shift along them


def shifted_codes(posterior: Posterior, outside: BoolArray) -> list[Part]:
    """Parts of those points that one shift d of the projector's pixels explains: periods that a code is off by.

    Each misses its line by r(p), and r(p - d) ~ r - g d with its gradient g: two points tell a shift, and that of most
    is it. Where lines are parallel, what is along them is not told, and none. What lies on its line as it stands was
    not shifted, but is behind a device; and so is nothing that was.
    """
    found, fewest = list[Part](), max(FEWEST_OF_A_PART, SHARE_OF_A_PART * int(np.count_nonzero(outside)))
    device = changed_device(posterior.measured.rig.projector, posterior.parameters.lens[LENS_PARAMETERS:])
    reach = CUTOFF * posterior.fit.epipolar_noise.total
    rows = np.flatnonzero(outside & ~(np.abs(epipolar_residuals(posterior.pose, posterior.points)) < reach))
    while len(rows) >= fewest and len(found) < MOST_COPIES:
        shift = _shift_of_most(posterior, device, rows, reach, fewest)
        if shift is None:
            break
        back = _moved_back(posterior, device, rows, shift)
        missed = epipolar_residuals(posterior.pose, back)
        near = (np.abs(missed) < reach) & ~behind(posterior.pose, back, posterior.fit.epipolar_noise.level)
        own = missed[near, None]
        level = biweight_level(own.ravel())
        if np.count_nonzero(near) < fewest or not level < LOUD * posterior.fit.epipolar_noise.level:
            break  # what is louder than the pose follows something else, little by little, as through another lens
        copy = np.zeros(len(outside), dtype=np.bool_)
        copy[rows[near]] = True
        seldom = max(0.0, 1 - np.count_nonzero(~outside) / np.count_nonzero(near))
        found.append(Part(A_COPY, copy, 2, own, level, seldom=seldom))
        rows = rows[~near]
    return found


def _shift_of_most(
    posterior: Posterior, device: Camera, rows: IntArray, reach: float, fewest: float
) -> FloatArray | None:
    """(2,) px; `reach`, how far from its line a point may be; None where far fewer than so many agree on one."""
    missed, *ahead = _missed(posterior, device, rows, np.eye(3, 2, -1))  # none, and one along either axis
    gradient = missed - np.array(ahead)
    seen = np.isfinite(gradient).all(axis=0)  # a lens may not map a pixel beside its picture
    rows, missed, gradient = rows[seen], missed[seen], np.compress(seen, gradient, axis=1)
    drawn = np.unique(np.linspace(0, len(rows) - 1, DRAWN).astype(np.int64)) if len(rows) else rows
    shift = np.empty(2)
    if not kernel.shift_of_most(gradient, missed, drawn, reach, shift) >= fewest / 2:  # else some may be brought near
        return None
    near = np.abs(missed - shift @ gradient) < reach
    for _ in range(REFINED):  # lines and lenses bend over a large shift, and all of them may miss their lines by that
        left = _missed(posterior, device, rows[near], shift[None])[0]
        shift = shift + np.linalg.pinv(gradient.T[near], rcond=PARALLEL) @ left
        near = np.abs(_missed(posterior, device, rows, shift[None])[0]) < 2 * reach
    return shift


def _missed(posterior: Posterior, device: Camera, rows: IntArray, shifts: FloatArray) -> FloatArray:
    """(S, rows) by how much those points miss their lines, moved back by each of S shifts (S, 2), in their sigma."""
    each, by = np.tile(rows, len(shifts)), np.repeat(shifts, len(rows), axis=0)
    return epipolar_residuals(posterior.pose, _moved_back(posterior, device, each, by)).reshape(len(shifts), -1)


def _moved_back(posterior: Posterior, device: Camera, rows: IntArray, shift: FloatArray) -> TwoViewPoints:
    """Those points with their pixels of the `device`, the projector through these lenses, moved back; on no plane.

    All by one shift (2,), or each by its own (rows, 2).
    """
    points = posterior.points.select(rows)
    back = device.unproject(posterior.measured.projector_px[rows] - shift)
    return replace(points, projector_rays=back, plane_index=np.full(len(rows), FREE))
