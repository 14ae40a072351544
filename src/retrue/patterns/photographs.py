"""Two photographs of one scene by two cameras: no pattern is shown, the scene's own texture is the code."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from retrue.errors import InputError
from retrue.geometry.arrays import FloatArray, Image, finite_array, frozen_array
from retrue.ranges import check_ranges, ranged
from retrue.shown import ShortRepr, Shown, counted
from retrue.values import ByValue


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Matches(ByValue, ShortRepr):
    """What a matcher found: N places, each in both photographs.

    Attributes
    ----------
    left_px, right_px : (N, 2) pixels (x, y); (0, 0) is the centre of the top-left one.
    confidence : (N,) in 0 .. 1, larger is surer.
    size : (N, 2) px, how large the feature is in each photograph; None where the matcher has no such thing.
    turn : (N,) radians by which the feature is turned from left to right, x towards y; None likewise.
    sigma_px : standard deviation per axis of a match that cannot be aligned any better; None: such are left out.
    """

    left_px: FloatArray
    right_px: FloatArray
    confidence: FloatArray
    size: FloatArray | None = None
    turn: FloatArray | None = None
    sigma_px: float | None = None

    def __post_init__(self) -> None:
        count = len(finite_array(self.left_px, (None, 2), "left_px"))
        for name, row in (("left_px", (2,)), ("right_px", (2,)), ("confidence", ()), ("size", (2,)), ("turn", ())):
            value = getattr(self, name)
            if value is not None:
                array = finite_array(value, (None, *row), name)
                if len(array) != count:
                    raise InputError(f"{name}: expected {count} rows as in left_px, found {len(array)}")
                object.__setattr__(self, name, frozen_array(array))

    def __len__(self) -> int:
        return len(self.left_px)

    def _shown(self) -> Shown:
        return counted(len(self), "place"), {}


class Matcher(Protocol):
    """Anything that matches two photographs."""

    def match(self, left: Image, right: Image) -> Matches:
        """Places that both photographs (h, w), grey, uint8, show; they may be of different sizes."""
        ...


@dataclass(frozen=True, slots=True)
class Photographs:
    """What is asked of a pair of photographs; `PHOTOGRAPHS` asks the usual.

    Attributes
    ----------
    matcher : who matches them; None: scale-invariant features of gradients, `match_sift`.
    ratio : a match must be nearer than the second best by this factor (Lowe 2004, section 7.1).
    most_features : the strongest of each photograph that are compared.
    most_points : kept, spread over the picture.
    min_likeness : share of a patch's contrast that its partner must explain.
    """

    matcher: Matcher | None = None
    ratio: float = ranged(0.8, 0, 1, above=True)
    most_features: int = ranged(4000, 16, 50_000)
    most_points: int = ranged(2000, 16)
    min_likeness: float = ranged(0.65, 0, 1)

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.matcher is not None and not callable(getattr(self.matcher, "match", None)):
            raise InputError(f"matcher: expected one with match(left, right), found {type(self.matcher).__name__}")


PHOTOGRAPHS = Photographs()
