"""`retrue demo`."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from importlib.resources import as_file, files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from retrue.cli.command import DONE, REFUSED_OR_DRIFTED, Outcome, ReportingCommand, log, made_folder, require_writable

if TYPE_CHECKING:
    from retrue.correspondences import Correspondences
    from retrue.geometry.arrays import Image
    from retrue.geometry.transform import RigidTransform
    from retrue.recalibration.result import Accepted, Refused
    from retrue.report.page import Page
    from retrue.rig import Rig


@dataclass(frozen=True, kw_only=True)
class Demo(ReportingCommand):
    """Do everything once, on a picture that ships with the package.

    Attributes
    ----------
    out
        Folder for the new rig, the cloud, the mesh and report.html, and pictures where the extra .[plot] is
        installed; made where it is not there.
    stereo
        Instead: two photographs of a simulated scene, by two cameras.
    """

    out: Path = Path("demo-out")
    stereo: bool = False

    def run(self) -> Outcome:
        from retrue.decoding.decode import decode
        from retrue.files.images import read_image
        from retrue.files.patterns import read_pattern
        from retrue.files.rigs import read_rig
        from retrue.recalibration.recalibrate import recalibrate
        from retrue.recalibration.result import Accepted

        folder = made_folder(self.out)
        require_writable(self.report)
        if self.stereo:
            from retrue.cli.demo_photographs import demo_photographs

            return demo_photographs(folder)
        with as_file(files("retrue") / "demo_data") as data:
            image, pattern = read_image(data / "scene.jpg"), read_pattern(data / "pattern.json")
            before, true = read_rig(data / "rig_before.json"), read_rig(data / "rig_true.json")
        log("A wall with objects before it, lit by one colour grid; the rig file is from before a bump.")
        start = time.perf_counter()
        points = decode(pattern, image)
        decoded = time.perf_counter()
        result = recalibrate(before, [points])
        recalibrated = time.perf_counter()
        report: dict[str, Any] = {
            "correspondences": len(points),
            "verdict": "accepted" if isinstance(result, Accepted) else "refused",
            "reason": result.reason,
            "decode_seconds": decoded - start,
            "recalibrate_seconds": recalibrated - decoded,
        }
        page = (self.report or folder / "report.html", _page(before, true, image, points, result))
        if not isinstance(result, Accepted):
            return Outcome(report, f"refused: {result.reason}", REFUSED_OR_DRIFTED, page)
        report |= {
            "error_before": _distance(before.projector_from_camera, true.projector_from_camera),
            "error_after": _distance(result.rig.projector_from_camera, true.projector_from_camera),
            **_reconstruct(folder, image, points, before, result.rig),
        }
        return Outcome(report, _story(folder, report), DONE, page)


def _page(before: Rig, true: Rig, image: Image, points: Correspondences, result: Accepted | Refused) -> Page:
    """The page of the recalibration, and how far from the truth it is."""
    from retrue.capture import Capture
    from retrue.recalibration.result import Accepted
    from retrue.report.lengths import degrees
    from retrue.report.page import Section, Table
    from retrue.report.recalibration_page import recalibration_page

    page = recalibration_page(before, [Capture("scene.jpg", points, image)], result)
    rigs = {"before": before, "after": result.rig} if isinstance(result, Accepted) else {"before": before}
    errors = {name: _distance(rig.projector_from_camera, true.projector_from_camera) for name, rig in rigs.items()}
    table = Table(
        ("", "rotation", "direction of t"),
        tuple(
            (name, degrees(error["rotation_deg"]), degrees(error["translation_deg"])) for name, error in errors.items()
        ),
    )
    truth = Section("Distance from the truth", "The picture is a rendering, so the true pose is known.", (table,))
    return replace(page, job="demo", sections=(*page.sections, truth))


def _reconstruct(folder: Path, image: Image, points: Correspondences, before: Rig, after: Rig) -> dict[str, Any]:
    """Write all that the new rig gives; returns what there is to say of it."""
    import numpy as np

    from retrue.files.atomic import replaced_file
    from retrue.files.ply import write_cloud, write_mesh
    from retrue.files.rigs import write_rig
    from retrue.reconstruction.mesh import make_mesh
    from retrue.reconstruction.reconstruct import epipolar_residuals, reconstruct
    from retrue.report.pictures import cloud_picture, has_matplotlib, residual_picture

    cloud = reconstruct(after, points)
    mesh = make_mesh(cloud)
    residuals = {"before": epipolar_residuals(before, points), "after": epipolar_residuals(after, points)}
    write_rig(folder / "rig.json", after)
    write_cloud(folder / "cloud.ply", cloud)
    write_mesh(folder / "mesh.ply", mesh)
    pictures: dict[str, bytes] = {}
    if has_matplotlib():
        titled = [(f"{when} recalibration", residual) for when, residual in residuals.items()]
        pictures = {
            "residuals.png": residual_picture(image, points, titled),
            "cloud.png": cloud_picture(cloud, after),
        }
    for name, picture in pictures.items():
        with replaced_file(folder / name) as stream:
            stream.write(picture)
    return {
        "points": len(cloud),
        "faces": len(mesh.faces),
        "epipolar_median_px": {when: float(np.nanmedian(np.abs(residual))) for when, residual in residuals.items()},
        "files": [str(folder / name) for name in ("rig.json", "cloud.ply", "mesh.ply", *pictures)],
    }


def _distance(pose: RigidTransform, true: RigidTransform) -> dict[str, float]:
    from math import degrees

    from retrue.geometry.transform import direction_angle, rotation_angle

    return {
        "rotation_deg": degrees(rotation_angle(pose.R @ true.R.T)),
        "translation_deg": degrees(direction_angle(pose.t, true.t)),
    }


def _story(folder: Path, report: dict[str, Any]) -> str:
    before, after = report["error_before"], report["error_after"]
    median = report["epipolar_median_px"]
    beside = "cloud.ply, mesh.ply and pictures lie beside it."
    if not any(name.endswith(".png") for name in report["files"]):
        beside = "cloud.ply and mesh.ply lie beside it.\nFor pictures too: pip install '.[plot]'"
    return f"""\
Decoded {report["correspondences"]} correspondences from one picture in {report["decode_seconds"]:.2f} s.
Recalibrated in {report["recalibrate_seconds"]:.2f} s: {report["reason"]}
Rays missed each other by {median["before"]:.2f} px before, {median["after"]:.3f} px after (median).
Distance from the true pose, rotation and direction of t:
  {before["rotation_deg"]:.2f} deg and {before["translation_deg"]:.2f} deg before,
  {after["rotation_deg"]:.3f} deg and {after["translation_deg"]:.3f} deg after.
Reconstructed {report["points"]} points and {report["faces"]} faces.
Open {folder}/report.html in a browser to see it all; {beside}
Next, a rig to calibrate, bump and mend in your browser, with no hardware: make studio
(or pip install ".[studio]", then retrue studio --simulated)"""
