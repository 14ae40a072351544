"""What every command is and what it comes to."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import Positional, arg
from tyro.constructors import PrimitiveConstructorSpec

from retrue.cli.terminal import terminal
from retrue.errors import FileError, InputError

if TYPE_CHECKING:
    from retrue.capture import Capture
    from retrue.patterns.pattern import Pattern
    from retrue.report.page import Page
    from retrue.rig import Rig

# `AFile | None` tyro checks itself; of `Path | None`, and of `tuple[Path, ...]`, it asks a library that takes longer to
# load than a picture takes to decode.
AFile = Annotated[Path, "a file"]
RigPath = Positional[Annotated[Path, arg(metavar="RIG")]]
CapturePath = Positional[Annotated[Path, arg(metavar="CAPTURE")]]
if TYPE_CHECKING:
    CapturePaths = tuple[Path, ...]
else:
    _paths = PrimitiveConstructorSpec(
        nargs="*",
        metavar="[PATH [PATH ...]]",
        instance_from_str=lambda words: tuple(map(Path, words)),
        is_instance=lambda value: isinstance(value, tuple),
        str_from_instance=lambda paths: [str(path) for path in paths],
    )
    CapturePaths = Positional[Annotated[tuple, _paths, arg(metavar="CAPTURE...")]]
PatternPath = Annotated[AFile | None, arg(metavar="P.json")]

DONE = 0
REFUSED_OR_DRIFTED = 1
BAD_INPUT = 2
OUR_FAULT = 70  # EX_SOFTWARE of sysexits.h


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a command found.

    Attributes
    ----------
    report
        Plain JSON values, for `--json`.
    text
        The same for people.
    exit_status
        `DONE` or `REFUSED_OR_DRIFTED`.
    page
        A page about it, and where to write that.
    """

    report: Mapping[str, Any]
    text: str
    exit_status: int = DONE
    page: tuple[Path, Page] | None = None


@dataclass(frozen=True, kw_only=True)
class Command(ABC):
    """A command; its fields are its arguments.

    Attributes
    ----------
    json
        Print one JSON object to stdout and nothing else.
    quiet
        Say nothing but what is wrong; the exit status tells the rest.
    verbose
        Say what is being done, and when.
    """

    json: bool = False
    quiet: bool = False
    verbose: bool = False

    @abstractmethod
    def run(self) -> Outcome:
        """Do it; a `RetrueError` means that what was handed in cannot be used."""


@dataclass(frozen=True, kw_only=True)
class ReportingCommand(Command):
    """A command that can show what it saw and found.

    Attributes
    ----------
    report
        A page to write, HTML, one file that needs no network: pictures, the scene in 3D, tables, evidence.
    """

    report: Annotated[AFile | None, arg(metavar="PAGE.html")] = None

    def read(
        self,
        rig: Rig,
        captures: Sequence[Path],
        pattern: Path | None,
        *,
        one_coordinate: bool = False,
        photographs: bool = False,
    ) -> list[Capture]:
        """The captures, with their photographs where a page will show them; all sizes are compared before any work.

        `one_coordinate`: columns or rows alone will do. `photographs`: keep them in any case.
        """
        from retrue.correspondences import require_both_axes, require_each_once
        from retrue.files.captures import pictures_size
        from retrue.rasters import check_extent, check_pattern, check_pictures, check_rasters

        shown = shown_pattern(pattern)
        if shown is not None and pattern is not None:
            sizes = [(path, size) for path in captures if (size := pictures_size(path)) is not None]
            check_pattern(rig, shown.projector_size, pattern)
            for path, size in sizes:
                check_pictures(rig, size, path)
        read = read_captures(captures, shown, keep_photographs=photographs or self.report is not None)
        for path, capture in zip(captures, read, strict=True):
            check_rasters(rig, capture.points, path)
            check_extent(rig, capture.points, path)
            if not one_coordinate:
                require_both_axes(capture.points, path)
        require_each_once([(path, capture.points) for path, capture in zip(captures, read, strict=True)])
        return read


def with_advice(outcome: Outcome, captures: Sequence[Capture]) -> Outcome:
    """The same, with what the decoders say of the captures; told to people where there is no answer."""
    said = [(capture.name, line) for capture in captures if capture.card is not None for line in capture.card.advice]
    text = outcome.text
    if outcome.exit_status == REFUSED_OR_DRIFTED:
        text = "\n".join([text, *(f"advice: {name}: {line}" for name, line in said if line not in text)])
    report = {**outcome.report, "advice": [f"{name}: {line}" for name, line in said]}
    return replace(outcome, report=report, text=text)


def contradicted(rig: Rig, captures: Sequence[Capture]) -> Outcome | None:
    """The answer where a capture contradicts the rig, so that nothing should be measured with it; else None."""
    from retrue.cli.json_output import verification_report
    from retrue.recalibration.verify import unasked, verify

    for capture in captures:
        verification = unasked(capture.points) if len(capture.points.axes) < 2 else verify(rig, [capture.points])
        if not len(capture.points) or verification.forbids_measuring:
            report = verification_report(verification, 0.0) | {"out": None}
            text = f"refused: nothing was written: {capture.name}: {verification.reason}"
            return with_advice(Outcome(report, text, REFUSED_OR_DRIFTED), [capture])
    return None


def log(message: str) -> None:
    """What was found on the way, out of the way of what a program may read from stdout."""
    terminal.note(message)


def require_writable(*paths: Path | None, made_of: Sequence[Path | None] = ()) -> None:
    """Find out before the work, not after it, that an answer has nowhere to go, or would replace what it is made of
    or another answer."""
    taken = {path.resolve() for path in made_of if path is not None}
    for path in paths:
        if path is None:
            continue
        if path.resolve() in taken:
            raise FileError(path, "expected a file of its own to write, found one that is read, or written already")
        taken.add(path.resolve())
        if path.is_dir():
            raise FileError(path, "expected a file to write, found a folder")
        if not path.parent.is_dir():
            raise FileError(path, f"cannot be written: {path.parent} is no folder; make it first")
        if not os.access(path.parent, os.W_OK):
            raise FileError(path, f"cannot be written: no permission to write in {path.parent}")


def made_folder(path: Path) -> Path:
    """The folder, made where it is not there yet."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(path, f"cannot be made a folder: {error.strerror or error}") from error
    return path


def shown_pattern(path: Path | None) -> Pattern | None:
    """What the projector showed. Its decoder is imported with it: a clock that starts now measures work."""
    if path is None:
        return None
    from retrue.decoding.decode import import_decoder
    from retrue.files.patterns import read_pattern

    pattern = read_pattern(path)
    import_decoder(pattern)
    return pattern


def read_captures(paths: Sequence[Path], pattern: Pattern | None, *, keep_photographs: bool = False) -> list[Capture]:
    """Each decoded or read, and said how many points it holds."""
    from retrue.files.captures import load_capture

    if not paths:
        raise InputError("expected at least one CAPTURE after the rig, found none")
    captures: list[Capture] = []
    show = terminal.progress("decoding captures")
    for done, path in enumerate(paths):
        if pattern is not None:
            terminal.status(f"decoding {path}")
        if done:
            show(done, len(paths))
        captures.append(load_capture(path, pattern, keep_photograph=keep_photographs))
        log(f"{path}: {len(captures[-1].points)} correspondences")
    return captures
