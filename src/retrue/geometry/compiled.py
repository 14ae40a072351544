"""Where many homographies are asked for, single solves and fits run as machine code (Numba).

Reading it costs about half a second, so nothing waits for it that is done in less: it comes in after the first
`LOAD_AFTER` homographies that a process asks a pose or a plain fit of, or where `load_kernels` is called. The answers
are the same to rounding.
"""

from __future__ import annotations

from importlib.util import find_spec
from types import ModuleType

LOAD_AFTER = 200

planar_pose: ModuleType | None = None
homography: ModuleType | None = None
_asked = 0


def load_kernels() -> bool:
    """Use compiled kernels from now on; False where Numba is not installed.

    The first time on a machine they are compiled, which takes some ten seconds.
    """
    global planar_pose, homography
    if find_spec("numba") is None:
        return False
    from retrue.geometry import homography_kernel, planar_pose_kernel

    planar_pose, homography = planar_pose_kernel, homography_kernel
    return True


def asked(homographies: int) -> None:
    """Count what the process asks for, and load the kernels once it is many."""
    global _asked
    before, _asked = _asked, _asked + homographies
    if before < LOAD_AFTER <= _asked:
        load_kernels()
