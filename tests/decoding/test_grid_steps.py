"""The steps of the colour-grid decoder that can be told apart: patches, growth's judge, noise."""

import cv2
import numpy as np
import pytest

from retrue.decoding.blocks.blobs import find_blocks
from retrue.decoding.blocks.centres import refine_centres
from retrue.decoding.blocks.growth import look_at
from retrue.decoding.surface import Joints, bends, median, noise_of
from retrue.geometry.nearest import nearest_of_all

PITCH, DUTY = 20.0, 0.6
U, V = np.array([[PITCH, 0.0]]), np.array([[0.0, PITCH]])


def blocks(*squares: tuple[float, float, float, float, tuple[int, int, int]]) -> np.ndarray:
    """A dark picture (60, 60, 3) with squares from (x, y) to (x, y), drawn to a tenth of a pixel."""
    fine = np.full((600, 600, 3), 20, np.uint8)
    for left, top, right, bottom, color in squares:
        fine[round(10 * top + 5) : round(10 * bottom + 5), round(10 * left + 5) : round(10 * right + 5)] = color
    return fine.reshape(60, 10, 60, 10, 3).mean(axis=(1, 3)).astype(np.uint8)


def seen(picture: np.ndarray, x: float, y: float):
    return look_at(picture, np.array([[x, y]], dtype=float), U, V, DUTY)


def test_a_block_is_found_where_it_is():
    found = seen(blocks((24, 24, 36, 36, (200, 30, 30))), 29.4, 30.6)
    assert np.allclose(found.offset * PITCH, [[0.6, -0.6]], atol=0.1)
    assert np.allclose(found.stretch, 0, atol=0.03)
    assert np.allclose(found.light, [[180, 10, 10]], atol=3)
    assert found.misfit()[0] < 0.5


def test_a_block_that_touches_another_colour_is_whole():
    found = seen(blocks((24, 24, 36, 36, (200, 30, 30)), (36, 22, 48, 38, (30, 30, 200))), 30, 30)
    assert np.allclose(found.offset * PITCH, 0, atol=0.15)
    assert found.misfit()[0] < 0.5


@pytest.mark.parametrize(
    "squares",
    [
        [],
        [(24, 24, 31, 36, (200, 30, 30))],
        [(24, 24, 36, 36, (200, 30, 30)), (24, 31, 36, 36, (30, 30, 200))],
        [(24, 24, 36, 30, (200, 30, 30)), (28, 30, 40, 36, (200, 30, 30))],
        [(24, 24, 36, 36, (200, 30, 30)), (36, 24, 48, 36, (200, 30, 30))],
        [(27, 27, 39, 39, (200, 30, 30))],
    ],
    ids=["nothing", "cut", "half another", "staggered", "no side", "elsewhere"],
)
def test_what_is_no_whole_block_does_not_fit(squares):
    assert not seen(blocks(*squares), 30, 30).misfit()[0] < 1.25


def test_a_patch_outside_the_picture_does_not_fit():
    picture = blocks((24, 24, 36, 36, (200, 30, 30)))
    for x, y in ((-500.0, 30.0), (1e9, -1e9)):
        assert not seen(picture, x, y).misfit()[0] < 1.25


def surface(noise: float, bend: float = 0.0) -> np.ndarray:
    row, column = np.mgrid[0:30, 0:40].astype(float)
    curved = np.stack([column * PITCH + bend * column**2, row * PITCH + bend * row * column], axis=-1)
    return curved + np.random.default_rng(3).normal(0, noise, curved.shape)


def joined(rows: int, columns: int) -> Joints:
    return Joints(np.ones((rows, columns - 1), bool), np.ones((rows - 1, columns), bool))


@pytest.mark.parametrize("bend", [0.0, 0.1])
def test_noise_is_told_apart_from_perspective(bend):
    sigma = noise_of(surface(0.06, bend), joined(30, 40))
    assert np.sqrt(np.mean(sigma**2)) == pytest.approx(0.06, rel=0.08)


def test_a_block_that_is_off_has_a_larger_sigma_than_the_others():
    position = surface(0.05)
    position[12, 20] += 0.6
    sigma = noise_of(position, joined(30, 40))
    assert sigma[12, 20] == sigma.max()
    assert sigma[12, 20] > 0.25
    assert np.median(sigma) < 0.06


def test_a_missing_block_has_no_sigma_and_spoils_none():
    position = surface(0.05)
    position[5, 5] = np.nan
    sigma = noise_of(position, joined(30, 40))
    assert np.isnan(sigma).sum() == 1
    assert np.isnan(sigma[5, 5])


@pytest.mark.parametrize("count", [1, 2, 7, 8])
def test_the_median_is_that_of_numpy(count: int) -> None:
    values = np.random.default_rng(count).normal(size=count)
    assert median(values) == np.median(values)


@pytest.mark.parametrize("spread", [(1.0, 1.0), (300.0, 0.01), (1.0, 0.0)])
def test_the_nearest_places_are_those_of_all_distances(spread: tuple[float, float]) -> None:
    rng = np.random.default_rng(5)
    places, points = rng.normal(size=(150, 2)) * spread, rng.normal(size=(80, 2)) * 3
    distance, index = nearest_of_all(places, points, 4)
    everything = np.linalg.norm(points[:, None] - places, axis=-1)
    np.testing.assert_allclose(distance, np.sort(everything, axis=1)[:, :4], rtol=1e-12)
    np.testing.assert_allclose(np.take_along_axis(everything, index, axis=1), distance, rtol=1e-12)


def test_a_blob_of_many_runs_has_the_moments_of_its_pixels() -> None:
    picture = np.zeros((60, 80, 3), np.uint8)
    y, x = np.mgrid[:60, :80]
    blob = np.hypot((x - 40.3) / 5.2 + (y - 29.6) / 9, (y - 29.6) / 4.4) < 1
    picture[blob] = 200
    found = find_blocks(picture)
    assert len(found) == 1
    at = np.stack([x[blob], y[blob]], axis=-1)
    np.testing.assert_allclose(found.centre[0], at.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(found.shape[0], np.cov(at.T, bias=True), rtol=1e-9)


def test_a_bent_surface_bends_everywhere_and_a_crease_nowhere():
    bent = surface(0.0, 0.1)
    found = bends(bent, joined(30, 40))
    assert np.allclose(found[..., 0, 0], 0.2)  # at the ends, too, as further inside
    creased = surface(0.0)
    creased[:, 21:, 0] += 0.3 * PITCH * np.arange(1, 20)
    assert np.allclose(bends(creased, joined(30, 40)), 0)


@pytest.mark.parametrize("fall", [0.0, 0.008])
def test_light_that_falls_off_moves_no_centre(fall):
    """Of each block, by that share of its light a pixel: four tenths from end to end of a block and its gap."""
    rows, columns, fine = 8, 10, 8
    size = np.array([rows, columns]) * int(PITCH)
    centre = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1) * PITCH + PITCH / 2 + 0.25
    y, x = ((np.mgrid[: size[0] * fine, : size[1] * fine] + 0.5) / fine - 0.5) - 0.25
    off = np.stack([x, y]) % PITCH - PITCH / 2
    lit = (np.abs(off) < DUTY * PITCH / 2).all(axis=0) * (1 - 2.5 * fall * off[0])
    light = lit.reshape(size[0], fine, size[1], fine).mean(axis=(1, 3))
    light = cv2.GaussianBlur(light, (0, 0), 0.8)
    picture = np.repeat((20 + 150 * light)[..., None], 3, axis=2).round().astype(np.uint8)
    found = refine_centres(picture, centre + 0.4, joined(rows, columns), DUTY).camera_px
    inside = (found - centre)[1:-1, 1:-1]
    assert np.abs(inside.mean(axis=(0, 1))).max() < 0.05  # a fit of whole profiles is .26 px off


@pytest.mark.parametrize("shape", [(1, 1), (2, 7), (9, 6)])
def test_a_bend_is_the_median_of_five_second_differences(shape):
    rng = np.random.default_rng(sum(shape))
    position = rng.normal(size=(*shape, 2))
    position[rng.random(shape) < 0.1] = np.nan
    rows, columns = shape
    joints = Joints(rng.random((rows, columns - 1)) < 0.85, rng.random((rows - 1, columns)) < 0.85)
    found = bends(position, joints)
    for line, places, linked in (
        (0, position, joints.right),
        (1, position.swapaxes(0, 1), joints.down.T),
    ):
        for r, c in np.ndindex(places.shape[:2]):
            near = [
                k
                for k in range(max(c - 2, 1), min(c + 3, places.shape[1] - 1))
                if linked[r, min(c, k) : max(c, k)].all()
            ]
            told = [np.diff(places[r, k - 1 : k + 2], 2, axis=0)[0] for k in near if linked[r, k - 1 : k + 1].all()]
            told = [bend for bend in told if np.isfinite(bend).all()]
            own = found[r, c, 0] if line == 0 else found[c, r, 1]
            np.testing.assert_allclose(own, np.median(told, axis=0) if told else [0, 0], atol=1e-12)
