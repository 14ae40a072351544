"""`retrue warp`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from retrue.cli.command import CapturePath, Outcome, PatternPath, ReportingCommand, RigPath, contradicted, made_folder
from retrue.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Warp(ReportingCommand):
    """Bend a picture so that it looks flat and upright on whatever surface was scanned: projection mapping.

    The folder gets the picture to project, warped.png; st.tiff, the ST map for programs that play films; and mesh.data,
    the warp mesh for those that take one.

    Attributes
    ----------
    rig
        The rig file, as it stands now.
    capture
        The surface: a picture (colour grid), a folder of pictures, or a points CSV.
    pattern
        What the projector showed, JSON; not needed for a CSV.
    picture
        What is to be seen on the surface.
    rectangle
        X Y WIDTH HEIGHT of where it is to be seen, in pixels of the rig's camera as if it had no distortion; the
        largest place that lies on the surface, unless told otherwise.
    viewer
        X Y Z of another place to see it from, in the camera's frame and the rig's unit, looking the same way.
    every
        Projector pixels between nodes of the mesh.
    out
        The folder to write.
    """

    rig: RigPath
    capture: CapturePath
    pattern: PatternPath = None
    picture: Path
    rectangle: Annotated[tuple[float, float, float, float] | None, arg(metavar="X Y WIDTH HEIGHT")] = None
    viewer: Annotated[tuple[float, float, float] | None, arg(metavar="X Y Z")] = None
    every: int = 16
    out: Path

    def run(self) -> Outcome:
        import numpy as np

        from retrue.files.exchange.warps import warped_picture, write_st_map, write_warp_mesh
        from retrue.files.images import read_image, write_png
        from retrue.files.rigs import read_rig
        from retrue.geometry.transform import RigidTransform
        from retrue.reconstruction.reconstruct import reconstruct
        from retrue.reconstruction.warp import warp

        rig = read_rig(self.rig)
        if not 1 <= self.every < min(rig.projector.size):
            raise InputError(f"--every: expected pixels within the projector's picture, found {self.every}")
        picture = read_image(self.picture)
        (capture,) = self.read(rig, [self.capture], self.pattern, one_coordinate=True)
        if (refusal := contradicted(rig, [capture])) is not None:
            return refusal
        away = None if self.viewer is None else RigidTransform(np.eye(3), -np.array(self.viewer))
        size = picture.shape[1], picture.shape[0]
        laid = warp(rig, reconstruct(rig, capture.points), size, view_from_camera=away, rectangle=self.rectangle)
        folder = made_folder(self.out)
        write_png(folder / "warped.png", warped_picture(laid, picture))
        write_st_map(folder / "st.tiff", laid)
        write_warp_mesh(folder / "mesh.data", laid, self.every)
        lit = float(np.isfinite(laid.st[..., 0]).mean())
        left, top, width, height = laid.rectangle
        text = (
            f"{folder}: warped.png, st.tiff and mesh.data; the picture is seen at ({left:g}, {top:g}), "
            f"{width:g} x {height:g} px, lit by {lit:.0%} of the projector's pixels"
        )
        return Outcome({"out": str(folder), "rectangle": list(laid.rectangle), "share_of_projector": lit}, text)
