"""What is known of pixels beforehand: they are square, unless the boards say otherwise.

Few boards leave fy / fx open, and with it the focal length: shape of pixels, tilt and distance trade against each
other. The fit has both focal lengths free, and weighs every point as if it erred by itself. What is known beforehand
must be weighed against the covariance as it is; so it joins the finished fit, as Kalman's update. With
e = log(fy / fx), h its derivative by the parameters, C their covariance and v = h' C h + UNSEEN^2,

    parameters -= C h e / v,    C -= C h h' C / v.

e^2 / v is the fall of chi-square that pixels of another shape bring. Where it exceeds ln(number of observations) they
pay for themselves, as other terms do: the aspect is kept as it was fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from retrue.calibration.bundle import Adjusted, adjust
from retrue.calibration.model_terms import Choice
from retrue.calibration.observations import Group
from retrue.geometry.arrays import FloatArray

UNSEEN = 5e-4
"""How far fy / fx may be from one in truth that the data do not show: sensors and panels are etched far finer, a lens
squeezes that much."""


def with_square_pixels(
    fit: Adjusted, groups: tuple[Group, ...], choices: Sequence[Choice]
) -> tuple[Adjusted, tuple[Choice, ...]]:
    """The fit of an honest covariance with pixels as square as the boards let them be; the choices, with the aspect.

    Untouched are devices that were held, and one of which one coordinate alone is told. The least doubtful comes first:
    what it turns out to be tells on the other.
    """
    columns, step, covariance = fit.setup.columns, np.zeros(len(fit.active)), fit.covariance
    told, needed = list(choices), float(np.log(sum(2 * len(group.view) for group in groups)))
    left = [device for device in range(columns.devices) if fit.active[columns.pinhole(device)].all()]
    while left:
        aspects = {device: _aspect(fit, step, covariance, device) for device in left}
        gains = {device: off**2 / variance for device, (off, _, variance) in aspects.items()}
        device = min(left, key=gains.__getitem__)
        left.remove(device)
        kept, (off, shared, variance) = gains[device] > needed, aspects[device]
        if not kept:
            step = step - shared * off / variance
            covariance = covariance - np.outer(shared, shared) / variance
        names, gain = told[device].kept, {"aspect": gains[device], **told[device].gain}
        told[device] = replace(told[device], kept=("aspect", *names) if kept else names, gain=gain)
    moved = fit.setup.moved(step)
    if moved is None or not step.any():
        return fit, tuple(told)
    boards = adjust(moved, groups, np.zeros_like(fit.active), scales=fit.scales)  # they follow the devices
    fit = replace(fit, setup=boards.setup, errors=boards.errors, weights=boards.weights, covariance=covariance)
    return fit, tuple(told)


def _aspect(fit: Adjusted, step: FloatArray, covariance: FloatArray, device: int) -> tuple[float, FloatArray, float]:
    """Of a device after that step: e, its covariance with all parameters, and v."""
    both = fit.setup.columns.pinhole(device).start + np.arange(2)
    f = np.diag(fit.setup.devices[device].K)[:2]
    h = np.array([-1, 1]) / f
    shared = covariance[:, both] @ h
    return float(np.log(f[1] / f[0]) + h @ step[both]), shared, float(h @ shared[both] + UNSEEN**2)
