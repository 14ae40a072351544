"""`retrue history`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import arg

from retrue.cli.command import Command, Outcome, RigPath, log, require_writable
from retrue.errors import InputError

if TYPE_CHECKING:
    from retrue.files.history_entry import HistoryEntry
    from retrue.rig_difference import RigDifference
    from retrue.watch.record import WatchRecord

MOST_TOLD = 10  # damaged lines


@dataclass(frozen=True, kw_only=True)
class History(Command):
    """Show every rig that stood in a rig file, and how it drifted; damaged lines are told, and passed over.

    Attributes
    ----------
    rig
        The rig file.
    last
        Only so many, the newest; that takes as long however many there are.
    watched
        The folder of a watch of this rig: where the rig was at each frame, from all frames, and how warm it was.
    plot
        A PNG to draw the drift over time into; needs `pip install '.[plot]'`.
    """

    rig: RigPath
    last: Annotated[int, arg(metavar="N")] = 1000
    watched: Annotated[Path | None, arg(metavar="DIR")] = None
    plot: Path | None = None

    def run(self) -> Outcome:
        from retrue.files.atomic import replaced_file
        from retrue.files.history import entry_in_place, history_path, read_history
        from retrue.files.rigs import read_rig
        from retrue.plain_json import plain
        from retrue.rig_difference import rig_difference

        require_writable(self.plot)
        if self.plot is not None:
            from retrue.report.pictures import require_matplotlib

            require_matplotlib("--plot")
        rig = read_rig(self.rig)
        if not self.last >= 1:
            raise InputError(f"--last: expected 1 or more, found {self.last}")
        history = read_history(self.rig, self.last)
        entries = history.entries
        for line in history.damaged[-MOST_TOLD:]:
            log(f"{line}; passed over")
        if len(history.damaged) > MOST_TOLD:
            log(f"and {len(history.damaged) - MOST_TOLD} lines before; --json has them all")
        record = None
        if self.watched is not None:
            from retrue.watch.record import read_record

            record = read_record(self.watched, (entries[0].rig if entries else rig).projector_from_camera)
        if not entries and record is None:
            raise InputError(f"{self.rig}: no history beside it; it begins with `retrue recalibrate --in-place`")
        in_place = entry_in_place(entries, rig)
        steps = [None, *(rig_difference(a.rig, b.rig) for a, b in pairwise(entries))]
        report: dict[str, Any] = {
            "history": str(history_path(self.rig)),
            "in_place": None if in_place is None else in_place.id,
            "damaged": [plain(asdict(line)) for line in history.damaged],
            "entries": [_entry_report(entry, step) for entry, step in zip(entries, steps, strict=True)],
        }
        text = _table(entries, steps, in_place) if entries else f"{self.rig}: no history beside it; it stands as it was"
        if record is not None:
            report["watched"] = record.report()
            text += f"\n{_record_text(record)}"
        if self.plot is not None:
            if record is not None:
                from retrue.report.track_picture import track_picture

                picture = track_picture(record)
            else:
                from retrue.report.pictures import drift_picture

                since_first = [rig_difference(entries[0].rig, entry.rig) for entry in entries]
                picture = drift_picture([entry.time for entry in entries], since_first)
            with replaced_file(self.plot) as stream:
                stream.write(picture)
            report["plot"] = str(self.plot)
            text += f"\n{self.plot}: written"
        return Outcome(report, text)


def _entry_report(entry: HistoryEntry, step: RigDifference | None) -> dict[str, Any]:
    from retrue.cli.json_output import pose_report
    from retrue.plain_json import plain

    return {
        "id": entry.id,
        "time": entry.time.isoformat(timespec="milliseconds"),
        "action": entry.action,
        "restored": entry.restored,
        "projector_from_camera": pose_report(entry.rig.projector_from_camera),
        "change": None if step is None else plain(asdict(step)),
        "captures": plain(entry.captures),
        "evidence": plain(entry.evidence),
        "rig_evidence": plain(entry.rig.evidence),
    }


def _table(
    entries: Sequence[HistoryEntry], steps: Sequence[RigDifference | None], in_place: HistoryEntry | None
) -> str:
    """One line an entry, in 80 columns."""
    from numpy.linalg import norm

    unit = entries[0].rig.unit[:6]
    lines = [f"  ID  time (UTC)           what               rotation  dir. of t  {'|t|, ' + unit:>11}"]
    for entry, step in zip(entries, steps, strict=True):
        mark = "*" if entry is in_place else " "
        what = entry.action if entry.restored is None else f"rolled back to {entry.restored}"
        turned = f"{'':8}  {'':9}" if step is None else f"{step.rotation_deg:8.3f}  {step.translation_deg:9.3f}"
        length = float(norm(entry.rig.projector_from_camera.t))
        lines.append(f"{mark}{entry.id:>3}  {entry.time:%Y-%m-%d %H:%M:%S}  {what:<17.17}  {turned}  {length:>11.6g}")
    lines.append("angles in degrees, from the line above")
    lines.append("* is in place" if in_place is not None else "the rig in place is none of them: it was edited since")
    if entries[0].id > 1:
        lines.append(f"entries before {entries[0].id} are not shown: --last N")
    return "\n".join(lines)


def _record_text(record: WatchRecord) -> str:
    """Where the rig is at the last frame, axis by axis."""
    from retrue.recalibration.axes import NAMES

    bumps = ", ".join(record.names[first] for first in record.bumps)
    lines = [f"watched: {len(record.times)} frames, {f'bumps from {bumps}' if bumps else 'no bump'}; at the last one"]
    for name, moved, sigma in zip(NAMES, record.track_deg[-1], record.sigma_deg[-1], strict=True):
        lines.append(f"  {name}: {moved:+.3f} deg, sigma {sigma:.3f} deg")
    return "\n".join(lines)
