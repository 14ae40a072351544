"""One picture of coloured lines decodes, however taken; a picture of anything else gives nothing, and says why."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from retrue.correspondences import Correspondences
from retrue.decoding.decode import decode
from retrue.decoding.recognise import what_it_shows
from retrue.errors import InputError
from retrue.files.images import read_image
from retrue.files.patterns import read_pattern
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.patterns.color_grid import ColorGrid, make_color_grid
from retrue.patterns.line_grid import LineGrid, Lines, make_line_grid
from retrue.rig import Rig
from retrue.simulation.camera_model import CameraModel
from retrue.simulation.scene import Rendered, Scene, render
from retrue.simulation.surfaces import Paint, Sphere, Wall

DATA = Path(__file__).parents[3] / "shared" / "data" / "line-grid"
MIXING = ((0.5, 0.1, 0), (0.1, 1, 0.1), (0, 0.16, 0.8))
WEBCAM = CameraModel(
    exposure=1.4, mixing=MIXING, blur_px=0.9, vignetting=0.3, electrons=3000, read_noise=8, gamma=2.2, bayer=True
)
GRID = make_line_grid((800, 600))
NOISE = np.random.default_rng(1).integers(0, 255, (120, 160, 3)).astype(np.uint8)
ORDER = np.random.default_rng(3).permutation(66)
OTHER = LineGrid(
    GRID.projector_size,
    replace(GRID.columns, sequence=tuple(np.array(GRID.columns.sequence)[ORDER].tolist())),
    replace(GRID.rows, sequence=tuple(np.array(GRID.rows.sequence)[ORDER].tolist())),
)


def picture(*, turn: float = 0.0, ball: bool = False, contrast: float = 0.0, model: CameraModel = WEBCAM) -> Rendered:
    camera = Camera((360, 300), [[820, 0, 179.5], [0, 820, 149.5], [0, 0, 1]], [0.05, -0.1, 0.001, 0, 0])
    projector = Camera((800, 600), [[1300, 0, 399.5], [0, 1300, 299.5], [0, 0, 1]])
    pose = RigidTransform.from_rotation_vector([0.0, 0.2, 0.0], [-300, 10, 60])
    rig = Rig(camera, projector, pose @ RigidTransform.from_rotation_vector([0, 0, turn], [0, 0, 0]))
    wall = Wall.facing(1500.0, (0.1, 0.3, 0.0), Paint(blob_size=90.0 if contrast else 0.0, contrast=contrast, seed=1))
    surfaces = [wall, Sphere(np.array([-40.0, 20.0, 1300.0]), 100.0)] if ball else [wall]
    return render(rig, Scene(surfaces), GRID.render(), model, seed=4, supersample=1, projector_blur_px=0.6)


def wrong_and_rms(points: Correspondences, truth: Rendered) -> tuple[int, float]:
    """Points half a line off or more, and the RMS of the others in camera pixels."""
    column, row = points.camera_px.astype(int).T
    at = truth.projector_px
    corners = [at[row + dy, column + dx] for dy in (0, 1) for dx in (0, 1)]
    fx, fy = (points.camera_px - np.stack([column, row], axis=-1)).T[:, :, None]
    there = (corners[0] * (1 - fx) + corners[1] * fx) * (1 - fy) + (corners[2] * (1 - fx) + corners[3] * fx) * fy
    off = points.projector_px - there
    wrong = ~(np.abs(off / [GRID.columns.pitch, GRID.rows.pitch]).max(axis=1) < 0.5)
    jacobian = np.stack([corners[1] - corners[0], corners[2] - corners[0]], axis=-1)[~wrong]
    error = np.linalg.solve(jacobian, off[~wrong, :, None])[..., 0]
    return int(wrong.sum()), float(np.sqrt(np.mean(error**2)))


@pytest.fixture(scope="module")
def usual() -> Rendered:
    return picture(ball=True)


@pytest.fixture(scope="module")
def decoded(usual: Rendered) -> Correspondences:
    return decode(GRID, usual.image)


def test_webcam(usual, decoded):
    points = decoded
    wrong, rms = wrong_and_rms(points, usual)
    assert len(points) > 1000
    assert wrong <= 0.003 * len(points)
    assert rms < 0.15
    assert points.card.counted == "crossings"
    assert points.card.advice == ()
    assert (points.camera_size, points.projector_size) == ((360, 300), (800, 600))


def test_points_carry_what_jobs_use(decoded):
    points = decoded
    row, column = points.cells.T
    assert np.array_equal(points.projector_px[:, 0], GRID.columns.middles()[column])
    assert np.array_equal(points.projector_px[:, 1], GRID.rows.middles()[row])
    assert np.array_equal(points.light_class, np.array(GRID.columns.sequence)[column])
    assert (points.light[np.isfinite(points.light)] >= 0).all()
    assert (points.camera_sigma_px > 0).all()


@pytest.mark.parametrize("turn", [0.7, np.pi / 2, np.pi])
def test_turned(turn):
    truth = picture(turn=turn)
    points = decode(GRID, truth.image)
    assert len(points) > 600
    assert wrong_and_rms(points, truth)[0] == 0


def test_print_and_noise():
    truth = picture(contrast=0.6, model=replace(WEBCAM, electrons=500))
    points = decode(GRID, truth.image)
    assert len(points) > 800
    assert wrong_and_rms(points, truth)[0] <= 0.003 * len(points)


def test_large_pictures_and_sixteen_bits(usual, decoded):
    large = cv2.resize(usual.image, None, fx=3, fy=3, interpolation=cv2.INTER_CUBIC).astype(np.uint16) * 257
    points = decode(GRID, large)
    assert len(points) > 0.95 * len(decoded)
    known = {tuple(cell): at for cell, at in zip(decoded.cells.tolist(), decoded.camera_px, strict=True)}
    pairs = [
        (at, known[tuple(c)])
        for c, at in zip(points.cells.tolist(), points.camera_px, strict=True)
        if tuple(c) in known
    ]
    ours, theirs = np.array(pairs).transpose(1, 0, 2)
    assert np.median(np.linalg.norm((ours + 0.5) / 3 - 0.5 - theirs, axis=1)) < 0.1


def test_mirrored_and_other_codes_give_nothing(usual):
    for grid, image in ((GRID, usual.image[:, ::-1]), (OTHER, usual.image)):
        points = decode(grid, image)
        assert len(points) == 0
        assert "not this pattern" in points.card.advice[0]


def test_blurred_away_gives_nothing_wrong():
    truth = picture(model=replace(WEBCAM, blur_px=2.5))
    points = decode(GRID, truth.image)
    assert not len(points) or wrong_and_rms(points, truth)[0] == 0


def test_other_kinds_of_grid_are_named(usual):
    blocks = make_color_grid((640, 480), 20, 26, seed=2)
    assert what_it_shows(usual.image) is LineGrid
    assert what_it_shows(blocks.render()) is ColorGrid
    (advice,) = decode(blocks, usual.image).card.advice
    assert advice.startswith("the picture shows a line grid, the pattern is a colour grid")
    (advice,) = decode(GRID, blocks.render()).card.advice
    assert advice.startswith("the picture shows a colour grid, the pattern is a line grid")


@pytest.mark.parametrize(("size", "rows", "columns"), [((640, 480), 20, 26), ((1024, 768), 40, 51)])
def test_blurred_blocks_are_no_lines(size, rows, columns):
    blocks = make_color_grid(size, rows, columns, seed=2).render() // 2 + 30
    for blur in (3, 5, 7, 9):
        assert what_it_shows(cv2.GaussianBlur(blocks, (0, 0), blur)) is not LineGrid


@pytest.mark.parametrize(
    ("image", "advice"),
    [
        (np.zeros((120, 160, 3), np.uint8), "too dark"),
        (np.full((120, 160, 3), 250, np.uint8), "overexposed"),
        (NOISE[..., :1].repeat(3, axis=2), "not a colour picture"),
        (NOISE, ""),
    ],
    ids=["dark", "bright", "grey", "noise"],
)
def test_nothing_there(image, advice):
    points = decode(GRID, image)
    assert len(points) == 0
    assert points.card.advice[0].startswith(advice)


def test_mistakes_are_named(usual):
    with pytest.raises(InputError, match="line grid: expected its picture"):
        decode(GRID, [usual.image] * 4)
    with pytest.raises(InputError, match="white: expected"):
        decode(GRID, [usual.image, usual.image, usual.image[1:]])


def test_three_colors_of_another_maker():
    colors = ((255, 0, 0), (0, 255, 0), (0, 0, 255))
    sequence = tuple(np.random.default_rng(5).integers(0, 3, 40).tolist())
    grid = LineGrid((480, 360), Lines(colors, sequence, 8, 11.5, 4), Lines(colors, sequence[::-1][:34], 6, 10, 3))
    points = decode(grid, cv2.GaussianBlur(grid.render(), (0, 0), 0.8))
    assert len(points) > 1100
    assert np.abs(points.camera_px - points.projector_px).max() < 0.5


@pytest.mark.skipif(not DATA.is_dir(), reason="shared/data/line-grid is absent")
@pytest.mark.parametrize(("name", "least"), [("01", 1100), ("05", 1030), ("08", 1150)])
def test_real_pictures(name, least):
    pattern = read_pattern(DATA / "pattern.png")
    points = decode(pattern, read_image(DATA / f"colorGrid{name}.png"))
    assert len(points) >= least
    F, _ = cv2.findFundamentalMat(points.camera_px, points.projector_px, cv2.FM_LMEDS)
    ours, theirs = (cv2.convertPointsToHomogeneous(p)[:, 0] for p in (points.camera_px, points.projector_px))
    line, back = ours @ F.T, theirs @ F
    norm = np.sqrt(np.sum(line[:, :2] ** 2, axis=1) + np.sum(back[:, :2] ** 2, axis=1))
    distance = np.sum(theirs * line, axis=1) / norm
    assert np.mean(np.abs(distance) < 3.0) > 0.997
    assert np.sqrt(np.median(distance**2)) < 0.3
    assert len(decode(pattern, read_image(DATA / f"lightGrid{name}.png"))) == 0
