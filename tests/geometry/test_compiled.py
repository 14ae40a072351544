"""The compiled kernels say what NumPy says, and leave to it what is not plainly well posed."""

from collections.abc import Iterator
from importlib.util import find_spec

import numpy as np
import pytest

from retrue.errors import DegenerateError, InputError
from retrue.geometry import compiled
from retrue.geometry.homography import apply_homography, fit_homography
from retrue.geometry.planar_pose import planar_pose_candidates, planar_pose_candidates_batch
from retrue.geometry.transform import rotation_from_vector

pytestmark = pytest.mark.skipif(find_spec("numba") is None, reason="Numba is not installed")


@pytest.fixture(autouse=True)
def kernels() -> Iterator[None]:
    before = compiled.planar_pose, compiled.homography
    compiled.load_kernels()
    yield
    compiled.planar_pose, compiled.homography = before


def without_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled, "planar_pose", None)
    monkeypatch.setattr(compiled, "homography", None)
    monkeypatch.setattr(compiled, "load_kernels", lambda: False)


def random_homographies(count: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    R = np.array([rotation_from_vector(w) for w in rng.normal(0, 0.5, (count, 3))])
    n = rng.normal([0, 0, 1], 0.4, (count, 3))
    return (R + rng.normal(0, 0.4, (count, 3, 1)) * n[:, None]) * rng.normal(0, 1, (count, 1, 1))


def test_poses_agree_with_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    stack = random_homographies(2000)
    mine = planar_pose_candidates_batch(stack)
    single = [[pose.R for pose in planar_pose_candidates(H)] for H in stack[:200]]
    without_kernels(monkeypatch)
    numpys = planar_pose_candidates_batch(stack)
    for name in ("R", "translation_over_distance", "normal"):
        assert np.abs(getattr(mine, name) - getattr(numpys, name)).max() < 1e-10
    assert np.array_equal(np.array(single), mine.R[:200])


@pytest.mark.parametrize("count", [4, 5, 8, 50, 400, 1000])
@pytest.mark.parametrize("sigmas", [(1.0, 1.0), (0.0, 1.0), (2.0, 0.0)])
def test_fits_agree_with_numpy(count: int, sigmas: tuple[float, float], monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(count)
    cases = []
    for H in random_homographies(20):
        x = rng.uniform(-0.4, 0.4, (count, 2)) * 1600 + 640
        y = apply_homography(H, (x - 640) / 1600) * 1400 + 500 + rng.normal(0, 0.3, (count, 2))
        cases.append((x, y, rng.uniform(0, 1, count) if count % 2 else None))

    def fits() -> np.ndarray:
        kinds = {"source_sigma": sigmas[0], "target_sigma": sigmas[1]}
        return np.array([fit_homography(x, y, weights=w, **kinds) for x, y, w in cases])

    mine = fits()
    without_kernels(monkeypatch)
    assert np.abs(mine - fits()).max() < 1e-10


def test_hopeless_input_is_refused_all_the_same() -> None:
    line = np.stack([np.arange(60.0), 2 * np.arange(60.0)], axis=1)
    three_of_four = np.array([[0, 0], [1, 1], [2, 2], [0, 1.0]])
    for points in (line, three_of_four, np.ones((5, 2))):
        with pytest.raises(DegenerateError):
            fit_homography(points, points)
    for bad in (line[:3], np.full((5, 2), np.nan), np.ones((5, 3))):
        with pytest.raises(InputError):
            fit_homography(bad, bad)
    for H in (np.zeros((3, 3)), np.eye(3), np.diag([1.0, 1.0, 0.0]), np.full((3, 3), np.nan)):
        with pytest.raises((DegenerateError, InputError)):
            planar_pose_candidates(H)
        assert np.isnan(planar_pose_candidates_batch(H[None]).R).all()


def test_kernels_come_in_with_many_homographies_only(monkeypatch: pytest.MonkeyPatch) -> None:
    without_kernels(monkeypatch)
    loaded: list[bool] = []
    monkeypatch.setattr(compiled, "load_kernels", lambda: loaded.append(True))
    monkeypatch.setattr(compiled, "_asked", 0)
    H = random_homographies(1)[0]
    for _ in range(compiled.LOAD_AFTER - 1):
        planar_pose_candidates(H)
    assert not loaded
    planar_pose_candidates(H)
    assert loaded == [True]
