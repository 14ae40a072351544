"""The page of a batch: how the rig drifted over its captures, and what became of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from retrue.report.figures import numbers
from retrue.report.page import Block, Chart, Fact, Page, Section, Table, Text
from retrue.shown import MISSING, figures

MOST_ROWS = 2000  # of a table that a browser still likes


def batch_page(counted: Mapping[str, int], rows: Sequence[Mapping[str, Any]]) -> Page:
    """Of rows with the keys of summary.csv."""
    failed = [row for row in rows if row["failed"]]
    sentence = f"{counted['captures']} captures, {counted['clouds']} clouds, {len(failed)} failed."
    sections: list[Section] = []
    if any(row["rotation_deg"] is not None for row in rows):
        sections.append(
            Section("The rig over time", "How far each capture is from the rig that held.", (_drift(rows),))
        )
    if failed:
        told = tuple((str(row["capture"]), str(row["failed"])) for row in failed[:MOST_ROWS])
        table = Table(("Capture", "Why"), told, numeric=False)
        sections.append(Section("What failed", "Each with its reason; the others are not touched by it.", (table,)))
    blocks: list[Block] = [_table(rows[:MOST_ROWS])]
    if len(rows) > MOST_ROWS:
        blocks.append(Text(f"The first {MOST_ROWS} of {len(rows)}; summary.csv has them all."))
    sections.append(Section("All captures", "In the order in which they were taken.", tuple(blocks)))
    facts = tuple(Fact(name.capitalize(), f"{count:,}") for name, count in counted.items())
    return Page(
        "batch", "Failures" if failed else "Done", "warn" if failed else "good", sentence, facts, tuple(sections)
    )


def _drift(rows: Sequence[Mapping[str, Any]]) -> Chart:
    known = [(number, row) for number, row in enumerate(rows, start=1) if row["rotation_deg"] is not None]
    traces = [
        {
            "type": "scatter",
            "mode": "markers",
            "name": name,
            "x": [number for number, _ in known],
            "y": numbers([row[key] for _, row in known]),
            "marker": {"color": color, "size": 5},
        }
        for key, name, color in (
            ("rotation_deg", "rotation", "var(--camera)"),
            ("translation_deg", "direction of t", "var(--after)"),
        )
    ]
    layout = {"xaxis": {"title": {"text": "capture"}}, "yaxis": {"title": {"text": "degrees"}, "rangemode": "tozero"}}
    return Chart({"data": traces, "layout": layout}, "Drift of each capture from the rig that held for it", extra=60)


def _table(rows: Sequence[Mapping[str, Any]]) -> Table:
    head = ("Capture", "Verdict", "Correspondences", "RMS, px", "Rotation, deg", "Dir. of t, deg", "Points")
    keys = ("correspondences", "epipolar_rms_px", "rotation_deg", "translation_deg", "points")
    return Table(
        head,
        tuple(
            (
                str(row["capture"]),
                str(row["verdict"] or MISSING),
                *(MISSING if row[key] is None else figures(row[key]) for key in keys),
            )
            for row in rows
        ),
    )
