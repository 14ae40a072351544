"""`retrue simulate`."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import OmitArgPrefixes, Positional, arg

from retrue.cli.command import Command, Outcome, made_folder
from retrue.cli.terminal import terminal
from retrue.errors import FileError
from retrue.simulation.options import SimulateOptions

if TYPE_CHECKING:
    from retrue.rig import Rig
    from retrue.simulation.simulate import Simulated

MESHES = (".ply", ".obj")


@dataclass(frozen=True, kw_only=True)
class Simulate(Command):
    """Render what a rig would see, with the truth beside it; needs the extra .[simulate].

    Attributes
    ----------
    scene
        wall, corner, step, sphere, clutter, texture, glossy; or a mesh, .ply or .obj, in the camera's frame and the
        rig's unit.
    rig
        The rig, JSON or another tool's.
    pattern
        What the projector shows: a grid gives one picture, and white and black; a Gray code the whole sequence.
    out
        Folder for the pictures, truth.npz, points.csv (true correspondences), rig.json and pattern.json.
    options
        Light, camera and noise.
    """

    scene: Positional[Annotated[str, arg(metavar="SCENE")]]
    rig: Annotated[Path, arg(metavar="RIG.json")]
    pattern: Annotated[Path, arg(metavar="P.json")]
    out: Annotated[Path, arg(metavar="DIR")]
    options: OmitArgPrefixes[SimulateOptions] = field(default_factory=SimulateOptions)

    def run(self) -> Outcome:
        from retrue.correspondences import Correspondences
        from retrue.files.capture_folder import require_no_other_pictures
        from retrue.files.patterns import read_pattern, write_pattern
        from retrue.files.points import write_points
        from retrue.files.rigs import read_rig, write_rig
        from retrue.patterns.color_grid import ColorGrid
        from retrue.patterns.line_grid import LineGrid
        from retrue.simulation.mitsuba_scene import MeshFile, load_mitsuba
        from retrue.simulation.simulate import simulate

        load_mitsuba()
        rig, pattern = read_rig(self.rig), read_pattern(self.pattern)
        scene = MeshFile(_mesh(Path(self.scene))) if Path(self.scene).suffix.lower() in MESHES else self.scene
        folder = made_folder(self.out)
        start = time.perf_counter()
        simulated = simulate(rig, scene, pattern, self.options, terminal.progress("rendering"))
        seconds = time.perf_counter() - start
        single = isinstance(pattern, ColorGrid | LineGrid)
        if not single:
            require_no_other_pictures(folder / "capture", {f"{name}.png" for name in simulated.pictures})
        capture = folder / "capture.png" if single else made_folder(folder / "capture")
        _write(simulated, rig, capture if capture.is_dir() else folder, folder / "truth.npz")
        truth = Correspondences(
            simulated.truth.camera_px,
            simulated.truth.projector_px,
            camera_size=rig.camera.size,
            projector_size=rig.projector.size,
        )
        write_points(folder / "points.csv", truth)
        write_rig(folder / "rig.json", rig)
        write_pattern(folder / "pattern.json", pattern)
        report: dict[str, Any] = {
            "capture": str(capture),
            "pictures": len(simulated.pictures),
            "correspondences": len(simulated.truth.camera_px),
            "dot_errors_px": dict(simulated.dot_errors_px),
            "seconds": seconds,
        }
        dots = ", ".join(f"{error:.3f} px in the {device}" for device, error in simulated.dot_errors_px.items())
        text = (
            f"{capture}: {len(simulated.pictures)} pictures in {seconds:.1f} s\n"
            f"{folder}: truth.npz, points.csv ({len(simulated.truth.camera_px)} true matches), rig.json, pattern.json\n"
            f"self-check: rendered dots are off by at most {dots}"
        )
        return Outcome(report, text)


def _mesh(path: Path) -> Path:
    if not path.is_file():
        raise FileError(path, "no such file")
    return path


def _write(simulated: Simulated, rig: Rig, folder: Path, truth_file: Path) -> None:
    import numpy as np

    from retrue.files.atomic import replaced_file
    from retrue.files.images import write_png

    for name, picture in simulated.pictures.items():
        write_png(folder / f"{name}.png", picture)
    truth = simulated.truth
    with replaced_file(truth_file) as stream:
        np.savez_compressed(
            stream,
            K_c=rig.camera.K,
            dist_c=rig.camera.distortion,
            K_p=rig.projector.K,
            dist_p=rig.projector.distortion,
            R=rig.projector_from_camera.R,
            t=rig.projector_from_camera.t,
            cam_size=np.array(rig.camera.size),
            prj_size=np.array(rig.projector.size),
            depth=np.nan_to_num(truth.depth).astype(np.float32),
            obj_id=(truth.item + 1).astype(np.uint8),
            prj_visible=truth.lit,
            block_camera_px=truth.camera_px,
            block_projector_px=truth.projector_px,
        )
