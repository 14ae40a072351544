"""The rig: a camera, a projector, and the pose between them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from retrue.errors import DegenerateError, require_kind
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.shown import ShortRepr, Shown, in_space
from retrue.values import ByValue


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Rig(ByValue, ShortRepr):
    """Camera and projector: X_projector = R X_camera + t.

    Attributes
    ----------
    camera, projector : intrinsics; the projector is treated as a camera run backwards.
    projector_from_camera : the relative pose; t in `unit`.
    unit : name of the unit of length ("mm", "m" ...).
    evidence : what the pose rests on, as plain JSON values; may be empty.
    """

    camera: Camera
    projector: Camera
    projector_from_camera: RigidTransform
    unit: str = "mm"
    evidence: Mapping[str, Any] = field(default_factory=dict[str, Any])

    def __post_init__(self) -> None:
        require_kind(self.camera, Camera, "camera")
        require_kind(self.projector, Camera, "projector")
        require_kind(self.projector_from_camera, RigidTransform, "projector_from_camera")
        require_kind(self.unit, str, "unit")

    def _shown(self) -> Shown:
        rows = {"camera": self.camera.shown_title, "projector": self.projector.shown_title}
        rows["projector_from_camera"] = self.projector_from_camera.shown_title
        if self.evidence:
            rows["evidence"] = ", ".join(map(str, self.evidence))
        return f"in {self.unit}", rows

    def _in_space(self) -> str:
        return in_space(rig=self)


def require_rig(value: object) -> None:
    """An `InputError` that says what to hand in where `value` is no `Rig`."""
    require_kind(value, Rig, "rig", "retrue.read_rig reads one")


def require_baseline(rig: Rig) -> None:
    """A `DegenerateError` where the rig's devices coincide: t = 0 has no direction, and gives no scale."""
    if not np.linalg.norm(rig.projector_from_camera.t) > 0:
        raise DegenerateError(
            "rig: expected a baseline, found t = 0, as if camera and projector were at one place; give t roughly, as"
            " measured: its length is the scale"
        )
