"""How sure a rig says that its numbers are: pose, length of t, and lenses, in its evidence."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from retrue.errors import InputError
from retrue.geometry.arrays import FloatArray, finite_array
from retrue.rig import Rig

POSE, LENS = 6, 4
RIG_NUMBERS = POSE + 2 * LENS
"""q: rotation (3) about the projector's axes, direction of t (2) in its `tangent_basis`, log |t|; of camera and then
projector the log of the focal length, the principal point (2) in px, and k1."""
LOG_LENGTH = POSE - 1  # log |t|, last of the pose


def rig_covariance(rig: Rig) -> FloatArray:
    """(14, 14) of the rig's numbers, as `RIG_NUMBERS` are; from its evidence, zero where that says nothing.

    `rig_covariance` holds all of it, as `retrue calibrate` writes it. Else the pose's `covariance` (5, 5), the
    `lens_covariance` (8, 8), and the relative `scale_sigma` of |t|, each as if it erred by itself.

    Raises
    ------
    InputError : one of them is no covariance.
    """
    whole = rig.evidence.get("rig_covariance")
    if whole is not None:
        return _checked(whole, RIG_NUMBERS, "rig_covariance")
    found = np.zeros((RIG_NUMBERS, RIG_NUMBERS))
    for name, first, size in (("covariance", 0, POSE - 1), ("lens_covariance", POSE, 2 * LENS)):
        stated = rig.evidence.get(name)
        if stated is not None:
            found[first : first + size, first : first + size] = _checked(stated, size, name)
    scale = rig.evidence.get("scale_sigma")
    if scale is not None:
        found[LOG_LENGTH, LOG_LENGTH] = float(finite_array([scale], (1,), "rig evidence, scale_sigma")[0]) ** 2
    return found


def unstated(rig: Rig) -> tuple[str, ...]:
    """Which of "pose", "lenses" and "scale" the rig says nothing of, so that they count as exact."""
    if rig.evidence.get("rig_covariance") is not None:
        return ()
    keys = {"pose": "covariance", "lenses": "lens_covariance", "scale": "scale_sigma"}
    return tuple(what for what, key in keys.items() if rig.evidence.get(key) is None)


def rescaled(rig: Rig, factor: float, how: str, sigma: float) -> Rig:
    """The rig with t so many times as long; its evidence tells by what, and its relative sigma."""
    evidence: dict[str, Any] = {**rig.evidence, "scale": how, "scale_sigma": sigma}
    if "rig_covariance" in evidence:
        whole = rig_covariance(rig).copy()
        whole[LOG_LENGTH], whole[:, LOG_LENGTH] = 0.0, 0.0
        whole[LOG_LENGTH, LOG_LENGTH] = sigma**2
        evidence["rig_covariance"] = whole.tolist()
    if isinstance(evidence.get("working_distance"), int | float):
        evidence["working_distance"] *= factor
    pose = rig.projector_from_camera
    return replace(rig, projector_from_camera=replace(pose, t=pose.t * factor), evidence=evidence)


def _checked(value: object, size: int, name: str) -> FloatArray:
    covariance = finite_array(value, (size, size), f"rig evidence, {name}")  # pyright: ignore[reportArgumentType]
    values = np.linalg.eigvalsh(covariance)
    if not values[0] >= -1e-9 * max(float(values[-1]), 0.0):
        raise InputError(f"rig evidence, {name}: expected a covariance, found eigenvalues that are negative")
    return (covariance + covariance.T) / 2
