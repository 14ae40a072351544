"""`retrue demo --stereo`: two photographs of a simulated scene, from a rig that was bumped to a cloud."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from retrue.cli.command import DONE, REFUSED_OR_DRIFTED, Outcome, log
from retrue.cli.photographs import axes_report, axes_text

if TYPE_CHECKING:
    from retrue.geometry.transform import RigidTransform
    from retrue.rig import Rig
    from retrue.simulation.photographs import Photographed

DISTANCE = 1500.0  # mm
BUMP_DEG = (0.8, 1.6, -0.6)
SEED = 1


def demo_photographs(folder: Path) -> Outcome:
    """Take both photographs, match them, recalibrate, and reconstruct every pixel; files go to the folder."""
    import numpy as np

    from retrue.decoding.decode import decode
    from retrue.decoding.photographs.dense import match_densely
    from retrue.files.images import write_png
    from retrue.files.ply import write_cloud, write_mesh
    from retrue.files.rigs import write_rig
    from retrue.geometry.transform import RigidTransform
    from retrue.patterns.photographs import PHOTOGRAPHS
    from retrue.recalibration.axes import axes_of
    from retrue.recalibration.recalibrate import recalibrate
    from retrue.recalibration.result import Accepted
    from retrue.reconstruction.mesh import make_mesh
    from retrue.reconstruction.reconstruct import reconstruct

    log("Two cameras before a wall with boxes and balls, all of them flecked; the rig file is from before a bump.")
    true, pair = _taken()
    bump = RigidTransform.from_rotation_vector(np.radians(BUMP_DEG), np.zeros(3))
    before = replace(true, projector_from_camera=bump @ true.projector_from_camera)
    write_png(folder / "left.png", pair.left)
    write_png(folder / "right.png", pair.right)
    write_rig(folder / "rig_before.json", before)
    start = time.perf_counter()
    points = decode(PHOTOGRAPHS, [pair.left, pair.right])
    matched = time.perf_counter()
    result = recalibrate(before, [points])
    recalibrated = time.perf_counter()
    axes = axes_of(before.projector_from_camera, result.evidence)
    report: dict[str, Any] = {
        "correspondences": len(points),
        "verdict": result.verdict,
        "reason": result.reason,
        "axes": axes_report(axes),
        "match_seconds": matched - start,
        "recalibrate_seconds": recalibrated - matched,
    }
    if not isinstance(result, Accepted):
        return Outcome(report, f"refused: {result.reason}", REFUSED_OR_DRIFTED)
    cloud = reconstruct(result.rig, match_densely(result.rig, pair.left, pair.right, points))
    mesh = make_mesh(cloud)
    write_rig(folder / "rig.json", result.rig)
    write_cloud(folder / "cloud.ply", cloud)
    write_mesh(folder / "mesh.ply", mesh)
    row, column = cloud.camera_px.astype(np.int64).T[::-1]
    names = ("left.png", "right.png", "rig_before.json", "rig.json", "cloud.ply", "mesh.ply")
    report |= {
        "error_before": _distance(before.projector_from_camera, true.projector_from_camera),
        "error_after": _distance(result.rig.projector_from_camera, true.projector_from_camera),
        "points": len(cloud),
        "faces": len(mesh.faces),
        "depth_error": float(np.nanmedian(np.abs(cloud.points[:, 2] / pair.depth[row, column] - 1))),
        "files": [str(folder / name) for name in names],
    }
    return Outcome(report, _story(folder, report, axes_text(axes)), DONE)


def _taken() -> tuple[Rig, Photographed]:
    """The rig as it is, and what it sees."""
    import numpy as np

    from retrue.geometry.camera import Camera
    from retrue.geometry.transform import RigidTransform
    from retrue.rig import Rig
    from retrue.simulation.photographs import photograph, textured_scene

    lens = np.array([-0.1, 0.03, 0, 0, 0])
    left = Camera((480, 360), np.array([[420, 0, 239.5], [0, 420, 179.5], [0, 0, 1]]), lens)
    right = Camera((480, 360), np.array([[440, 0, 236], [0, 440, 181], [0, 0, 1]]), lens)
    rig = Rig(left, right, RigidTransform.from_rotation_vector([0.01, -0.05, 0.02], [-150.0, 3, 5]), unit="mm")
    return rig, photograph(rig, textured_scene(rig, DISTANCE, SEED), seed=SEED, supersample=1)


def _distance(pose: RigidTransform, true: RigidTransform) -> dict[str, float]:
    from math import degrees

    from retrue.geometry.transform import direction_angle, rotation_angle

    return {
        "rotation_deg": degrees(rotation_angle(pose.R @ true.R.T)),
        "translation_deg": degrees(direction_angle(pose.t, true.t)),
    }


def _story(folder: Path, report: dict[str, Any], axes: str) -> str:
    before, after = report["error_before"], report["error_after"]
    return f"""\
Matched {report["correspondences"]} places of two photographs in {report["match_seconds"]:.2f} s.
Recalibrated in {report["recalibrate_seconds"]:.2f} s: {report["reason"]}
Distance from the true pose, rotation and direction of t:
  {before["rotation_deg"]:.2f} deg and {before["translation_deg"]:.2f} deg before,
  {after["rotation_deg"]:.3f} deg and {after["translation_deg"]:.3f} deg after.
{axes[0].upper()}{axes[1:]}
Reconstructed {report["points"]} points and {report["faces"]} faces; half of the depths are within \
{100 * report["depth_error"]:.2f} % of the truth.
{folder}/cloud.ply, mesh.ply, rig.json and both photographs lie there."""
