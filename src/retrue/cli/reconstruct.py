"""`retrue reconstruct`."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tyro.conf import OmitArgPrefixes

from retrue.cli.command import (
    DONE,
    CapturePath,
    Outcome,
    PatternPath,
    ReportingCommand,
    RigPath,
    read_captures,
    require_writable,
)
from retrue.reconstruction.options import ReconstructOptions


@dataclass(frozen=True, kw_only=True)
class Reconstruct(ReportingCommand):
    """Turn one capture into a coloured cloud of points, and into a mesh that stops at depth jumps.

    Attributes
    ----------
    rig
        The rig file, as it stands now.
    capture
        A picture (colour grid), a folder of pictures (Gray code), or a points CSV.
    pattern
        What the projector showed, JSON; not needed for a CSV.
    out
        The cloud to write, PLY, in the camera frame and the rig's unit.
    mesh
        The mesh to write, PLY.
    limits
        Limits of the method.
    """

    rig: RigPath
    capture: CapturePath
    pattern: PatternPath = None
    out: Path
    mesh: Path | None = None
    limits: OmitArgPrefixes[ReconstructOptions] = field(default_factory=ReconstructOptions)

    def run(self) -> Outcome:
        from retrue.files.plain_json import plain
        from retrue.files.ply import write_cloud, write_mesh
        from retrue.files.rigs import read_rig
        from retrue.reconstruction.mesh import make_mesh
        from retrue.reconstruction.reconstruct import reconstruct

        require_writable(self.out, self.mesh, self.report)
        rig = read_rig(self.rig)
        (points,) = read_captures([self.capture], self.pattern)
        start = time.perf_counter()
        cloud = reconstruct(rig, points, self.limits)
        mesh = None if self.mesh is None else make_mesh(cloud)
        report: dict[str, Any] = {**plain(cloud.card), "unit": cloud.unit, "seconds": time.perf_counter() - start}
        write_cloud(self.out, cloud)
        report["out"] = str(self.out)
        text = f"{self.out}: {len(cloud)} of {len(points)} points, RMS {report['epipolar_rms_px']:.3f} px"
        if mesh is not None and self.mesh is not None:
            write_mesh(self.mesh, mesh)
            report |= {"mesh": str(self.mesh), "faces": len(mesh.faces)}
            text += f"\n{self.mesh}: {len(mesh.faces)} faces"
        page = None
        if self.report is not None:
            from retrue.cli.report import seen_captures
            from retrue.report.reconstruction_page import reconstruction_page

            (seen,) = seen_captures([self.capture], self.pattern, [points])
            faces = None if mesh is None else len(mesh.faces)
            page = (self.report, reconstruction_page(rig, seen, cloud, faces=faces))
        return Outcome(report, text, DONE, page)
