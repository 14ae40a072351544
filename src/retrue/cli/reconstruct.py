"""`retrue reconstruct`."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tyro.conf import OmitArgPrefixes

from retrue.cad.options import CadOptions
from retrue.cli.command import (
    DONE,
    REFUSED_OR_DRIFTED,
    AFile,
    CapturePaths,
    Outcome,
    PatternPath,
    RigPath,
    require_writable,
    with_advice,
)
from retrue.cli.photographs import PhotographCommand, read_pairs
from retrue.errors import InputError
from retrue.reconstruction.options import ReconstructOptions

if TYPE_CHECKING:
    from retrue.cad.model import CadModel
    from retrue.capture import Capture
    from retrue.correspondences import Correspondences
    from retrue.geometry.camera import Camera
    from retrue.recalibration.result import Verification
    from retrue.reconstruction.cloud import Cloud, Mesh
    from retrue.report.page import Page
    from retrue.rig import Rig

MOST_PATCHES_SHOWN = 12


@dataclass(frozen=True, kw_only=True)
class Reconstruct(PhotographCommand):
    """Turn one capture into a coloured cloud of points, a mesh that stops at depth jumps, and surfaces for CAD.

    Nothing is written where the capture contradicts the rig by more than `retrue verify` calls improvable, or no pose
    explains it.

    Attributes
    ----------
    rig
        The rig file, as it stands now.
    captures
        One: a picture (colour grid), a folder of pictures (Gray code), or a points CSV; with --stereo one pair of
        photographs, of which every pixel is matched.
    pattern
        What the projector showed, JSON; not needed for a CSV.
    out
        The cloud to write: PLY, OBJ, PCD, XYZ or NPZ in the rig's unit, GLB or E57 in metres, as the name ends.
    mesh
        The mesh to write: PLY or OBJ in the rig's unit, STL in millimetres, GLB in metres, as the name ends.
    depth
        The depth map to write, on the photograph's own pixels: PNG of 16 bits in millimetres, TIFF of floats in the
        rig's unit; the camera goes beside it, JSON.
    undistorted
        Draw the depth map for a camera of the same K and no distortion, as programs want that know no lenses.
    cad
        The surfaces to write, STEP in millimetres; needs `pip install '.[cad]'`.
    fill_holes
        Fill holes that one smooth patch explains.
    normals
        Write normals too; into a cloud that is PLY.
    anyway
        Write also where the capture contradicts the rig.
    limits
        Limits of the method.
    cad_limits
        Limits of the surfaces.
    """

    rig: RigPath
    captures: CapturePaths
    pattern: PatternPath = None
    out: Path
    mesh: AFile | None = None
    depth: AFile | None = None
    undistorted: bool = False
    cad: AFile | None = None
    fill_holes: bool = False
    normals: bool = False
    anyway: bool = False
    limits: OmitArgPrefixes[ReconstructOptions] = field(default_factory=ReconstructOptions)
    cad_limits: OmitArgPrefixes[CadOptions] = field(default_factory=CadOptions)

    def run(self) -> Outcome:
        from retrue.answers import answer_report
        from retrue.cad.make_cad import make_cad
        from retrue.files.rigs import read_rig
        from retrue.recalibration.options import RecalibrateOptions
        from retrue.recalibration.reasons import RaysMiss
        from retrue.recalibration.result import refuted
        from retrue.recalibration.verify import unasked, verify
        from retrue.reconstruction.depth_map import depth_map
        from retrue.reconstruction.mesh import make_mesh
        from retrue.reconstruction.reconstruct import reconstruct

        made_of = (self.rig, *self.captures, self.pattern)
        require_writable(self.out, self.mesh, self.depth, self.cad, self.report, made_of=made_of)
        rig = read_rig(self.rig)
        capture, dense = self._one_capture(rig)
        self._require_formats(rig.unit)
        start = time.perf_counter()
        verification = unasked(capture.points) if len(capture.points.axes) < 2 else verify(rig, [capture.points])
        nothing = not len(capture.points)
        if nothing or (verification.forbids_measuring and not self.anyway):
            return self._contradicted(rig, capture, verification, time.perf_counter() - start)
        cloud = reconstruct(rig, capture.points if dense is None else dense(), self.limits)
        if dense is not None and verification.epipolar_rms_px is not None:  # every pixel lies on its line; matches tell
            cloud = replace(cloud, card={**cloud.card, "epipolar_rms_px": verification.epipolar_rms_px})
        missed, most = cloud.card["epipolar_rms_px"], RecalibrateOptions().max_noise_px
        if missed is not None and not (missed <= most or self.anyway):
            verification = refuted(verification, RaysMiss(missed, most))
            return self._contradicted(rig, capture, verification, time.perf_counter() - start)
        cloud = self._finished(cloud)
        mesh = None if self.mesh is None else make_mesh(cloud)
        model = None if self.cad is None else make_cad(cloud, self.cad_limits)
        depth = None if self.depth is None else depth_map(cloud, self._drawn_in(rig))
        seconds = time.perf_counter() - start
        self._write(cloud, mesh, model)
        report = answer_report(verification) | _cloud_report(cloud) | {"out": str(self.out)}
        text = _cloud_text(self.out, report)
        if verification.verdict == "drifted" or verification.forbids_measuring:
            text += f"\n  against the capture: {verification.reason}"
        if mesh is not None:
            report |= {"mesh": str(self.mesh), "faces": len(mesh.faces)}
            text += f"\n{self.mesh}: {len(mesh.faces)} faces"
        if self.depth is not None and depth is not None:
            from retrue.files.exchange.depth_maps import write_depth_map

            beside = write_depth_map(self.depth, depth, self._drawn_in(rig), rig.unit)
            measured = int((depth > 0).sum())
            report |= {"depth": str(self.depth), "depth_camera": str(beside), "depth_pixels": measured}
            text += f"\n{self.depth}: {measured} pixels with a depth; their camera is in {beside}"
        if model is not None:
            report |= {"cad": str(self.cad), "patches": _patches_report(model), "points_on_no_patch": model.left_out}
            text += f"\n{self.cad}: {_patches_text(model)}"
        page = None if self.report is None else (self.report, self._page(rig, capture, cloud, mesh))
        return self.told(with_advice(Outcome(report | {"seconds": seconds}, text, DONE, page), [capture]))

    def _one_capture(self, rig: Rig) -> tuple[Capture, Callable[[], Correspondences] | None]:
        """The capture that the rig is verified with; and, of photographs, how every pixel of them is matched."""
        if not self.takes_photographs(self.captures):
            if len(self.captures) != 1:
                raise InputError(f"expected one CAPTURE after the rig, found {len(self.captures)}")
            return self.read(rig, self.captures, self.pattern, one_coordinate=True)[0], None
        if self.pattern is not None:
            raise InputError("expected --stereo or --pattern: photographs of a scene show no pattern")
        from retrue.decoding.photographs.dense import match_densely

        pairs = read_pairs(rig, self.captures, self.matcher)
        if len(pairs) != 1:
            raise InputError(f"expected one pair of photographs after the rig, found {len(pairs)}")
        pair = pairs[0]
        return pair.capture, lambda: match_densely(rig, pair.left, pair.right, pair.capture.points)

    def _contradicted(self, rig: Rig, capture: Capture, verification: Verification, seconds: float) -> Outcome:
        """No cloud: it would be one of a rig that is no more."""
        from retrue.cli.json_output import verification_report

        report = verification_report(verification, seconds) | {"out": None}
        anyway = " (--anyway does)" if len(capture.points) else ""
        text = f"refused: nothing was written{anyway}: {verification.reason}"
        page = None
        if self.report is not None:
            from retrue.report.verification_page import verification_page

            page = (self.report, verification_page(rig, [capture], verification))
        return self.told(with_advice(Outcome(report, text, REFUSED_OR_DRIFTED, page), [capture]))

    def _page(self, rig: Rig, capture: Capture, cloud: Cloud, mesh: Mesh | None) -> Page:
        from retrue.report.reconstruction_page import reconstruction_page

        return reconstruction_page(rig, capture, cloud, faces=None if mesh is None else len(mesh.faces))

    def _drawn_in(self, rig: Rig) -> Camera:
        """The camera of the depth map."""
        return replace(rig.camera, distortion=()) if self.undistorted else rig.camera

    def _require_formats(self, unit: str) -> None:
        """Find out before the work what no file of these names can hold."""
        from retrue.files.exchange.depth_maps import require_depth_ending
        from retrue.files.models import require_cloud_ending, require_mesh_ending
        from retrue.files.step import require_step

        require_cloud_ending(self.out, unit)
        if self.mesh is not None:
            require_mesh_ending(self.mesh, unit)
        if self.depth is not None:
            require_depth_ending(self.depth, unit)
        if self.cad is not None:
            require_step(self.cad, unit)

    def _finished(self, cloud: Cloud) -> Cloud:
        """The cloud with all that is asked for."""
        from retrue.reconstruction.holes import fill_holes
        from retrue.reconstruction.normals import with_normals

        if self.fill_holes:
            cloud = fill_holes(cloud)
        return with_normals(cloud) if self.normals else cloud

    def _write(self, cloud: Cloud, mesh: Mesh | None, model: CadModel | None) -> None:
        from retrue.files.models import write_cloud, write_mesh
        from retrue.files.step import write_step

        write_cloud(self.out, cloud)
        if self.mesh is not None and mesh is not None:
            write_mesh(self.mesh, mesh)
        if self.cad is not None and model is not None:
            write_step(self.cad, model)


def _cloud_report(cloud: Cloud) -> dict[str, Any]:
    from retrue.plain_json import plain
    from retrue.reconstruction.resolution import resolution
    from retrue.reconstruction.surface_grid import surface_grid

    report: dict[str, Any] = {**cloud.card, "unit": cloud.unit}
    if cloud.cells is not None:
        found = resolution(cloud.points, surface_grid(cloud.points, cloud.cells))
        report |= {"point_spacing": found.spacing, "noise": found.noise}
    return plain(report)


def _cloud_text(out: Path, report: dict[str, Any]) -> str:
    """What there is to say of a cloud, one thing a line."""
    points, correspondences = report["points"], report["correspondences"]
    rms = report["epipolar_rms_px"]
    checked = "one coordinate, so nothing checks the rays" if rms is None else f"RMS {rms:.3f} px"
    lines = [f"{out}: {points} points from {correspondences} correspondences, {checked}"]
    if report.get("dropped_alone") or report.get("dropped_in_islands") or report.get("dropped_at_edges"):
        lines.append(
            f"  strays left out: {report['dropped_alone']} alone, "
            f"{report['dropped_in_islands']} on pieces without an inside, {report['dropped_at_edges']} cut by edges"
        )
    if "smoothed" in report:
        side = report["smoothed_cells"]
        lines.append(f"  smoothed: {report['smoothed']} points, over {side} x {side} cells (median)")
    if "holes_filled" in report:
        lines.append(
            f"  {report['points_filled_in']} points invented in {report['holes_filled']} holes, "
            f"{report['holes_left_open']} holes left open"
        )
    if report.get("point_spacing") is not None:
        noise = "unknown" if report["noise"] is None else f"{report['noise']:.3g} {report['unit']}"
        lines.append(f"  spacing of points {report['point_spacing']:.3g} {report['unit']}, noise of depth {noise}")
    if report.get("sigma") is not None:
        exact = ", ".join(report["taken_for_exact"])
        common = f"{report['common_sigma']:.3g} {report['unit']} that all have in common"
        if exact:
            common = f"{common}; taken for exact: {exact}" if report["common_sigma"] else f"taken for exact: {exact}"
        lines.append(f"  a point's own sigma {report['sigma']:.3g} {report['unit']} (median); {common}")
    return "\n".join(lines)


def _patches_report(model: CadModel) -> list[dict[str, Any]]:
    from retrue.cad.surfaces import SphereSurface
    from retrue.plain_json import plain

    return [
        {
            "type": patch.surface.kind,
            "points": len(patch.rows),
            "max_error": patch.max_error,
            "rms_error": patch.rms_error,
            "tolerance": patch.tolerance,
            "met": patch.met,
            **(
                {"centre": plain(patch.surface.centre), "radius": patch.surface.radius}
                if isinstance(patch.surface, SphereSurface)
                else {}
            ),
        }
        for patch in model.patches
    ]


def _patches_text(model: CadModel) -> str:
    """A table of the patches, in 80 columns."""
    lines = [
        f"{len(model.patches)} surfaces, {model.left_out} points on none; distances in {model.unit}",
        f"  {'type':<10}{'points':>10}{'max':>12}{'rms':>12}{'tolerance':>12}",
    ]
    for patch in model.patches[:MOST_PATCHES_SHOWN]:
        missed = "" if patch.met else "  not met"
        lines.append(
            f"  {patch.surface.kind:<10}{len(patch.rows):>10}{patch.max_error:>12.3g}{patch.rms_error:>12.3g}"
            f"{patch.tolerance:>12.3g}{missed}"
        )
    if len(model.patches) > MOST_PATCHES_SHOWN:
        lines.append(f"  and {len(model.patches) - MOST_PATCHES_SHOWN} smaller ones")
    return "\n".join(lines)
