"""Which picture of one camera belongs to which of the other: told by their names, and never guessed."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from warnings import warn

from retrue.errors import CaptureError, InputError, RetrueWarning
from retrue.files.images import SUFFIXES, natural_key

Pair = tuple[Path, Path]
WAYS = (
    "two folders, of the left and of the right camera; or one that holds both, such as left01.jpg and right01.jpg; "
    "or pairs, left and right in turn"
)
SIDES = (("left", "right"), ("l", "r"), ("first", "second"), ("a", "b"))
CAMERAS = frozenset({"cam", "camera", "c", "image", "img", "view"})
"""Words before a number that may be the camera's: cam0, image_2."""


def stereo_pairs(paths: Sequence[Path], *, coded: bool = False) -> list[Pair]:
    """What belongs together: pictures, or, with `coded`, folders of the pictures of a code. The first camera's first.

    Names are read as runs of letters and of digits. What differs between the cameras and not within one is the side;
    the rest is what pictures of a pair have in common. What has no partner is left out with a `RetrueWarning`.

    Raises
    ------
    CaptureError : a folder that holds no such things.
    InputError : no pairs, or names by which there is more than one way to pair them.
    """
    entries = list(paths)
    if len(entries) == 1 and entries[0].is_dir():
        return _of_folder(entries[0], coded)
    if len(entries) == 2 and all(entry.is_dir() and not (coded and _is_capture(entry)) for entry in entries):
        return _of_sides(*(_members(side, coded) for side in entries))
    if not entries or len(entries) % 2:
        raise InputError(f"captures of two cameras: expected {WAYS}; found {len(entries)}")
    sides = _split(entries) if len(entries) > 2 else None
    return list(zip(entries[::2], entries[1::2], strict=True)) if sides is None else _of_sides(*sides)


def words(name: str) -> tuple[str | int, ...]:
    """Runs of letters, and of digits by value.

    >>> words("cam0_Img-007")
    ('cam', 0, 'img', 7)
    """
    return tuple(int(run) if run.isdecimal() else run for run in re.findall(r"\d+|[^\W\d_]+", name.casefold()))


def sides_of(folder: Path) -> tuple[Path, Path] | None:
    """The two folders of a folder that are of one camera each; None where there are no such two."""
    folders = _sorted(entry for entry in folder.iterdir() if entry.is_dir() and not entry.name.startswith("."))
    if len(folders) > 2:
        named = [entry for entry in folders if words(entry.name)[-1:] in _SIDE_WORDS]
        folders = named if len(named) == 2 else folders
    return (folders[0], folders[1]) if len(folders) == 2 else None


def _of_folder(folder: Path, coded: bool) -> list[Pair]:
    """Of two folders in it, or of the pictures of both cameras."""
    sides = sides_of(folder)
    if sides is not None:
        return _of_sides(*(_members(side, coded) for side in sides))
    entries = _members(folder, coded)
    places = _side_places(entries)
    if not places:
        raise CaptureError(
            folder, f"captures of two cameras: expected {WAYS}; found no word or number in the names that tells them"
        )
    if len(places) > 1:
        raise CaptureError(
            folder,
            f"{entries[0].name}, {entries[1].name}, ... can be paired in {len(places)} ways: put the pictures of each"
            " camera into a folder of its own",
        )
    first, second = _parted(entries, places[0])
    spoken = [words(side[0].stem)[places[0]] for side in (first, second)]
    return _of_sides(
        *((first, second) if natural_key(str(spoken[0])) < natural_key(str(spoken[1])) else (second, first))
    )


def _split(entries: Sequence[Path]) -> tuple[list[Path], list[Path]] | None:
    """What a shell listed, by camera, the first one's camera first; None where neither folders nor names tell."""
    folders = list(dict.fromkeys(entry.parent for entry in entries))
    if len(folders) == 2:
        first, second = ([entry for entry in entries if entry.parent == folder] for folder in folders)
        return first, second
    places = _side_places(entries)
    return _parted(entries, places[0]) if len(folders) == 1 and len(places) == 1 else None


def _parted(entries: Sequence[Path], place: int) -> tuple[list[Path], list[Path]]:
    """By that word of their names; those that have the first one's come first."""
    side = words(entries[0].stem)[place]
    mine = [words(entry.stem)[place] == side for entry in entries]
    first, second = (
        [entry for entry, is_mine in zip(entries, mine, strict=True) if is_mine is yes] for yes in (True, False)
    )
    return first, second


def _side_places(entries: Sequence[Path]) -> list[int]:
    """At which words of their names pictures of two cameras may differ: the fewest that can be told."""
    spoken = [words(entry.stem) for entry in entries]
    if len(spoken) < 2 or len({len(name) for name in spoken}) != 1 or len(set(spoken)) != len(spoken):
        return []
    told: list[int] = []
    possible: list[int] = []
    for place in range(len(spoken[0])):
        sides = {name[place] for name in spoken}
        rest = [name[:place] + name[place + 1 :] for name in spoken]
        if len(sides) != 2 or not any(rest.count(other) == 2 for other in rest):
            continue
        possible.append(place)
        before = spoken[0][place - 1] if place else ""
        if any(sides == set(pair) for pair in SIDES) or before in CAMERAS:
            told.append(place)
    return told or possible


def _of_sides(left: Sequence[Path], right: Sequence[Path]) -> list[Pair]:
    """By what changes within a camera's names, where that tells each from each; else in their order."""
    keyed: list[dict[object, Path]] = [_keys(side) for side in (left, right)]
    both = [key for key in keyed[0] if key in keyed[1]]
    if not both and all(len(side) > 1 for side in (left, right)):
        keyed = [{_number(entry): entry for entry in side} for side in (left, right)]
        both = [key for key in keyed[0] if key in keyed[1] and key is not None]
    unclear = any(None in a or len(a) != len(b) for a, b in zip(keyed, (left, right), strict=True))
    if unclear or (not both and len(left) == len(right) == 1):
        if len(left) != len(right):
            raise InputError(
                f"captures of two cameras: expected as many of each, found {len(left)} in {left[0].parent} and "
                f"{len(right)} in {right[0].parent}, without numbers by which to tell which is missing"
            )
        return list(zip(left, right, strict=True))
    alone = [entry for side, other in (keyed, keyed[::-1]) for key, entry in side.items() if key not in other]
    if not both:
        raise InputError(f"captures of two cameras: expected pictures of one number, found none: {alone[0].name}, ...")
    if alone:
        names = ", ".join(entry.name for entry in alone[:5])
        warn(f"left out, without a partner: {names}{', ...' * (len(alone) > 5)}", RetrueWarning, stacklevel=3)
    return [(keyed[0][key], keyed[1][key]) for key in both]


def _keys(entries: Sequence[Path]) -> dict[object, Path]:
    """Each by the words that change from one to another; by None where their names are not alike."""
    spoken = [words(entry.stem) for entry in entries]
    if len({len(name) for name in spoken}) != 1:
        return dict.fromkeys([None], entries[0])
    changing = [place for place in range(len(spoken[0])) if len({name[place] for name in spoken}) > 1]
    return {tuple(name[place] for place in changing): entry for name, entry in zip(spoken, entries, strict=True)}


def _number(entry: Path) -> int | None:
    return next((word for word in reversed(words(entry.stem)) if isinstance(word, int)), None)


def _members(folder: Path, coded: bool) -> list[Path]:
    """Pictures, or folders, by number."""
    try:
        entries = [entry for entry in folder.iterdir() if not entry.name.startswith(".")]
    except OSError as error:
        raise CaptureError(folder, f"cannot be read as a folder: {error.strerror or error}") from error
    if coded:
        found = [entry for entry in entries if entry.is_dir()]
    else:
        found = [entry for entry in entries if entry.suffix.lower() in SUFFIXES and entry.is_file()]
    if not found:
        what = "folders of pictures" if coded else "pictures: PNG, JPEG, BMP or TIFF files"
        raise CaptureError(folder, f"expected {what} of one camera, found none")
    return _sorted(found)


def _is_capture(folder: Path) -> bool:
    """Whether pictures lie in it, rather than folders of them."""
    return any(entry.suffix.lower() in SUFFIXES for entry in folder.iterdir())


def _sorted(entries: Iterable[Path]) -> list[Path]:
    return sorted(entries, key=lambda entry: (natural_key(entry.name), entry.name))


_SIDE_WORDS = frozenset((word,) for pair in SIDES for word in pair)
