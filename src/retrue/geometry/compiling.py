"""How kernels are compiled: Numba, machine code kept on disk, NaN and division as in NumPy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numba as untyped_numba  # pyright: ignore

numba = cast("Any", untyped_numba)
Kernel = Callable[..., Any]


def _array(dimensions: int, readonly: bool) -> Any:
    return numba.types.Array(numba.float64, dimensions, "C", readonly=readonly)


VECTOR, MATRIX, STACK = _array(1, True), _array(2, True), _array(3, True)
OUT_VECTOR, OUT_MATRIX, OUT_STACK = _array(1, False), _array(2, False), _array(3, False)


def inlined(function: Kernel) -> Kernel:
    """Part of the kernels that call it."""
    return cast("Kernel", numba.njit(error_model="numpy", inline="always")(function))


def called(function: Kernel) -> Kernel:
    """The same of what several kernels call at several places: compiled once for each, so in less time."""
    return cast("Kernel", numba.njit(error_model="numpy")(function))


def compiled(signature: Any, **options: Any) -> Callable[[Kernel], Kernel]:
    """Compile for that signature, now; or read what an earlier run compiled.

    Numba keeps the machine code beside the source, or in the user's cache where that cannot be written; where neither
    can, it is compiled anew by each process.
    """

    def decorate(function: Kernel) -> Kernel:
        try:
            kernel = numba.njit(signature, cache=True, error_model="numpy", **options)(function)
        except RuntimeError:  # "cannot cache function ...: no locator available"
            kernel = numba.njit(signature, error_model="numpy", **options)(function)
        return cast("Kernel", kernel)

    return decorate
