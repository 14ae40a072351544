"""`--report`: from what a command was given to the page about it."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from retrue.cli.command import Outcome
from retrue.cli.terminal import terminal

if TYPE_CHECKING:
    from retrue.correspondences import Correspondences
    from retrue.geometry.arrays import Image
    from retrue.report.seen import SeenCapture


def seen_captures(paths: Sequence[Path], pattern: Path | None, points: Sequence[Correspondences]) -> list[SeenCapture]:
    """What was decoded, with the photographs that it was decoded from."""
    from retrue.report.seen import SeenCapture

    return [
        SeenCapture(path.name, decoded, _photograph(path, pattern)) for path, decoded in zip(paths, points, strict=True)
    ]


def written_page(outcome: Outcome, arguments: Sequence[str]) -> Outcome:
    """Write the page of an outcome; returns the outcome, which then says so."""
    from retrue.pages import write_page

    if outcome.page is None:
        return outcome
    path, page = outcome.page
    terminal.detail("drawing the report")
    write_page(path, page, shlex.join(["retrue", *arguments]))
    return replace(
        outcome, report={**outcome.report, "page": str(path)}, text=f"{outcome.text}\n{path}: report written"
    )


def _photograph(path: Path, pattern: Path | None) -> Image | None:
    """The picture of a colour grid, or a Gray code's scene in white light; a table of points has none."""
    from retrue.files.images import read_folder, read_image
    from retrue.files.patterns import read_pattern
    from retrue.patterns.gray_code import GrayCode

    spec = None if pattern is None else read_pattern(pattern)
    if path.is_dir() and isinstance(spec, GrayCode):
        from retrue.decoding.gray.sequence import arrange

        images, paths = read_folder(path)
        return arrange(spec, images, [entry.name for entry in paths]).white
    return None if path.suffix.lower() == ".csv" else read_image(path)
