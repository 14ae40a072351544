"""What a batch leaves to read: a table of all captures, and a file of what `verify` said of each."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from io import FileIO
from pathlib import Path
from typing import Any

from retrue.batch.batch import Row
from retrue.files.atomic import replaced_file
from retrue.files.file_lock import not_waiting

COLUMNS = (
    "capture", "verdict", "correspondences", "epipolar_rms_px", "rotation_deg", "translation_deg", "length",
    "drift_sigmas", "rig", "points", "failed",
)  # fmt: skip
VERIFICATION = ("verdict", "reason", "correspondences", "epipolar_rms_px", "drift", "drift_sigmas", "sigma")


def write_summary(out: Path, rows: Sequence[Row]) -> None:
    """summary.csv, and verify/NAME.json of each capture that was verified; files that say so already stay."""
    table = io.StringIO(newline="")
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows([said[name] for name in COLUMNS] for said in map(values, rows))
    with replaced_file(out / "summary.csv") as stream:
        stream.write(table.getvalue().encode(errors="surrogateescape"))
    for row in rows:
        if "verdict" in row.result:
            said = {name: row.result[name] for name in VERIFICATION} | {"rig": str(row.rig)}
            _keep_written(out / f"verify/{row.name}.json", json.dumps(said).encode() + b"\n")


def counts(rows: Sequence[Row]) -> dict[str, int]:
    """How many of each verdict, how many clouds, and how many failed."""
    verdicts = [str(row.result["verdict"]) for row in rows if "verdict" in row.result]
    found = {name: verdicts.count(name) for name in ("good", "drifted", "unknown")}
    clouds = sum("points" in row.result for row in rows)
    return {"captures": len(rows), **found, "clouds": clouds, "failed": sum(bool(row.failed) for row in rows)}


def values(row: Row) -> dict[str, Any]:
    """A row of the table; None where there is nothing to say."""
    result = row.result
    drift: dict[str, Any] = result.get("drift") or {}
    return {
        "capture": row.name,
        **{name: result.get(name) for name in ("verdict", "correspondences", "epipolar_rms_px", "drift_sigmas")},
        **{name: drift.get(name) for name in ("rotation_deg", "translation_deg", "length")},
        "rig": row.rig,
        "points": result.get("points"),
        "failed": row.failed,
    }


def _keep_written(path: Path, content: bytes) -> None:
    """Without waiting for the disk: what a power cut takes is written by the next run."""
    try:
        with FileIO(path, opener=not_waiting) as stream:
            if stream.read(len(content) + 1) == content:
                return
    except OSError:
        path.parent.mkdir(parents=True, exist_ok=True)
    waiting = path.with_name(f".{path.name}.part")
    waiting.write_bytes(content)
    waiting.replace(path)
