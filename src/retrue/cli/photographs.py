"""What `--stereo` does to a command: captures are pairs of photographs, and words are those of two cameras."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

from retrue.cli.command import Outcome, ReportingCommand, log
from retrue.cli.terminal import terminal
from retrue.errors import InputError

if TYPE_CHECKING:
    from retrue.capture import Capture
    from retrue.decoding.photographs.learned import MatcherName
    from retrue.files.photographs import PhotographPair
    from retrue.recalibration.axes import AxisMove
    from retrue.rig import Rig

DEVICES = {"projector": "second camera", "camera": "first camera"}


@dataclass(frozen=True, kw_only=True)
class PhotographCommand(ReportingCommand):
    """A command whose captures may be pairs of photographs.

    Attributes
    ----------
    stereo
        The rig is two cameras: captures are their photographs, two folders, one folder of both, or pairs in turn.
    matcher
        Who matches them; lightglue and loftr need `pip install '.[matchers]'`.
    """

    stereo: bool = False
    matcher: Literal["sift", "lightglue", "loftr"] = "sift"

    def read(self, rig: Rig, captures: Sequence[Path], pattern: Path | None, **how: bool) -> list[Capture]:
        """As of any command; pairs of photographs where that is asked for."""
        if not self.takes_photographs(captures):
            return super().read(rig, captures, pattern, **how)
        if pattern is not None:
            raise InputError("expected --stereo or --pattern: photographs of a scene show no pattern")
        from retrue.correspondences import require_each_once

        read = [pair.capture for pair in read_pairs(rig, captures, self.matcher)]
        require_each_once([(capture.name, capture.points) for capture in read])
        return read

    def takes_photographs(self, captures: Sequence[Path]) -> bool:
        """Whether these are pictures of two cameras; a table of their matches is a capture like any other."""
        from retrue.files.points import TABLES

        return self.stereo and not (captures and all(path.suffix.lower() in TABLES for path in captures))

    def told(self, outcome: Outcome) -> Outcome:
        """The outcome, in the words of the rig that was handed in."""
        if not self.stereo:
            return outcome
        spoken = ("reason", "advice", "resolved_by")
        report = {key: _of_cameras(value) if key in spoken else value for key, value in outcome.report.items()}
        return replace(outcome, report=report, text=_of_cameras(outcome.text))


def read_pairs(rig: Rig, paths: Sequence[Path], matcher: MatcherName = "sift") -> list[PhotographPair]:
    """Each matched, and said how many places it shares; all sizes are compared before any work."""
    from retrue.decoding.photographs.learned import named_matcher
    from retrue.files.photographs import find_pairs, read_pair
    from retrue.patterns.photographs import Photographs

    if not paths:
        raise InputError("expected photographs of two cameras after the rig, found none")
    read: list[PhotographPair] = []
    show = terminal.progress("matching photographs")
    pairs, asked = find_pairs(paths, rig), Photographs(matcher=named_matcher(matcher))
    for done, pair in enumerate(pairs):
        if done:
            show(done, len(pairs))
        read.append(read_pair(pair, asked))
        log(f"{read[-1].capture.name}: {len(read[-1].capture.points)} correspondences")
    return read


def axes_text(axes: Sequence[AxisMove]) -> str:
    """The move axis by axis, a line each; nothing where there is no pose."""
    lines = [f"  {one.name}: {one.moved_deg:+.3f} deg, sigma {one.sigma_deg:.3f} deg" for one in axes]
    return "\n".join(["axis by axis:", *lines]) if lines else ""


def axes_report(axes: Sequence[AxisMove]) -> list[dict[str, Any]]:
    """The same for `--json`."""
    return [asdict(one) for one in axes]


def _of_cameras(said: Any) -> Any:
    if isinstance(said, list):
        return [_of_cameras(line) for line in cast("list[Any]", said)]
    if not isinstance(said, str):
        return said
    return re.sub(
        r"(?<!first )(?<!second )(?<![\w./-])(projector|camera)(?![\w.-])", lambda found: DEVICES[found[1]], said
    )
