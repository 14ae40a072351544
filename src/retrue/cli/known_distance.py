"""`--known-distance X1,Y1 X2,Y2 LENGTH` as one value."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, get_args

from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

from retrue.recalibration.options import KnownDistance

if TYPE_CHECKING:
    from retrue.geometry.arrays import FloatArray

registry = ConstructorRegistry()


def parse_known_distance(words: list[str]) -> KnownDistance:
    """From two camera pixels and a length.

    >>> parse_known_distance(["100,200", "300.5,220", "75"]).second_px.tolist()
    [300.5, 220.0]
    """
    try:
        length = float(words[2])
    except ValueError:
        raise ValueError(f"expected a length, found {words[2]}") from None
    return KnownDistance(_pixel(words[0]), _pixel(words[1]), length)


def _pixel(word: str) -> FloatArray:
    import numpy as np

    parts = word.split(",")
    try:
        x, y = (float(part) for part in parts)
    except ValueError:
        raise ValueError(f"expected a camera pixel X,Y, found {word}") from None
    return np.array([x, y])


@registry.primitive_rule
def known_distance_rule(
    type_info: PrimitiveTypeInfo,
) -> PrimitiveConstructorSpec[KnownDistance | None] | None:
    """Tells tyro to read a `KnownDistance | None` as three words, not as a subcommand."""
    if KnownDistance not in get_args(type_info.type):
        return None

    def is_instance(value: Any) -> bool:
        return value is None or isinstance(value, KnownDistance)

    def words(value: KnownDistance | None) -> list[str]:
        if value is None:
            return ["none"]
        return [f"{x:g},{y:g}" for x, y in (value.first_px, value.second_px)] + [f"{value.length:g}"]

    return PrimitiveConstructorSpec(
        nargs=3,
        metavar="X1,Y1 X2,Y2 LENGTH",
        instance_from_str=parse_known_distance,
        is_instance=is_instance,
        str_from_instance=words,
    )
