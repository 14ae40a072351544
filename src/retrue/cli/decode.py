"""`retrue decode`."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import arg

from retrue.cli.command import (
    DONE,
    REFUSED_OR_DRIFTED,
    AFile,
    CapturePath,
    Command,
    Outcome,
    PatternPath,
    made_folder,
    read_captures,
    require_writable,
    shown_pattern,
)
from retrue.errors import InputError

if TYPE_CHECKING:
    from retrue.capture import Capture
    from retrue.correspondences import Card
    from retrue.patterns.pattern import Pattern


@dataclass(frozen=True, kw_only=True)
class Decode(Command):
    """Match camera pixels with projector pixels, and write them as CSV.

    Attributes
    ----------
    capture
        A picture (colour grid, line grid), a folder of pictures (Gray code), or a points CSV.
    pattern
        What the projector showed, JSON; of a line grid also the picture that was shown.
    out
        The CSV to write: camera_x,camera_y,projector_x,projector_y and what else is known.
    debug
        Folder for pictures of what the decoder of a colour grid saw: blocks, links, colours, decoded, rejected; needs
        `pip install '.[plot]'`.
    """

    capture: CapturePath
    pattern: PatternPath = None
    out: Path
    debug: Annotated[AFile | None, arg(metavar="DIR")] = None

    def run(self) -> Outcome:
        from retrue.files.points import write_points
        from retrue.plain_json import plain

        require_writable(self.out, made_of=(self.capture, self.pattern))
        if self.debug is not None:
            from retrue.report.pictures import require_matplotlib

            require_matplotlib("--debug")
        pattern = shown_pattern(self.pattern)
        start = time.perf_counter()
        (capture,) = read_captures([self.capture], pattern, keep_photographs=self.debug is not None)
        seconds = time.perf_counter() - start
        count, card = len(capture.points), capture.card
        write_points(self.out, capture.points)
        report: dict[str, Any] = {
            "correspondences": count,
            "seconds": seconds,
            "card": {} if card is None else plain(asdict(card)),
            "out": str(self.out),
        }
        text = [f"{self.out}: {count} correspondences, decoded in {seconds:.2f} s"]
        if card is not None:
            text += _card_lines(card)
        if self.debug is not None:
            report["debug"] = [str(path) for path in _draw(capture, pattern, made_folder(self.debug))]
            text.append(f"{self.debug}: {len(report['debug'])} pictures of what the decoder saw")
        return Outcome(report, "\n".join(text), DONE if count else REFUSED_OR_DRIFTED)


def _card_lines(card: Card) -> list[str]:
    """What was seen, what was left out and why, and what to change, a line each."""
    lines = [f"{card.seen} {card.counted} seen, {card.decoded} decoded", f"{card.coverage:.0%} of the picture covered"]
    lines += [f"left out: {reason}, {count}" for reason, count in card.rejected.items() if count]
    return lines + [f"advice: {line}" for line in card.advice]


def _draw(capture: Capture, pattern: Pattern | None, folder: Path) -> list[Path]:
    """The pictures of one look at a colour grid."""
    from retrue.decoding.blocks.decode_color_grid import inspect_color_grid
    from retrue.files.atomic import replaced_file
    from retrue.patterns.color_grid import ColorGrid
    from retrue.report.grid_debug import grid_pictures

    if not isinstance(pattern, ColorGrid) or capture.photograph is None:
        raise InputError("--debug draws what was seen of a colour grid: give one picture and a color-grid pattern")
    paths: list[Path] = []
    for name, picture in grid_pictures(inspect_color_grid(pattern, capture.photograph)).items():
        paths.append(folder / f"{name}.png")
        with replaced_file(paths[-1]) as stream:
            stream.write(picture)
    return paths
