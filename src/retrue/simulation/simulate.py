"""A capture that never happened: every picture that the camera takes while the pattern is shown, and the truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from retrue.errors import InputError, require_kind
from retrue.geometry.arrays import FloatArray, Image
from retrue.patterns.color_grid import ColorGrid
from retrue.patterns.gray_code import GrayCode
from retrue.patterns.line_grid import LineGrid
from retrue.patterns.pattern import PATTERNS, Pattern
from retrue.patterns.sequence import FrameSequence
from retrue.rig import Rig, require_rig
from retrue.shown import ShortRepr, Shown, counted
from retrue.simulation.built_in_scenes import SCENES, built_in_scene, meeting_distance
from retrue.simulation.camera_model import CameraModel
from retrue.simulation.mitsuba_check import require_true_dots
from retrue.simulation.mitsuba_scene import Item, MeshFile, shapes
from retrue.simulation.mitsuba_stage import Stage
from retrue.simulation.mitsuba_truth import Truth, find_truth
from retrue.simulation.mitsuba_views import blurred_raster
from retrue.simulation.options import SimulateOptions
from retrue.values import ByValue

GRAY_POINTS_EVERY = 16  # projector pixels, of a Gray code's true correspondences

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Simulated(ByValue, ShortRepr):
    """What `simulate` made.

    Attributes
    ----------
    pictures : what the camera took, by name: (h, w, 3) of a grid, (h, w) of a Gray code; uint8.
    truth : depth, visibility and true correspondences: of block centres, or of every 16th projector pixel.
    dot_errors_px : of the self-check, by device.
    """

    pictures: Mapping[str, Image]
    truth: Truth
    dot_errors_px: Mapping[str, float]

    def _shown(self) -> Shown:
        height, width = self.truth.depth.shape
        title = f"{counted(len(self.pictures), 'picture')} of {width} x {height} px"
        return title, {"truth": f"depth, and {counted(len(self.truth.camera_px), 'point')} of the pattern"}


def simulate(
    rig: Rig,
    scene: str | MeshFile,
    pattern: Pattern,
    options: SimulateOptions | None = None,
    progress: Progress | None = None,
) -> Simulated:
    """Take the pictures of one capture with a path tracer, Mitsuba 3.

    Parameters
    ----------
    scene : a name of `SCENES`, or a mesh in the camera's frame.
    pattern : a colour or line grid gives `capture`, `white` and `black`; a Gray code or another sequence its pictures,
        grey.
    progress : called with the number of renders done and in all.

    Raises
    ------
    InputError
        no Mitsuba, no such scene, a pattern for another projector, devices that see nothing together, or
        rendered dots that miss their place by more than 0.05 px.
    """
    require_rig(rig)
    require_kind(pattern, PATTERNS, "pattern", "retrue.read_pattern reads one")
    options = SimulateOptions() if options is None else options
    require_kind(options, SimulateOptions, "options")
    if pattern.projector_size != rig.projector.size:
        raise InputError(
            "simulate: expected a pattern for the rig's projector, {} x {}, found one for {} x {}".format(
                *rig.projector.size, *pattern.projector_size
            )
        )
    distance = options.distance or meeting_distance(rig)
    monochrome = not isinstance(pattern, ColorGrid | LineGrid)
    stage = Stage(rig, shapes(_items(scene, rig, distance), monochrome), distance, options.samples, options.bounces)
    rasters = _grid_rasters(pattern) if isinstance(pattern, ColorGrid | LineGrid) else _grey_rasters(pattern)
    steps = len(rasters) + 3
    done = 0

    def step() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, steps)

    errors = require_true_dots(stage)
    step()
    truth = find_truth(stage, _asked_points(pattern))
    step()
    light_seed, *noise_seeds = np.random.SeedSequence(options.seed).generate_state(1 + 3 * len(rasters)).tolist()
    room = stage.room(options.ambient, light_seed)
    step()
    lights: list[FloatArray] = []
    for raster in rasters:  # along the same paths each time, so that pattern and inverse add up to white
        lights.append(stage.projected(blurred_raster(raster, options.projector_blur_px), light_seed))
        step()
    camera_model = _camera_model(options, monochrome)
    if not isinstance(pattern, ColorGrid | LineGrid):
        pictures = _grey_pictures(pattern, lights, room, camera_model, noise_seeds)
    else:
        light = {"capture": lights[0] + room, "white": lights[1] + room, "black": room}
        pictures = {
            name: camera_model.picture(light[name], seed) for name, seed in zip(light, noise_seeds, strict=False)
        }
    return Simulated(pictures, truth, errors)


def _items(scene: str | MeshFile, rig: Rig, distance: float) -> tuple[Item, ...]:
    if isinstance(scene, MeshFile):
        return (scene,)
    if scene not in SCENES:
        raise InputError(f"simulate: expected a scene of {', '.join(SCENES)}, or a .ply or .obj file, found {scene}")
    return built_in_scene(scene, rig, distance)


def _asked_points(pattern: Pattern) -> FloatArray:
    if isinstance(pattern, ColorGrid):
        return pattern.centres().reshape(-1, 2)
    x, y = (np.arange(GRAY_POINTS_EVERY // 2, side, GRAY_POINTS_EVERY) for side in pattern.projector_size)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2).astype(np.float64)


def _grid_rasters(pattern: ColorGrid | LineGrid) -> list[FloatArray]:
    shown = pattern.render() / 255.0
    return [shown, np.ones_like(shown)]


def _grey_rasters(pattern: GrayCode | FrameSequence) -> list[FloatArray]:
    """Three grey pictures in the channels of one; of a Gray code patterns, then white: inverses are what is left."""
    pictures = pattern.render()
    shown = [*pictures[:-2:2], pictures[-2]] if isinstance(pattern, GrayCode) else pictures
    shown += [np.zeros_like(shown[0])] * (-len(shown) % 3)
    return [np.stack(shown[k : k + 3], axis=-1) / 255.0 for k in range(0, len(shown), 3)]


def _grey_pictures(
    pattern: GrayCode | FrameSequence,
    lights: list[FloatArray],
    room: FloatArray,
    camera_model: CameraModel,
    seeds: list[int],
) -> dict[str, Image]:
    """The sequence in the order of `render`; the camera takes three grey pictures at a time."""
    grey = [light[..., channel] for light in lights for channel in range(3)]
    black = np.zeros_like(grey[0])
    sequence = grey[: pattern.picture_count]
    if isinstance(pattern, GrayCode):
        bits = sum(pattern.bits)
        white = grey[bits]
        sequence = [light for shown in grey[:bits] for light in (shown, white - shown)] + [white, black]
    sequence = [light + room[..., 0] for light in sequence]
    pictures: list[Image] = []
    for first, seed in zip(range(0, len(sequence), 3), seeds, strict=False):
        three = sequence[first : first + 3]
        taken = camera_model.picture(np.stack([*three, *[black] * (3 - len(three))], axis=-1), seed)
        pictures += [taken[..., channel] for channel in range(len(three))]
    return {f"{number:02d}": picture for number, picture in enumerate(pictures)}


def _camera_model(options: SimulateOptions, monochrome: bool) -> CameraModel:
    m = 0.0 if monochrome else options.mixing
    return CameraModel(
        exposure=options.exposure,
        mixing=((1 - m, m, 0.0), (m / 2, 1 - m, m / 2), (0.0, m, 1 - m)),
        blur_px=options.blur_px,
        vignetting=options.vignetting,
        electrons=options.electrons,
        read_noise=options.read_noise,
        gamma=options.gamma,
        bayer=options.bayer and not monochrome,
    )
