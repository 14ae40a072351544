"""`retrue merge`."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import OmitArgPrefixes, Positional, arg

from retrue.cli.command import DONE, REFUSED_OR_DRIFTED, Command, Outcome, require_writable
from retrue.cli.terminal import terminal
from retrue.errors import FileError, InputError
from retrue.merging.options import MergeOptions

if TYPE_CHECKING:
    from retrue.merging.merge import Merged
    from retrue.reconstruction.cloud import Cloud

MOST_PAIRS_SHOWN = 12


@dataclass(frozen=True, kw_only=True)
class Merge(Command):
    """Merge several clouds of one object into one, with all loops closed and one surface; needs `.[merge]`.

    The views may be taken by hand, on a turntable or with the rig moved, and come in any order. One that shows
    nothing in common with the others is left out and named. Exit status 1 where no two views belong together;
    nothing is written then.

    Attributes
    ----------
    clouds
        PLY files, as `retrue reconstruct` writes them: each in the frame of the camera that saw it.
    out
        The object's cloud, in the frame of the first view; the endings of `retrue reconstruct --out`.
    mesh
        Its surface: PLY or OBJ in the clouds' unit, STL in millimetres, GLB in metres, as the name ends.
    unit
        Of clouds whose files name none.
    limits
        Limits of the method.
    """

    clouds: Positional[Annotated[tuple[Path, ...], arg(metavar="CLOUD...")]]
    out: Path
    mesh: Path | None = None
    unit: str = "mm"
    limits: OmitArgPrefixes[MergeOptions] = field(default_factory=MergeOptions)

    def run(self) -> Outcome:
        from retrue.files.models import require_cloud_ending, require_mesh_ending, write_cloud, write_mesh
        from retrue.merging.merge import RefusedMerge, merge
        from retrue.merging.pairs import require_libraries
        from retrue.merging.surface import require_meshing

        require_libraries()
        require_writable(self.out, self.mesh, made_of=self.clouds)
        if len(self.clouds) < 2:
            raise InputError(f"merge: expected two CLOUDs or more, found {len(self.clouds)}")
        clouds = [self._read(path) for path in self.clouds]
        unit = clouds[0].unit
        require_cloud_ending(self.out, unit)
        if self.mesh is not None:
            require_mesh_ending(self.mesh, unit)
            require_meshing()
        start = time.perf_counter()
        show = terminal.progress("merging views")
        merged = merge(clouds, self.limits, names=[path.name for path in self.clouds], progress=show)
        if isinstance(merged, RefusedMerge):
            from retrue.answers import answer_report

            report = answer_report(merged) | {"out": None, "seconds": time.perf_counter() - start}
            return Outcome(report, f"refused: nothing was written: {merged.reason}", REFUSED_OR_DRIFTED)
        mesh = None if self.mesh is None else merged.mesh()
        seconds = time.perf_counter() - start
        write_cloud(self.out, merged.cloud)
        report = _report(merged) | {"out": str(self.out), "seconds": seconds}
        text = f"{self.out}: {len(merged.cloud)} points of {merged.reason}\n{_text(merged)}"
        if mesh is not None and self.mesh is not None:
            write_mesh(self.mesh, mesh)
            report |= {"mesh": str(self.mesh), "faces": len(mesh.faces)}
            text += f"\n{self.mesh}: {len(mesh.faces)} faces"
        return Outcome(report, text, DONE)

    def _read(self, path: Path) -> Cloud:
        from retrue.files.models import read_model
        from retrue.reconstruction.cloud import Mesh

        model = read_model(path, self.unit)
        if isinstance(model, Mesh):
            raise FileError(path, "expected a cloud, found a mesh: hand in what `retrue reconstruct --out` wrote")
        if not (model.points[:, 2] > 0).all():
            raise FileError(path, "expected points before the camera that saw them (z > 0): in another frame by now?")
        return model


def _report(merged: Merged) -> dict[str, Any]:
    from retrue.answers import answer_report
    from retrue.plain_json import plain

    views = [
        {
            "name": name,
            "object_from_view": None
            if number not in merged.poses
            else {"R": plain(merged.poses[number].R), "t": plain(merged.poses[number].t)},
            "sigma": None if number not in merged.poses else _sigma(merged, number),
            "left_out": None if number not in merged.left_out else str(merged.left_out[number]),
        }
        for number, name in enumerate(merged.names)
    ]
    pairs = [
        {"views": [merged.names[first], merged.names[second]], "rms": rms}
        for (first, second), rms in merged.residuals.items()
    ]
    return answer_report(merged) | {
        "points": len(merged.cloud),
        "unit": merged.cloud.unit,
        "closure_sigma": merged.closure_sigma,
        "standing_share": merged.standing,
        "views": views,
        "pairs": pairs,
    }


def _sigma(merged: Merged, number: int) -> dict[str, float]:
    import math

    turn, shift = merged.pose_sigma[number]
    return {"rotation_deg": math.degrees(turn), "translation": shift}


def _text(merged: Merged) -> str:
    """How far apart the views' surfaces are, the worst pairs first, in 80 columns."""
    from retrue.shown import figures

    unit = merged.cloud.unit
    worst = sorted(merged.residuals.items(), key=lambda pair: -pair[1])
    lines = [
        f"  loops close within {figures(merged.closure_sigma, 2)} sigma; surfaces of neighbours apart by (RMS, {unit})"
    ]
    for (first, second), rms in worst[:MOST_PAIRS_SHOWN]:
        names = f"{merged.names[first][-28:]}, {merged.names[second][-28:]}"
        lines.append(f"  {names:<62}{figures(rms):>9}")
    if len(worst) > MOST_PAIRS_SHOWN:
        lines.append(f"  and {len(worst) - MOST_PAIRS_SHOWN} nearer ones")
    return "\n".join(lines)
