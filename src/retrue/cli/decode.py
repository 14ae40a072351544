"""`retrue decode`."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import arg

from retrue.cli.command import (
    DONE,
    REFUSED_OR_DRIFTED,
    CapturePath,
    Command,
    Outcome,
    PatternPath,
    made_folder,
    read_captures,
    require_writable,
)
from retrue.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Decode(Command):
    """Match camera pixels with projector pixels, and write them as CSV.

    Attributes
    ----------
    capture
        A picture (colour grid), a folder of pictures (Gray code), or a points CSV.
    pattern
        What the projector showed, JSON.
    out
        The CSV to write: camera_x,camera_y,projector_x,projector_y and what else is known.
    debug
        Folder for pictures of what the decoder of a colour grid saw: blocks, links, colours, decoded, rejected.
    """

    capture: CapturePath
    pattern: PatternPath = None
    out: Path
    debug: Annotated[Path | None, arg(metavar="DIR")] = None

    def run(self) -> Outcome:
        from retrue.files.points import write_points
        from retrue.plain_json import plain

        require_writable(self.out)
        start = time.perf_counter()
        (points,) = read_captures([self.capture], self.pattern)
        seconds = time.perf_counter() - start
        write_points(self.out, points)
        report = {"correspondences": len(points), "seconds": seconds, "card": plain(points.card), "out": str(self.out)}
        text = [f"{self.out}: {len(points)} correspondences, decoded in {seconds:.2f} s", *_card_lines(points.card)]
        if self.debug is not None:
            report["debug"] = [str(path) for path in _draw(self.capture, self.pattern, made_folder(self.debug))]
            text.append(f"{self.debug}: {len(report['debug'])} pictures of what the decoder saw")
        return Outcome(report, "\n".join(text), DONE if len(points) else REFUSED_OR_DRIFTED)


def _card_lines(card: Mapping[str, Any]) -> list[str]:
    """What was seen, what was left out and why, and what to change, a line each."""
    lines: list[str] = []
    if "blocks_seen" in card:
        lines.append(f"{card['blocks_seen']} blocks seen, {card['decoded']} decoded")
    if "coverage" in card:
        lines.append(f"{card['coverage']:.0%} of the picture covered")
    lines += [f"left out: {reason}, {count}" for reason, count in card.get("rejected", {}).items() if count]
    advice = card.get("advice") or ()
    return lines + [f"advice: {line}" for line in ([advice] if isinstance(advice, str) else advice)]


def _draw(capture: Path, pattern: Path | None, folder: Path) -> list[Path]:
    """The pictures of one look at a colour grid."""
    from retrue.decoding.blocks.decode_color_grid import inspect_color_grid
    from retrue.files.atomic import replaced_file
    from retrue.files.images import read_image
    from retrue.files.patterns import read_pattern
    from retrue.patterns.color_grid import ColorGrid
    from retrue.report.grid_debug import grid_pictures

    spec = None if pattern is None else read_pattern(pattern)
    if not isinstance(spec, ColorGrid) or not capture.is_file():
        raise InputError("--debug draws what was seen of a colour grid: give one picture and a color-grid pattern")
    paths: list[Path] = []
    for name, picture in grid_pictures(inspect_color_grid(spec, read_image(capture))).items():
        paths.append(folder / f"{name}.png")
        with replaced_file(paths[-1]) as stream:
            stream.write(picture)
    return paths
