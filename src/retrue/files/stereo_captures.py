"""Pictures of the board by two cameras, from disk: which picture of the one belongs to which of the other."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from warnings import warn

from retrue.calibration.board import Board
from retrue.calibration.views import Progress, StereoCapture
from retrue.errors import CaptureError, InputError, RetrueWarning, require_kind, require_kinds
from retrue.files.board_captures import read_board_capture
from retrue.files.images import SUFFIXES, natural_key, read_image
from retrue.patterns.pattern import PATTERNS, Pattern
from retrue.through_code import match_through_code

Pair = tuple[Path, Path]
WAYS = (
    "two folders, of the left and of the right camera; or one that holds both, such as left01.jpg and right01.jpg; "
    "or pairs, left and right in turn"
)


def read_stereo_captures(
    paths: Sequence[str | Path],
    board: Board,
    pattern: Pattern | None = None,
    progress: Progress = lambda message: None,
) -> list[StereoCapture]:
    """Poses of the board by two cameras, the first one's picture and the second one's.

    Parameters
    ----------
    paths : two folders, of the first camera's pictures and of the second one's; one folder that holds both; or pairs.
        Pictures of one number belong together. With a pattern each of them is a folder, as `read_board_capture` takes.
    pattern : what a projector showed in every pose, where both cameras saw it: they are matched through it.

    Raises
    ------
    CaptureError, FileError : of pictures that are missing, unreadable, or do not decode; names them.
    InputError : paths that make no pairs.
    """
    require_kinds(paths, (str, Path), "paths")
    require_kind(board, Board, "board", "retrue.parse_board makes one of such a text")
    if pattern is not None:
        require_kind(pattern, PATTERNS, "pattern", "retrue.read_pattern reads one")

    def read(pair: Pair) -> StereoCapture:
        left, right = pair
        progress(f"reading {left.name} and {right.name}")
        name = f"{left.name}, {right.name}"
        if pattern is None:
            return StereoCapture(name, read_image(left, grey=True), read_image(right, grey=True))
        first, second = (read_board_capture(side, pattern, board) for side in pair)
        return StereoCapture(name, first.white, second.white, match_through_code(first.points, second.points))

    with ThreadPoolExecutor(2) as threads:
        return list(threads.map(read, stereo_pairs([Path(path) for path in paths], coded=pattern is not None)))


def stereo_pairs(paths: Sequence[Path], *, coded: bool = False) -> list[Pair]:
    """What belongs together: pictures, or folders of the pictures of a code.

    What has no partner is left out with a `RetrueWarning`. Raises `CaptureError` for a folder that holds no such
    things, `InputError` where there are no pairs.
    """
    entries = list(paths)
    if len(entries) == 1 and entries[0].is_dir():
        entries = _both_sides(entries[0], coded)
    if len(entries) == 2 and all(entry.is_dir() and not (coded and _is_capture(entry)) for entry in entries):
        return _by_number(*(_members(side, coded) for side in entries))
    if not entries or len(entries) % 2:
        raise InputError(f"captures of two cameras: expected {WAYS}; found {len(entries)}")
    half = len(entries) // 2
    if len({_side(entry) for entry in entries[:half]} & {_side(entry) for entry in entries[half:]}) == 0:
        return _by_number(entries[:half], entries[half:])  # as a shell lists left*.jpg right*.jpg
    return list(zip(entries[::2], entries[1::2], strict=True))


def _both_sides(folder: Path, coded: bool) -> list[Path]:
    """The two folders of a folder, or all of its pictures, those of the left camera first."""
    folders = _sorted(entry for entry in folder.iterdir() if entry.is_dir())
    if len(folders) == 2:
        return folders
    entries = folders if coded else _members(folder, coded)
    sides = sorted({_side(entry) for entry in entries})
    if len(sides) != 2:
        raise CaptureError(folder, f"captures of two cameras: expected {WAYS}; found names of {len(sides)} kinds")
    return [entry for side in sides for entry in entries if _side(entry) == side]


def _members(folder: Path, coded: bool) -> list[Path]:
    """Pictures, or folders, by number."""
    entries = [entry for entry in folder.iterdir() if not entry.name.startswith(".")]
    if coded:
        found = [entry for entry in entries if entry.is_dir()]
    else:
        found = [entry for entry in entries if entry.suffix.lower() in SUFFIXES and entry.is_file()]
    if not found:
        what = "folders of pictures" if coded else "pictures: PNG, JPEG, BMP or TIFF files"
        raise CaptureError(folder, f"expected {what} of one camera, found none")
    return _sorted(found)


def _by_number(left: Sequence[Path], right: Sequence[Path]) -> list[Pair]:
    """By the last number of their names, where each side has each once; else in their order."""
    numbered = [{_number(entry): entry for entry in side} for side in (left, right)]
    unclear = any(None in a or len(a) != len(b) for a, b in zip(numbered, (left, right), strict=True))
    if unclear:
        if len(left) != len(right):
            raise InputError(
                f"captures of two cameras: expected as many of each, found {len(left)} in {left[0].parent} and "
                f"{len(right)} in {right[0].parent}, without numbers by which to tell which is missing"
            )
        return list(zip(left, right, strict=True))
    both = [number for number in numbered[0] if number in numbered[1]]
    alone = [entry for side, other in (numbered, numbered[::-1]) for n, entry in side.items() if n not in other]
    if not both:
        raise InputError(f"captures of two cameras: expected pictures of one number, found none: {alone[0].name}, ...")
    if alone:
        names = ", ".join(entry.name for entry in alone[:5])
        warn(f"left out, without a partner: {names}{', ...' * (len(alone) > 5)}", RetrueWarning, stacklevel=3)
    return [(numbered[0][number], numbered[1][number]) for number in both]


def _number(entry: Path) -> int | None:
    digits = re.findall(r"\d+", entry.stem)
    return int(digits[-1]) if digits else None


def _side(entry: Path) -> str:
    """The name without its last number, and where it lies: the same of all pictures of one camera."""
    return f"{entry.parent}/{re.sub(r'[0-9]+(?=[^0-9]*$)', '', entry.stem).casefold()}"


def _is_capture(folder: Path) -> bool:
    """Whether pictures lie in it, rather than folders of them."""
    return any(entry.suffix.lower() in SUFFIXES for entry in folder.iterdir())


def _sorted(entries: Iterable[Path]) -> list[Path]:
    return sorted(entries, key=lambda entry: (natural_key(entry.name), entry.name))
