"""`retrue experiment`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import Positional, arg

from retrue.cli.command import Command, Outcome, made_folder, read_captures, shown_pattern
from retrue.cli.terminal import terminal
from retrue.errors import InputError

if TYPE_CHECKING:
    from retrue.experiments.study import Study

Name = Literal["ambiguity", "noise", "peers", "twin", "light", "real", "photographs"]


@dataclass(frozen=True, kw_only=True)
class Experiment(Command):
    """Rerun an experiment: a table to stdout, its CSV and figure (SVG, PNG) to a folder; needs the extra .[plot].

    Attributes
    ----------
    name
        ambiguity: how many poses explain a plane. noise: errors against noise, for the paper's solver and others.
        peers: RMSE over the Cramer-Rao bound, us and others. twin: how the twin poses are told apart. light: how the
        projector's own light tells them apart on a bare wall, drawn at random or, with captures, on each of their
        planes. real: captures against a static calibration. photographs: pairs of two cameras against theirs.
    captures
        For `real` and `light`: captures of the rig; for `photographs`: pairs, as --stereo of other commands takes.
    rig
        For these: its static calibration.
    pattern
        For these: what the projector showed.
    ours_only
        For `peers`: leave the other libraries out, which is four times as quick.
    trials
        Random trials of each cell of the table; as many as the published figures took by default.
    seed
        The same seed gives the same figures, on any number of cores.
    workers
        Processes; all cores by default.
    out
        Folder for the files.
    """

    name: Positional[Name]
    captures: Positional[Annotated[tuple[Path, ...], arg(metavar="CAPTURE...")]] = ()
    rig: Annotated[Path | None, arg(metavar="RIG.json")] = None
    pattern: Annotated[Path | None, arg(metavar="P.json")] = None
    ours_only: bool = False
    trials: int | None = None
    seed: int = 0
    workers: int | None = None
    out: Annotated[Path, arg(metavar="DIR")] = Path("experiment-out")

    def run(self) -> Outcome:
        from retrue.files.atomic import replaced_file
        from retrue.report.charts import line_charts
        from retrue.report.pictures import require_matplotlib

        require_matplotlib("experiment")
        for name, value in (("trials", self.trials), ("workers", self.workers)):
            if value is not None and not value >= 1:
                raise InputError(f"--{name}: expected at least 1, found {value}")
        if self.ours_only and self.name != "peers":
            raise InputError(f"--ours-only: expected experiment peers, found {self.name}")
        folder = made_folder(self.out)
        study = self._study()
        files = {"csv": study.table.csv().encode(), **line_charts(study.panels)}
        paths = {kind: folder / f"{study.name}.{kind}" for kind in files}
        for kind, content in files.items():
            with replaced_file(paths[kind]) as stream:
                stream.write(content)
        text = "\n".join([study.table.text(width=80), *study.remarks, f"written to {folder}"])
        report = {"experiment": study.name, "files": [str(path) for path in paths.values()], "remarks": study.remarks}
        return Outcome(report, text)

    def _study(self) -> Study:
        count: dict[str, Any] = {} if self.trials is None else {"trials": self.trials}
        if self.name == "photographs":
            return self._photographs()
        if self.name == "real" or self.captures:
            return self._real(count)
        from retrue.experiments.against_peers import peers
        from retrue.experiments.ambiguity import ambiguity
        from retrue.experiments.light import light
        from retrue.experiments.noise import noise
        from retrue.experiments.twin import twin

        if self.ours_only:
            count["ours_only"] = True
        run = {"ambiguity": ambiguity, "noise": noise, "peers": peers, "twin": twin, "light": light}[self.name]
        return run(seed=self.seed, workers=self.workers, progress=terminal.progress(self.name), **count)

    def _photographs(self) -> Study:
        from retrue.cli.photographs import read_pairs
        from retrue.experiments.photographs import photographs
        from retrue.files.rigs import read_rig

        if self.rig is None:
            raise InputError("experiment photographs: expected --rig, the calibration to compare with")
        rig = read_rig(self.rig)
        return photographs(rig, read_pairs(rig, self.captures))

    def _real(self, count: dict[str, Any]) -> Study:
        from retrue.experiments.light import light_of_captures
        from retrue.experiments.real import real
        from retrue.files.rigs import read_rig

        if self.name not in ("real", "light"):
            raise InputError(f"experiment {self.name}: expected no captures, found {len(self.captures)}")
        if self.rig is None:
            raise InputError(f"experiment {self.name}: expected --rig, the static calibration to compare with")
        captures = read_captures(self.captures, shown_pattern(self.pattern))
        points = {capture.name: capture.points for capture in captures}
        if self.name == "light":
            return light_of_captures(read_rig(self.rig), points, seed=self.seed)
        return real(read_rig(self.rig), points, seed=self.seed, **count)
