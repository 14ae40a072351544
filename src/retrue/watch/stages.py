"""What is done with a frame. Handed to the watch, so that the watch itself can be driven without pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from retrue.correspondences import Correspondences
from retrue.errors import InputError
from retrue.patterns.pattern import Pattern
from retrue.patterns.photographs import PHOTOGRAPHS
from retrue.recalibration.options import VerifyOptions
from retrue.recalibration.result import Accepted, Refused, Verification
from retrue.rig import Rig
from retrue.watch.frame import Frame


@dataclass(frozen=True, slots=True)
class Stages:
    """The jobs, in the order in which a frame meets them.

    Attributes
    ----------
    write_cloud : None where no clouds are asked for; else writes one, under the frame's name, and says where.
    """

    decode: Callable[[Frame], Correspondences]
    verify: Callable[[Rig, Sequence[Correspondences]], Verification]
    recalibrate: Callable[[Rig, Sequence[Correspondences]], Accepted | Refused]
    write_cloud: Callable[[Rig, Correspondences, str], Path] | None = None


def real_stages(pattern: Pattern | None, clouds: Path | None, options: VerifyOptions) -> Stages:
    """The jobs of the package, both judging by these options; `clouds` is the folder for a cloud per frame."""
    from retrue.recalibration.recalibrate import recalibrate

    cloud = None if clouds is None else partial(cloud_written, clouds)
    return Stages(
        partial(decoded, pattern),
        partial(verified, options=options),
        partial(recalibrate, options=options.estimate),
        cloud,
    )


def decoded(pattern: Pattern | None, frame: Frame) -> Correspondences:
    """What the frame shows, or holds."""
    from retrue.decoding.decode import decode

    if isinstance(frame.content, Correspondences):
        return frame.content
    if isinstance(frame.content, tuple):
        return decode(PHOTOGRAPHS, frame.content)
    if frame.content is None or pattern is None:
        raise InputError("a picture needs the pattern that it shows: give --pattern P.json")
    return decode(pattern, frame.content, names=[frame.name])


def verified(rig: Rig, captures: Sequence[Correspondences], options: VerifyOptions) -> Verification:
    """Whether they fit the rig, and are of its pictures at all."""
    from retrue.rasters import check_extent
    from retrue.recalibration.verify import verify

    for points in captures:
        check_extent(rig, points)
    return verify(rig, captures, options)


def cloud_written(clouds: Path, rig: Rig, points: Correspondences, name: str) -> Path:
    """A cloud in that folder."""
    from retrue.files.ply import write_cloud
    from retrue.reconstruction.reconstruct import reconstruct

    path = clouds / f"{name}.ply"
    write_cloud(path, reconstruct(rig, points))
    return path
