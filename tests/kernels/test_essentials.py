"""Five matches: the kernel says what it says uncompiled; each sample's solutions are those it has alone."""

import numpy as np

from retrue.geometry.five_points import MONOMIALS, MOST_SOLUTIONS, five_point_essentials
from retrue.kernels import essentials
from tests.kernels.plain import plain


def test_compiled_and_plain_solutions_agree() -> None:
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-0.4, 0.4, (2, 30, 2))
    samples = rng.integers(0, 30, (8, 5))
    found = np.empty((2, MOST_SOLUTIONS * 8, 3, 3))
    counts = [
        kernel.essentials(x, y, samples, *MONOMIALS, room)
        for kernel, room in zip((essentials, plain("essentials")), found, strict=True)
    ]
    assert counts[0] == counts[1] > 8
    np.testing.assert_array_equal(found[0, : counts[0]], found[1, : counts[0]])
    alone = np.concatenate([five_point_essentials(x, y, sample[None]) for sample in samples])
    np.testing.assert_array_equal(found[0, : counts[0]], alone)
