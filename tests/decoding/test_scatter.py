"""How far planes scatter beside what their own edges say."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from retrue.decoding.decode import decode
from retrue.decoding.gray import stripe_edges
from retrue.decoding.gray.scatter import scatter_level
from retrue.patterns.gray_code import GrayCode

SHAPE = (301, 250)
OWN = np.float32(0.01)


def noise(seed: int) -> np.ndarray:
    """Of planes whose windows overlap, with a standard deviation of `OWN`."""
    smooth = ndimage.gaussian_filter(np.random.default_rng(seed).normal(size=SHAPE), 1.25)
    return OWN * smooth / smooth.std()


@pytest.mark.parametrize("shape", ["flat", "ball"])
def test_the_scatter_is_that_of_each_place(shape: str) -> None:
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    louder = np.where(x < 125, 1.0, 3.0)
    bent = 0.002 * ((x - 100.0) ** 2 + (y - 150.0) ** 2) * (shape == "ball")
    value = (0.7 * x + 0.1 * y + bent + louder * noise(1)).astype(np.float32)
    level = scatter_level(value, np.full(SHAPE, OWN**2), np.ones(SHAPE, np.uint8))
    assert level.shape == SHAPE
    for part, expected in ((level[:, 20:105], 1.0), (level[:, 145:-20], 9.0)):
        assert np.mean(part) == pytest.approx(expected, rel=0.2)


def test_where_few_tell_planes_are_believed() -> None:
    value, own = (5 * noise(2)).astype(np.float32), np.full(SHAPE, OWN**2)
    whole = np.zeros(SHAPE, np.uint8)
    whole[96:112, 100:110] = 1
    level = scatter_level(value, own, whole)
    assert (level[:60] == 1).all()
    assert 1 < level[104, 105] < scatter_level(value, own, np.ones(SHAPE, np.uint8))[96:112, 100:110].max()
    assert (scatter_level(value[:9, :9], own[:9, :9], whole[96:105, 100:109]) == 1).all()


def test_a_fold_is_no_scatter(shooting, monkeypatch: pytest.MonkeyPatch) -> None:
    def roof(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return 4.2 + 0.5 * x + 0.12 * np.abs(x - 120.0) + 0.02 * y, 3.3 - 0.003 * x + 0.6 * y

    shot = shooting(GrayCode((256, 192)), mapping=roof)

    def louder() -> float:
        """Sigma of x some windows from the fold, over that far away."""
        points = decode(shot.pattern, shot.pictures)
        ratio = points.projector_sigma_ratio
        sigma = points.projector_sigma_px * ratio * np.sqrt(2 / (1 + ratio**2))
        off = np.abs(points.camera_px[:, 0] - 120.0)
        return float(np.median(sigma[(off > 12) & (off < 24)]) / np.median(sigma[(off > 60) & (off < 100)]))

    apart = louder()
    monkeypatch.setattr(stripe_edges, "FOLDED", np.inf)
    assert apart < 1.3
    assert louder() > 1.5 * apart
