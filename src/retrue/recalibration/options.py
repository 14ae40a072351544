"""What the recalibration takes for granted, and how sure it must be."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, Optional

from retrue.errors import InputError
from retrue.ranges import check_ranges, ranged, require_number
from retrue.values import ByValue

if TYPE_CHECKING:  # so that the command line's help loads no NumPy
    from retrue.geometry.arrays import FloatArray

LensWord = Literal["fixed", "may-have-changed", "refit"]


@dataclass(frozen=True, slots=True, eq=False)
class KnownDistance(ByValue):
    """The true length between the scene points seen at two camera pixels of the first capture: it gives |t|.

    Attributes
    ----------
    first_px, second_px : (2,) camera pixels (x, y).
    length : in the rig's unit.
    """

    first_px: FloatArray
    second_px: FloatArray
    length: float

    def __post_init__(self) -> None:
        from retrue.geometry.arrays import finite_array, frozen_array

        for name in ("first_px", "second_px"):
            pixel = finite_array(getattr(self, name), (2,), f"known distance, {name}")
            object.__setattr__(self, name, frozen_array(pixel))
        require_number(self.length, "known distance: length", 0, above=True)


@dataclass(frozen=True, slots=True)
class RecalibrateOptions:
    """What `recalibrate` takes for granted, and how sure it must be.

    Attributes
    ----------
    known_distance
        Two camera pixels and the true length between their points. Without it the old |t| is kept.
    lens
        Your word on the lenses: "fixed", nobody touched them; "may-have-changed", the answer must not rest on them;
        "refit", where they did change and the points tell by how much, take the new focal lengths. Without a word they
        are taken to hold, are checked where the points can, and the answer says which.
    max_error
        An answer whose standard deviation moves points at the working distance by a larger share of it is refused;
        unless a projector's (or second camera's) pixel is a larger share there, and moves them further.
    min_margin
        Log evidence (nats) by which the answer must beat every other explanation; 7 is a thousand to one.
    min_points
        Fewest correspondences, and fewest points on a plane.
    max_planes
        Planes split off from one capture, largest first.
    max_points
        Correspondences used in all; more are thinned out evenly. Neighbours in a dense code repeat each other.
    max_noise_px
        Correspondences noisier than this, about the pose that fits them best, are none.
    max_outliers
        Share of correspondences that may contradict the pose.
    focal_sigma
        How well the focal lengths are known, relative, where the rig does not say; part of the sigma of the pose.
    principal_point_sigma_px
        How well the principal points are known; likewise.
    k1_sigma
        How well the first distortion coefficients are known; likewise.
    flatness_sigma
        How far planes are bowed, RMS relative to their distance; likewise.
    calibrated_together
        Whether pose and lenses of a rig that does not say how well they are known came of one calibration, so that they
        err together: sigma is then that of the pose that belongs to those lenses. By default that of two cameras is,
        and of a projector is not.
    rig_sigma_rotation_deg
        How well a rig knows its own rotation, per axis, where it does not say.
    rig_sigma_translation_deg
        Likewise for the direction of t.
    seed
        Of the random samples; the same points and seed give the same answer.
    """

    known_distance: Optional[KnownDistance] = None  # noqa: UP045 - as an `AFile | None` of the command line
    lens: LensWord | None = None
    max_error: float = ranged(0.03, 0, 1)
    min_margin: float = ranged(7.0, 0)
    min_points: int = ranged(12, 4)
    max_planes: int = ranged(4, 1)
    max_points: int = ranged(20_000, 4)
    max_noise_px: float = ranged(2.0, 0)
    max_outliers: float = ranged(0.65, 0, 1)
    focal_sigma: float = ranged(2e-3, 0, 1, above=True)
    principal_point_sigma_px: float = ranged(1.0, 0, 1e6, above=True)
    k1_sigma: float = ranged(1e-3, 0, 1, above=True)
    flatness_sigma: float = ranged(5e-4, 0, 1, above=True)
    calibrated_together: Literal[True, False] | None = None
    rig_sigma_rotation_deg: float = ranged(0.02, 0, 180, above=True)
    rig_sigma_translation_deg: float = ranged(0.05, 0, 180, above=True)
    seed: int = ranged(0, 0, 2**32 - 1)

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.lens not in (None, "fixed", "may-have-changed", "refit"):
            raise InputError(f"lens: expected fixed, may-have-changed or refit, found {self.lens!r}")


@dataclass(frozen=True, slots=True)
class VerifyOptions:
    """Limits of `verify`.

    Attributes
    ----------
    false_alarms
        Share of good rigs that may be called drifted.
    improvable
        A drift that moves points at the working distance by no larger share of it is called improvable: it is found,
        and you may live with it.
    estimate
        What is taken for granted, and how sure the answer must be.
    """

    false_alarms: float = ranged(1e-3, 0, 1)
    improvable: float = ranged(2e-3, 0, 1)
    estimate: RecalibrateOptions = field(default_factory=RecalibrateOptions)

    def __post_init__(self) -> None:
        check_ranges(self)
