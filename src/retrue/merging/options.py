"""What a merge can be told; apart from it, so that `--help` need not load NumPy."""

from __future__ import annotations

from dataclasses import dataclass

from retrue.ranges import check_ranges, ranged


@dataclass(frozen=True, slots=True)
class MergeOptions:
    """How several views become one object.

    Attributes
    ----------
    turntable
        Number of views in one full turn, evenly spaced and in order; 0 for views by hand.
    cell
        Size of the cells that views are thinned to before they are aligned, in their unit; from their size, unless
        given.
    least_overlap
        Two views are neighbours where at least this share of the smaller one lies on the other.
    most_contradicted
        And where no more than this share of either lies where the other saw through.
    keep_standing
        Keep also what stands still before the camera while the rest turns, such as a wall behind it.
    """

    turntable: int = ranged(0, 0, 720)
    cell: float | None = ranged(None, 0, above=True)
    least_overlap: float = ranged(0.25, 0, 1, above=True)
    most_contradicted: float = ranged(0.06, 0, 1)
    keep_standing: bool = False

    def __post_init__(self) -> None:
        check_ranges(self)
