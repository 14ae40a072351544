"""`retrue export`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from retrue.cli.command import CapturePaths, Outcome, PatternPath, ReportingCommand, RigPath, contradicted

if TYPE_CHECKING:
    from retrue.capture import Capture
    from retrue.geometry.arrays import FloatArray, Image
    from retrue.reconstruction.cloud import Cloud
    from retrue.rig import Rig

TOOLS = ("colmap", "nerfstudio", "ros", "bag")


@dataclass(frozen=True, kw_only=True)
class Export(ReportingCommand):
    """Hand a rig and its scans over to other programs: folders for COLMAP, nerfstudio and ROS 2, or a ROS 2 bag.

    A cloud alone is written by `retrue reconstruct`, whose file's ending names the format.

    Attributes
    ----------
    rig
        The rig file, as it stands now.
    captures
        Pictures, folders of pictures, or points CSVs: one for COLMAP and nerfstudio, any number for a bag, none for
        `ros`.
    pattern
        What the projector showed, JSON; not needed for a CSV.
    to
        colmap (sparse/0 and images, in the rig's unit), nerfstudio (transforms.json, images, depth, points; metres),
        ros (rig.urdf, a launch file of static transforms, camera_info; metres), or bag (transforms, camera_info and
        clouds; metres; needs `pip install '.[ros]'`).
    out
        The folder to write.
    """

    rig: RigPath
    captures: CapturePaths = ()
    pattern: PatternPath = None
    to: Annotated[str, arg(metavar="NAME")]
    out: Path

    def run(self) -> Outcome:
        from retrue.errors import InputError
        from retrue.files.exchange.ros import require_bag, write_bag, write_ros
        from retrue.files.rigs import read_rig

        if self.to not in TOOLS:
            raise InputError(f"--to: expected one of {', '.join(TOOLS)}, found {self.to}")
        if self.to in ("colmap", "nerfstudio") and len(self.captures) != 1:
            raise InputError(f"--to {self.to}: expected one CAPTURE after the rig, found {len(self.captures)}")
        if self.to == "bag":
            require_bag(self.out)
        rig = read_rig(self.rig)
        if self.to == "ros":
            write_ros(self.out, rig)
            return Outcome({"out": str(self.out), "to": self.to}, f"{self.out}: URDF, transforms and camera_info in it")
        captures = self.read(rig, self.captures, self.pattern, one_coordinate=True, photographs=True)
        if (refusal := contradicted(rig, captures)) is not None:
            return refusal
        clouds = [self._cloud(rig, capture) for capture in captures]
        if self.to == "bag":
            write_bag(self.out, rig, clouds, [path.stat().st_mtime_ns for path in self.captures])
        else:
            self._write_scene(rig, captures[0], clouds[0])
        report = {"out": str(self.out), "to": self.to, "points": [len(cloud) for cloud in clouds]}
        counted = ", ".join(
            f"{len(cloud)} points of {capture.name}" for cloud, capture in zip(clouds, captures, strict=True)
        )
        return Outcome(report, f"{self.out}: written for {self.to}: {counted}")

    def _cloud(self, rig: Rig, capture: Capture) -> Cloud:
        from retrue.reconstruction.reconstruct import reconstruct

        return reconstruct(rig, capture.points)

    def _write_scene(self, rig: Rig, capture: Capture, cloud: Cloud) -> None:
        from retrue.files.exchange.photogrammetry import rig_views, write_colmap, write_nerfstudio

        write = write_colmap if self.to == "colmap" else write_nerfstudio
        write(self.out, cloud, rig_views(rig, cloud, capture.photograph, self._shown(), *self._depths(rig, cloud)))

    def _shown(self) -> Image | None:
        """What the projector showed, where that is one picture."""
        from retrue.files.patterns import read_pattern
        from retrue.patterns.color_grid import ColorGrid
        from retrue.patterns.line_grid import LineGrid

        pattern = None if self.pattern is None else read_pattern(self.pattern)
        return pattern.render() if isinstance(pattern, ColorGrid | LineGrid) else None

    def _depths(self, rig: Rig, cloud: Cloud) -> tuple[FloatArray | None, FloatArray | None]:
        """On the pixels of both devices; None for COLMAP, which has no place for it, and where there is no surface."""
        from retrue.errors import DegenerateError
        from retrue.reconstruction.depth_map import depth_map

        if self.to == "colmap":
            return None, None
        try:
            return depth_map(cloud, rig.camera), depth_map(cloud, rig.projector, rig.projector_from_camera)
        except DegenerateError:
            return None, None
