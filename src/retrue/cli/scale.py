"""`retrue scale`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import arg

from retrue.cli.command import (
    CapturePath,
    Outcome,
    PatternPath,
    ReportingCommand,
    RigPath,
    contradicted,
    require_writable,
)
from retrue.errors import InputError

if TYPE_CHECKING:
    from retrue.geometry.arrays import FloatArray
    from retrue.reconstruction.cloud import Cloud
    from retrue.reconstruction.scale import Scale as Factor
    from retrue.rig import Rig


@dataclass(frozen=True, kw_only=True)
class Scale(ReportingCommand):
    """Give a rig its scale from something in view whose size is known: two points, a ball, or a bar with two balls.

    Say where it is by camera pixels (--click), or by places as `retrue view` writes them after two clicks (--at). What
    is measured is the length of t; the rig's evidence keeps its sigma.

    Attributes
    ----------
    rig
        The rig file, as it stands now.
    capture
        A picture, a folder of pictures, a points CSV, or a cloud that this rig made (PLY).
    pattern
        What the projector showed, JSON; not needed for a CSV or a cloud.
    known
        points:LENGTH between two places, sphere:DIAMETER, or spheres:DIAMETER:DISTANCE; such as points:120mm+-0.1mm,
        where +- is the expanded uncertainty (k = 2) of that length.
    click
        X Y of each place in the camera's picture, one after the other: two for points and for a bar, anywhere on each
        ball, one for a ball.
    at
        X Y Z of each place, in the camera frame and the rig's unit.
    out
        The rig to write.
    """

    rig: RigPath
    capture: CapturePath
    pattern: PatternPath = None
    known: Annotated[str, arg(metavar="KNOWN")]
    click: Annotated[tuple[float, ...], arg(metavar="X Y ...")] = ()
    at: Annotated[tuple[float, ...], arg(metavar="X Y Z ...")] = ()
    out: Path

    def run(self) -> Outcome:
        from retrue.acceptance.artefact import parse_artefact
        from retrue.files.rigs import read_rig, write_rig
        from retrue.reconstruction.scale import scaled_rig

        require_writable(self.out, made_of=(self.capture, self.pattern))
        kind, _, length = self.known.partition(":")
        if kind == "plane":
            raise InputError("--known: expected points, sphere or spheres, found plane: a plane has no length")
        try:
            known = parse_artefact(f"sphere:{length}" if kind == "points" else self.known)
        except InputError as error:
            if kind in ("sphere", "spheres"):
                raise
            told = "points:LENGTH, sphere:DIAMETER or spheres:DIAMETER:DISTANCE, such as points:120mm"
            raise InputError(f"--known: expected {told}, found {self.known!r}") from error
        rig = read_rig(self.rig)
        places = self._places(rig, 1 if kind == "sphere" else 2)
        cloud = self._cloud(rig)
        if isinstance(cloud, Outcome):
            return cloud
        scale = _measured(cloud, kind, known.converted(rig.unit), places)
        write_rig(self.out, scaled_rig(rig, scale))
        report = {name: getattr(scale, name) for name in ("factor", "sigma", "measured", "true", "how")}
        text = (
            f"{scale.how}: {scale.measured:.6g} {rig.unit} long, truly {scale.true:.6g} {rig.unit}\n"
            f"lengths x {scale.factor:.6g}, sigma {100 * scale.sigma:.2g} %\n{self.out}: written"
        )
        return Outcome(report | {"unit": rig.unit, "out": str(self.out)}, text)

    def _places(self, rig: Rig, count: int) -> FloatArray:
        """(count, 2) camera pixels."""
        import numpy as np

        if bool(self.click) == bool(self.at):
            raise InputError("scale: expected --click or --at, and not both")
        name, width = ("--click", 2) if self.click else ("--at", 3)
        numbers = np.array(self.click or self.at)
        if len(numbers) != width * count:
            raise InputError(f"{name}: expected {width * count} numbers, {width} for each place, found {len(numbers)}")
        places = numbers.reshape(count, width)
        if width == 2:
            return places
        if not (places[:, 2] > 0).all():
            raise InputError("--at: expected places before the camera, with Z above 0")
        return rig.camera.project(places)

    def _cloud(self, rig: Rig) -> Cloud | Outcome:
        from retrue.files.models import MESH_ENDINGS, read_model
        from retrue.reconstruction.cloud import Cloud
        from retrue.reconstruction.reconstruct import reconstruct

        if self.capture.suffix.lower() not in MESH_ENDINGS:
            (capture,) = self.read(rig, [self.capture], self.pattern, one_coordinate=True)
            return contradicted(rig, [capture]) or reconstruct(rig, capture.points)
        model = read_model(self.capture, rig.unit)
        if not isinstance(model, Cloud) or model.unit != rig.unit:
            raise InputError(f"{self.capture}: expected a cloud in {rig.unit} that this rig made")
        return replace(model, camera_px=rig.camera.project(model.points))


def _measured(cloud: Cloud, kind: str, known: Any, places: FloatArray) -> Factor:
    from retrue.reconstruction.scale import scale_from_ball, scale_from_ball_bar, scale_from_points

    length = known.distance or known.diameter
    if kind == "sphere":
        return scale_from_ball(cloud, places[0], length.value, length.expanded / 2)
    measure = scale_from_points if kind == "points" else scale_from_ball_bar
    return measure(cloud, places[0], places[1], length.value, length.expanded / 2)
