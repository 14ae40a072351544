"""Scenes of known shape at several distances, the pictures that a rig takes of them, and where points truly lie."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from retrue.correspondences import Correspondences
from retrue.decoding.decode import decode
from retrue.geometry.arrays import BoolArray, FloatArray, Image
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.patterns.color_grid import ColorGrid, make_color_grid
from retrue.patterns.gray_code import GrayCode
from retrue.patterns.pattern import Pattern
from retrue.patterns.phase_shift import make_phase_shift
from retrue.rig import Rig
from retrue.simulation.camera_model import CameraModel, gaussian_blur
from retrue.simulation.light_transport import Light, LightTransport, blurred, find_transport
from retrue.simulation.scene import Scene, look, pixel_grid
from retrue.simulation.surfaces import Box, Paint, Sphere, Surface, Wall

PROJECTOR_SIZE = (1024, 768)
DISTANCES = (600.0, 900.0, 1300.0)  # mm
EDGE_PX = 6.0
"""Camera pixels from a jump of depth within which a point lies beside an edge."""
JUMP = 0.01  # of the depth
BLUR_PX = 0.6
FINE, FINER = 2, 4
"""Samples of the light a camera pixel, and parts of a projector pixel, along either side: lenses blur light before
pixels gather it, and a projector's are squares. With whole pixels the samples themselves beat with the stripes, by a
fiftieth of a pixel, more than all that a decoder errs by; so coarse ones do by a four hundredth, the finest by twice
that."""
PROJECTOR_BLUR_PX = 0.4
CAMERA = CameraModel(vignetting=0.1, blur_px=0.0, mixing=((0.94, 0.06, 0.0), (0.03, 0.94, 0.03), (0.0, 0.06, 0.94)))
"""Without noise; `take` blurs the light itself."""

PATTERNS: dict[str, Callable[[], Pattern]] = {
    "color grid": lambda: make_color_grid(PROJECTOR_SIZE),
    "gray code": lambda: GrayCode(PROJECTOR_SIZE),
    "sines": lambda: make_phase_shift(PROJECTOR_SIZE, 16.0, 4),
}


@dataclass(frozen=True, eq=False)
class Shot:
    """A capture of a scene, decoded.

    Attributes
    ----------
    rig : as it truly stands.
    points : as decoded.
    pictures : as taken: of a grid its picture, a black and a white one.
    distance : of the scene's middle.
    """

    rig: Rig
    scene: Scene
    pattern: Pattern
    pictures: list[Image]
    points: Correspondences
    distance: float


def make_rig(size: tuple[int, int]) -> Rig:
    """In mm, with lenses; its views meet at 900."""
    f = 1.15 * size[0]
    camera = Camera(
        size, [[f, 0, size[0] / 2 - 3.3], [0, f, size[1] / 2 + 2.1], [0, 0, 1]], [-0.08, 0.03, 2e-4, -3e-4, 0]
    )
    projector = Camera(PROJECTOR_SIZE, [[1500, 0, 520.0], [0, 1505, 400.0], [0, 0, 1]], [0.02, -0.02, 0, 1e-4, 0])
    pose = RigidTransform.from_rotation_vector([0.02, 0.24, -0.01], [-230.0, 12.0, 25.0])
    return Rig(camera, projector, pose, unit="mm")


def make_scene(rng: np.random.Generator, distance: float, paint: Paint | None = None) -> Scene:
    """A leaning wall, and before it balls and boxes."""
    w = distance / 1.15

    def place(z: float) -> FloatArray:
        return np.array([*(rng.uniform(-0.34, 0.34, 2) * [w, 0.75 * w]), distance * z])

    things: list[Surface] = [Wall.facing(1.12 * distance, rng.uniform(-0.25, 0.25, 3), paint or Paint())]
    for _ in range(3):
        things.append(Sphere(place(0.95), w * rng.uniform(0.06, 0.13), paint or Paint(tuple(rng.uniform(0.5, 0.9, 3)))))
        turn = RigidTransform.from_rotation_vector(rng.uniform(-0.8, 0.8, 3), place(0.95))
        half = tuple((w * rng.uniform(0.05, 0.11, 3)).tolist())
        things.append(Box(turn, half, paint or Paint(tuple(rng.uniform(0.5, 0.9, 3)))))
    return Scene(things, (0.04, 0.04, 0.04), bright_at=distance)


def take(
    rig: Rig,
    scene: Scene,
    pattern: Pattern,
    distance: float,
    seed: int,
    noise: float = 1.0,
    blur_px: float = BLUR_PX,
) -> Shot:
    """The pictures, with shot noise of `noise` times that of 10 000 electrons and vignetting, decoded."""
    transport = find_transport(_finer(rig), scene, FINER * PROJECTOR_BLUR_PX)
    grid = isinstance(pattern, ColorGrid)
    model = replace(CAMERA, electrons=10_000.0 / noise**2, read_noise=5.0)
    if grid:
        shown = [pattern.render(), *(np.full((*PROJECTOR_SIZE[::-1], 3), level, np.uint8) for level in (0, 255))]
    else:
        shown = [picture[..., None] for picture in pattern.render()]
    pictures: list[Image] = []
    for number, picture in enumerate(shown):
        light = gaussian_blur(_light(transport, picture), FINE * blur_px)
        height, width = light.shape[0] // FINE, light.shape[1] // FINE
        gathered = light.reshape(height, FINE, width, FINE, 3).mean(axis=(1, 3)).astype(np.float64)
        taken = model.picture(gathered, 1000 * seed + number)
        pictures.append(taken if grid else np.ascontiguousarray(taken[..., 1]))
    return Shot(rig, scene, pattern, pictures, decode(pattern, pictures[0] if grid else pictures), distance)


def _light(transport: LightTransport, shown: Image) -> Light:
    """Of a picture (h, w, channels), one or three, on a projector of FINER x FINER pixels for each."""
    lamp = shown.astype(np.float32) / np.float32(255)
    for axis in (0, 1):  # of stripes one line is blurred
        alike = (lamp == np.take(lamp, [0], axis=axis)).all()
        lamp = np.take(lamp, [0], axis=axis) if alike else np.repeat(lamp, FINER, axis=axis)
    lamp = np.broadcast_to(
        blurred(lamp, transport.blur_px), (FINER * shown.shape[0], FINER * shown.shape[1], shown.shape[2])
    )
    width, height = transport.size
    seen = transport.weights @ np.ascontiguousarray(lamp).reshape(-1, shown.shape[2])
    return (transport.gain * seen + transport.room).reshape(height, width, 3)


def _finer(rig: Rig) -> Rig:
    """The same with a camera of FINE x FINE pixels for each, and a projector of FINER x FINER."""
    return replace(rig, camera=_divided(rig.camera, FINE), projector=_divided(rig.projector, FINER))


def _divided(device: Camera, parts: int) -> Camera:
    width, height = device.size
    K = np.array(device.K)
    K[:2] *= parts
    K[:2, 2] += (parts - 1) / 2  # pixel centres lie at whole numbers
    return Camera((parts * width, parts * height), K, device.distortion)


def true_points(shot: Shot, camera_px: FloatArray) -> FloatArray:
    """(N, 3) of the surface that the rays of camera pixels meet; NaN where there is none."""
    depth = look(shot.rig, shot.scene, camera_px[None]).depth[0]
    rays = shot.rig.camera.unproject(camera_px)
    return np.column_stack([rays, np.ones(len(rays))]) * depth[:, None]


def true_points_of_projector(shot: Shot, projector_px: FloatArray) -> FloatArray:
    """(N, 3) of the first surface that the projector's rays meet, in the camera frame."""
    rays = shot.rig.projector.unproject(projector_px)
    back = shot.rig.projector_from_camera.inverse()
    direction = np.column_stack([rays, np.ones(len(rays))]) @ back.R.T
    nearest = np.full(len(rays), np.inf)
    for surface in shot.scene.surfaces:
        nearest = np.minimum(nearest, surface.distance(back.t, direction))
    return back.t + np.where(np.isfinite(nearest), nearest, np.nan)[:, None] * direction


def true_albedo(shot: Shot, camera_px: FloatArray) -> FloatArray:
    """(N, 3) of the paint that the rays of camera pixels meet, as the camera's channels mix it; NaN where none is."""
    seen = look(shot.rig, shot.scene, camera_px[None])
    rays = shot.rig.camera.unproject(camera_px)
    at = np.column_stack([rays, np.ones(len(rays))]) * seen.depth[0][:, None]
    found = np.full((len(camera_px), 3), np.nan)
    for index, surface in enumerate(shot.scene.surfaces):
        here = seen.surface[0] == index
        found[here] = surface.paint.albedo(at[here])
    return found @ np.array(CAMERA.mixing).T


def beside_edges(shot: Shot, camera_px: FloatArray) -> BoolArray:
    """(N,) within `EDGE_PX` of where depth jumps, light ends or surfaces meet."""
    from scipy import ndimage

    width, height = shot.rig.camera.size
    seen = look(shot.rig, shot.scene, pixel_grid(np.arange(height), np.arange(width)))
    jump = np.zeros((height, width), bool)
    for axis in (0, 1):
        depth = np.nan_to_num(seen.depth)
        step = np.abs(np.diff(depth, axis=axis)) > JUMP * np.minimum(*_pair(depth, axis))
        step |= np.diff(seen.visible.astype(int), axis=axis) != 0
        there = [slice(None), slice(None)]
        there[axis] = slice(None, -1)
        jump[tuple(there)] |= step
    far = ndimage.distance_transform_edt(~jump)
    column, row = np.clip(np.rint(camera_px).astype(int), 0, np.array([width, height]) - 1).T
    return far[row, column] < EDGE_PX


def _pair(values: FloatArray, axis: int) -> tuple[FloatArray, FloatArray]:
    return (values[:-1], values[1:]) if axis == 0 else (values[:, :-1], values[:, 1:])
