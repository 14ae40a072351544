"""One picture decodes, however it was taken; a picture of anything else gives nothing, and says why."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from retrue.correspondences import Correspondences
from retrue.decoding.blocks.decode_color_grid import decode_color_grid
from retrue.errors import InputError
from retrue.files.patterns import read_pattern
from retrue.files.rigs import read_rig
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.patterns.color_grid import PAPER_COLORS, ColorGrid, make_color_grid
from retrue.rig import Rig
from retrue.simulation.camera_model import CameraModel
from retrue.simulation.scene import Rendered, Scene, render
from retrue.simulation.surfaces import Box, Paint, Sphere, Wall

RENDERS = Path(__file__).parents[1] / "data" / "renders"
GRID = make_color_grid((640, 480), 20, 26, seed=2)
MIXING = ((0.75, 0.12, 0.05), (0.10, 0.85, 0.16), (0.03, 0.20, 0.80))
HARD_CAMERA = CameraModel(
    exposure=0.8, mixing=MIXING, blur_px=0.8, vignetting=0.3, electrons=5000, read_noise=5, gamma=2.2, bayer=True
)


def rig(roll_deg: float = 0.0, focal: float = 560.0) -> Rig:
    camera = Camera((480, 360), [[focal, 0, 239.5], [0, focal, 179.5], [0, 0, 1]], [-0.1, 0.03, 0.001, 0, 0])
    projector = Camera((640, 480), [[1000, 0, 319.5], [0, 1000, 300.0], [0, 0, 1]])
    pose = RigidTransform.from_rotation_vector([0.02, 0.2, 0.02], [-300, 10, 20])
    return Rig(camera, projector, pose @ rolled(roll_deg))


def rolled(roll_deg: float) -> RigidTransform:
    return RigidTransform.from_rotation_vector([0, 0, np.radians(roll_deg)], [0, 0, 0])


def wall(roll_deg: float = 0.0, tilt=(0.1, 0.2, 0.0), paint: Paint | None = None) -> Wall:
    pose = rolled(roll_deg).inverse() @ RigidTransform.from_rotation_vector(tilt, [0, 0, 1500])
    return Wall(pose, paint=paint or Paint())


def picture(
    scene: Scene, *, roll_deg: float = 0.0, grid: ColorGrid = GRID, model: CameraModel = HARD_CAMERA
) -> Rendered:
    return render(rig(roll_deg), scene, grid.render(), model, seed=5)


def errors(points: Correspondences, truth: Rendered) -> tuple[np.ndarray, np.ndarray]:
    """Distance of each point from its true place, in projector and, by the local scale, in camera pixels."""
    x, y = points.camera_px.T
    column, row = (
        np.clip(x.astype(int), 0, truth.depth.shape[1] - 2),
        np.clip(y.astype(int), 0, truth.depth.shape[0] - 2),
    )
    fx, fy = (x - column)[:, None], (y - row)[:, None]
    at = truth.projector_px
    there = (at[row, column] * (1 - fx) + at[row, column + 1] * fx) * (1 - fy) + (
        at[row + 1, column] * (1 - fx) + at[row + 1, column + 1] * fx
    ) * fy
    scale = np.linalg.norm(at[row, column + 1] - at[row, column], axis=-1)
    in_projector = np.linalg.norm(there - points.projector_px, axis=-1)
    return in_projector, in_projector / scale


def blocks_in_view(truth: Rendered) -> int:
    """Blocks whose centre is seen at least half a block inside the picture."""
    cell = (truth.projector_px - GRID.origin)[6:-6, 6:-6] / GRID.pitch
    near = np.abs(cell - np.round(cell)).max(axis=-1) < 0.1
    row, column = np.round(cell[near][:, ::-1]).astype(int).T
    on_grid = (row >= 0) & (row < len(GRID.code)) & (column >= 0) & (column < len(GRID.code[0]))
    return len(set(zip(row[on_grid], column[on_grid], strict=True)))


@pytest.mark.parametrize("roll_deg", [0, 33, 90, 135, 180, 251, 300])
def test_any_roll_decodes_to_a_tenth_of_a_pixel(roll_deg):
    truth = picture(Scene([wall(roll_deg)]), roll_deg=roll_deg)
    points = decode_color_grid(GRID, truth.image)
    _, camera_error = errors(points, truth)
    assert len(points) > 0.98 * blocks_in_view(truth)
    assert np.sqrt(np.mean(camera_error**2)) < 0.12
    assert camera_error.max() < 0.5


def test_objects_in_front_give_no_wrong_point():
    scene = Scene(
        [
            wall(),
            Sphere(np.array([-60.0, 20.0, 1250.0]), 110.0, Paint((0.5, 0.6, 0.8))),
            Box(RigidTransform.from_rotation_vector([0.2, 0.5, 0.3], [150, -20, 1250]), (130, 140, 60)),
        ]
    )
    truth = picture(scene)
    points = decode_color_grid(GRID, truth.image)
    projector_error, _ = errors(points, truth)
    assert len(points) > 300
    surfaces = truth.surface[tuple(np.round(points.camera_px[:, ::-1]).astype(int).T)]
    assert set(surfaces) == {0, 1, 2}
    assert np.mean(projector_error < 0.1 * GRID.pitch) > 0.98
    assert projector_error.max() < 0.5 * GRID.pitch


def test_a_small_face_decodes_from_what_is_left_of_the_code():
    face = Box(RigidTransform.from_rotation_vector([0.0, 0.1, 0.0], [40, 10, 1150]), (64, 50, 10))
    truth = picture(Scene([wall(), face]))
    points = decode_color_grid(GRID, truth.image)
    projector_error, _ = errors(points, truth)
    surfaces = truth.surface[tuple(np.round(points.camera_px[:, ::-1]).astype(int).T)]
    assert 9 <= (surfaces == 1).sum() < 25  # fewer than the windows alone could be sure of
    assert projector_error.max() < 0.5 * GRID.pitch


def test_each_sigma_is_that_of_its_point():
    scene = Scene([wall(paint=Paint(blob_size=60.0, contrast=0.6, seed=3))])
    truth = picture(scene)
    points = decode_color_grid(GRID, truth.image)
    _, camera_error = errors(points, truth)
    assert points.camera_sigma_px is not None
    assert 0.7 < np.sqrt(np.mean((camera_error / points.camera_sigma_px) ** 2) / 2) < 1.4
    order = np.argsort(points.camera_sigma_px)
    surest, others = np.split(camera_error[order], [len(order) * 3 // 4])
    assert np.sqrt(np.mean(others**2)) > 1.5 * np.sqrt(np.mean(surest**2))


@pytest.mark.parametrize(
    ("scene", "model"),
    [
        (Scene([wall(paint=Paint(blob_size=150.0, contrast=0.5, seed=3))]), HARD_CAMERA),
        (Scene([wall()], ambient=(0.5, 0.45, 0.3)), CameraModel(exposure=0.5, electrons=4000, gamma=2.2)),
        (Scene([wall()]), CameraModel(exposure=0.05, electrons=4000, read_noise=5)),
        (Scene([wall()]), CameraModel(exposure=0.6, mixing=((0.5, 0.2, 0.1), (0.2, 0.7, 0.3), (0.1, 0.4, 0.6)))),
        (Scene([wall(tilt=(0.0, 1.0, 0.0))]), HARD_CAMERA),
    ],
    ids=["print", "lit room", "dark, linear", "channels mixed", "tilted"],
)
def test_hard_pictures_decode_without_a_wrong_point(scene, model):
    truth = picture(scene, model=model)
    points = decode_color_grid(GRID, truth.image)
    projector_error, _ = errors(points, truth)
    seen = GRID.centres().reshape(-1, 2)
    assert len(points) > 0.85 * len(seen)
    assert projector_error.max() < 0.5 * GRID.pitch


@pytest.mark.parametrize("colors", [PAPER_COLORS[:4], PAPER_COLORS[:5], PAPER_COLORS])
@pytest.mark.parametrize("block", [10, 16])
def test_other_specs_decode(colors, block):
    grid = make_color_grid((640, 480), 14, 18, colors=colors, pitch=24, block=block, seed=8)
    truth = picture(Scene([wall()]), grid=grid)
    points = decode_color_grid(grid, truth.image)
    projector_error, _ = errors(points, truth)
    assert len(points) > 0.97 * 14 * 18
    assert projector_error.max() < 2.0


def test_part_of_the_grid_is_enough(plain):
    part = plain[100:250, 150:330]
    points = decode_color_grid(GRID, part)
    whole = decode_color_grid(GRID, plain)
    assert len(points) > 50
    places = {tuple(cell): place for cell, place in zip(whole.cells, whole.camera_px, strict=True)}
    for cell, place in zip(points.cells, points.camera_px, strict=True):
        assert np.linalg.norm(places[tuple(cell)] - place - [150, 100]) < 0.6


def test_sixteen_bits_and_a_black_and_a_white_picture_are_taken():
    scene = Scene([wall(paint=Paint(blob_size=150.0, contrast=0.6, seed=3))], ambient=(0.2, 0.2, 0.2))
    model = CameraModel(exposure=0.6, electrons=20000)
    lit, dark, full = (
        render(rig(), scene, shown, model, seed=n).image.astype(np.uint16) * 16
        for n, shown in enumerate(
            (GRID.render(), np.zeros((480, 640, 3), np.uint8), np.full((480, 640, 3), 255, np.uint8))
        )
    )
    alone = decode_color_grid(GRID, lit)
    helped = decode_color_grid(GRID, lit, dark, full)
    assert len(helped) >= len(alone) > 400


TILT = (0.1, 0.7, 0.0)


def lit(model: CameraModel, shown=None) -> np.ndarray:
    """A bare wall, under light that falls off."""
    shown = GRID.render() if shown is None else shown
    return render(rig(), Scene([wall(tilt=TILT)], bright_at=1500.0), shown, model, seed=5).image


def irradiance(points: Correspondences) -> np.ndarray:
    """Of a white projector on that wall, up to a factor: cos(theta) / distance^2."""
    plane, pose = RigidTransform.from_rotation_vector(TILT, [0, 0, 1500]), rig().projector_from_camera
    normal = plane.R[:, 2]
    rays = np.column_stack([rig().camera.unproject(points.camera_px), np.ones(len(points))])
    beam = rays * (normal @ plane.t / (rays @ normal))[:, None] - pose.inverse().t
    return np.abs(beam @ normal) / np.linalg.norm(beam, axis=1) ** 3


def scatter_of_light(points: Correspondences, expected) -> float:
    """Robust scatter of the logarithm of light over `expected`, within a class."""
    ratio = np.log(points.light / expected)
    classes = np.zeros(len(points), int) if points.light_class is None else points.light_class
    middle = np.array([np.nanmedian(ratio[classes == k]) if (classes == k).any() else 0.0 for k in range(7)])
    return float(1.48 * np.nanmedian(np.abs(ratio - middle[classes])))


def test_light_is_what_the_projector_adds_by_colour():
    points = decode_color_grid(GRID, lit(CameraModel(exposure=0.6, mixing=MIXING, electrons=50000)))
    assert (points.camera_size, points.projector_size) == ((480, 360), (640, 480))
    assert np.array_equal(points.light_class, np.asarray(GRID.code)[points.cells[:, 0], points.cells[:, 1]])
    assert np.isfinite(points.light).mean() > 0.99
    assert scatter_of_light(points, irradiance(points)) < 0.04
    assert scatter_of_light(points, 1.0) > 0.15


def test_light_is_not_known_where_the_picture_is_saturated():
    picture = lit(CameraModel(exposure=1.2))
    points = decode_color_grid(GRID, picture)
    x, y = np.round(points.camera_px).astype(int).T
    full = picture[y, x].max(axis=-1) == 255
    assert 0.1 < full.mean() < 0.9
    assert np.isnan(points.light[full]).all()
    assert np.isfinite(points.light[~full]).mean() > 0.9


def test_a_white_and_a_black_picture_tell_the_light_of_all_colours():
    model = CameraModel(exposure=0.6)
    grid, black, white = (lit(model, shown) for shown in (None, GRID.render() * 0, GRID.render() * 0 + 255))
    points = decode_color_grid(GRID, grid, black, white)
    assert points.light_class is None
    assert scatter_of_light(points, irradiance(points)) < 0.01
    assert points.colors is not None
    column, row = points.camera_px.round().astype(int).T
    apart = points.colors.astype(int) - white[row, column]  # true colours, and not those of the pattern
    assert np.percentile(np.abs(apart), 95) <= 6
    without = decode_color_grid(GRID, grid, white=white)
    assert (without.light, without.light_class) == (None, None)


def test_every_point_comes_with_its_columns(plain):
    points = decode_color_grid(GRID, plain)
    assert points.cells is not None
    assert points.camera_sigma_px is not None
    assert points.confidence is not None
    row, column = points.cells.T
    assert np.allclose(points.projector_px, GRID.centres()[row, column])
    assert (points.camera_sigma_px > 0).all()
    assert ((points.confidence >= 0) & (points.confidence <= 1)).all()
    assert len(np.unique(row * 1000 + column)) == len(points)
    card = points.card
    assert card.decoded == len(points)
    assert card.seen == len(points) + sum(card.rejected.values())
    assert 0.1 < card.coverage < 1.0
    assert 6 < card.details["block_px"] < 12
    assert card.advice == ()


@pytest.fixture(scope="module")
def plain() -> np.ndarray:
    return picture(Scene([wall()])).image


def noise(shape: tuple[int, ...]) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, shape).astype(np.uint8)


def line_grid(shape: tuple[int, ...]) -> np.ndarray:
    """Coloured lines across and down on black, a little blurred."""
    image = np.zeros(shape, np.uint8)
    colors = np.random.default_rng(0).choice([0, 255], (200, 3)) | np.array([0, 120, 0])
    for index, start in enumerate(range(5, max(shape) - 6, 14)):
        image[start : start + 4] = np.maximum(image[start : start + 4], colors[index % 200])
        image[:, start : start + 4] = np.maximum(image[:, start : start + 4], colors[-index % 200])
    return cv2.GaussianBlur(image, (0, 0), 1)


@pytest.mark.parametrize(
    ("spoil", "advice"),
    [
        (lambda image: image[:, ::-1], "mirrored"),
        (lambda image: image[::-1], "mirrored"),
        (lambda image: image[..., ::-1], "not this pattern"),
        (lambda image: image.max(axis=2), "not a colour picture"),
        (lambda image: np.repeat(image[..., :1], 3, axis=2), "not a colour picture"),
        (lambda image: image * 0, "too dark"),
        (lambda image: image // 60, "too dark"),
        (lambda image: np.full_like(image, 255), "overexposed"),
        (lambda image: cv2.GaussianBlur(image, (0, 0), 8), "focus"),
        (lambda image: cv2.resize(image, None, fx=0.2, fy=0.2, interpolation=cv2.INTER_AREA), "5 px"),
        (lambda image: noise(image.shape), "no grid"),
        (lambda image: image[:4, :6], "no grid"),
        (lambda image: line_grid(image.shape), "a grid of lines"),
    ],
    ids=["mirror", "flip", "bgr", "grey", "one", "black", "dark", "white", "blur", "small", "noise", "tiny", "lines"],
)
def test_anything_else_gives_nothing_and_says_why(plain, spoil, advice):
    points = decode_color_grid(GRID, np.ascontiguousarray(spoil(plain)))
    assert len(points) == 0
    assert advice in "".join(points.card.advice)


def test_another_grid_gives_nothing(plain):
    for seed in (5, 6):
        points = decode_color_grid(make_color_grid((640, 480), 20, 26, seed=seed), plain)
        assert len(points) == 0
        assert "not this pattern" in "".join(points.card.advice)


@pytest.mark.parametrize(
    "image", [np.zeros((4, 4, 3)), np.zeros((4, 4, 2), np.uint8), np.zeros(5, np.uint8), np.zeros((0, 4, 3), np.uint8)]
)
def test_what_is_no_picture_is_refused(image):
    with pytest.raises(InputError, match="image: expected"):
        decode_color_grid(GRID, image)


def test_a_black_picture_of_another_size_is_refused(plain):
    with pytest.raises(InputError, match="black: expected"):
        decode_color_grid(GRID, plain, black=plain[:10])


@pytest.mark.parametrize("name", ["wall", "corner", "wall_objects", "textured_wall", "dim"])
@pytest.mark.parametrize("kind", ["png", "jpg"])
def test_physically_based_renders_decode(name, kind):
    grid = read_pattern(RENDERS / "pattern.json")
    true = read_rig(RENDERS / f"{name}_0.rig.json")
    depth = cv2.imread(str(RENDERS / f"{name}_0.depth.png"), cv2.IMREAD_UNCHANGED) / 1e4
    points = decode_color_grid(grid, cv2.imread(str(RENDERS / f"{name}_0.{kind}"))[..., ::-1])
    column, row = np.round(points.camera_px).astype(int).T
    rays = np.column_stack([true.camera.unproject(np.stack([column, row], axis=-1)), np.ones(len(points))])
    there = true.projector.project(true.projector_from_camera.apply(rays * depth[row, column][:, None]))
    assert len(points) > 1750
    assert (np.abs(there - points.projector_px).max(axis=1) < 0.5 * grid.pitch).all()
