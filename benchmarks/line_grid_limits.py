"""How the line-grid decoder falls off, one disturbance at a time, until it stops.

    python benchmarks/line_grid_limits.py

Our own renderer: walls, a corner, a ball before a wall, print. It has to stop by missing points, not by wrong ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import map_coordinates

from retrue.correspondences import Correspondences
from retrue.decoding.lines.decode_line_grid import decode_line_grid
from retrue.geometry.arrays import FloatArray
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.patterns.line_grid import LineGrid, make_line_grid
from retrue.rig import Rig
from retrue.simulation.camera_model import CameraModel, Mixing
from retrue.simulation.scene import Rendered, Scene, render
from retrue.simulation.surfaces import Paint, Sphere, Wall

GRID = make_line_grid((800, 600))
WRONG_PITCHES = 0.5
LEAST_PITCH_PX = 5.0


def mixing(leak: float, gains: tuple[float, float, float] = (0.5, 1.0, 0.8)) -> Mixing:
    red, green, blue = gains
    return ((red, red * leak, 0), (green * leak / 2, green, green * leak / 2), (0, blue * leak, blue))


WEBCAM = CameraModel(
    exposure=1.4, mixing=mixing(0.2), blur_px=0.9, vignetting=0.3, electrons=3000, read_noise=8, gamma=2.2, bayer=True
)


@dataclass(frozen=True, slots=True)
class Score:
    """What the decoder made of one picture; `error_over_sigma` is 1 where each point's own sigma is right."""

    countable: int
    points: int
    wrong: int
    rms_px: float
    error_over_sigma: float


def score(grid: LineGrid, truth: Rendered, points: Correspondences) -> Score:
    """Against the projector pixel that the truth has at each decoded camera pixel."""
    pitch = np.array([grid.columns.pitch, grid.rows.pitch])
    origin = np.array([grid.columns.origin, grid.rows.origin])
    size = np.array([len(grid.columns.sequence), len(grid.rows.sequence)])
    there, jacobian = _projector_at(truth, points.camera_px)
    off = points.projector_px - there
    wrong = ~(np.abs(off / pitch).max(axis=1) < WRONG_PITCHES)
    with np.errstate(invalid="ignore"):
        error = np.linalg.solve(jacobian, off[..., None])[..., 0]
    known = ~wrong & np.isfinite(error).all(axis=1)
    with np.errstate(invalid="ignore"):
        cell = (truth.projector_px - origin) / pitch
        nearest = np.round(cell)
        near = truth.visible & (np.abs(cell - nearest).max(axis=-1) < 0.15)
        near &= (nearest >= 0).all(axis=-1) & (nearest < size).all(axis=-1)
    y, x = np.nonzero(near)
    _, local = _projector_at(truth, np.stack([x, y], axis=-1).astype(np.float64))
    steps = np.linalg.solve(local, np.broadcast_to(np.diag(pitch), local.shape))
    wide = np.nan_to_num(np.linalg.norm(steps, axis=1).min(axis=-1)) >= LEAST_PITCH_PX
    countable = len(np.unique(nearest[y[wide], x[wide]], axis=0))
    sigma = points.camera_sigma_px
    assert sigma is not None
    return Score(
        countable,
        len(points),
        int(wrong.sum()),
        float(np.sqrt(np.mean(error[known] ** 2))) if known.any() else np.nan,
        float(np.sqrt(np.mean((error[known] / sigma[known, None]) ** 2))) if known.any() else np.nan,
    )


def _projector_at(truth: Rendered, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Projector pixel (N, 2) of camera pixels (N, 2), and its derivative (N, 2, 2) by them; the identity if unknown."""

    def there(at: FloatArray) -> FloatArray:
        return np.stack(
            [map_coordinates(truth.projector_px[..., k], at.T[::-1], order=1, mode="nearest") for k in range(2)],
            axis=-1,
        )

    columns = [(there(at + step) - there(at - step)) for step in (np.array([0.5, 0]), np.array([0, 0.5]))]
    jacobian = np.stack(columns, axis=-1)
    sound = np.isfinite(jacobian).all(axis=(1, 2)) & (np.abs(np.linalg.det(np.nan_to_num(jacobian))) > 1e-3)
    jacobian[~sound] = np.eye(2)
    return there(at), jacobian


def capture(
    scene: str, model: CameraModel, seed: int, grid: LineGrid = GRID, turn: float = 0.0, contrast: float = 0.0
) -> Rendered:
    """A webcam, 640 x 480, of one of the scenes, with a pose of its own for each seed."""
    random = np.random.default_rng(seed)
    camera = Camera((640, 480), [[820, 0, 319.5], [0, 820, 239.5], [0, 0, 1]], [0.05, -0.1, 0.001, 0, 0])
    projector = Camera((800, 600), [[1300, 0, 399.5], [0, 1300, 500.0], [0, 0, 1]])
    wobble = random.normal(0, 0.04, 3)
    rig = Rig(
        camera,
        projector,
        RigidTransform.from_rotation_vector(np.array([0.05, 0.2, turn]) + wobble, [-300 + 60 * wobble[0], 40, 60]),
    )
    paint = Paint(blob_size=90.0 if contrast else 0.0, contrast=contrast, seed=seed)
    tilt = random.uniform(-0.25, 0.25, 2)
    wall = Wall.facing(1500.0, (tilt[0], 0.2 + tilt[1], 0.0), paint)
    surfaces = {
        "wall": [wall],
        "ball": [wall, Sphere(np.array([-60.0, 20.0, 1250.0]), 140.0)],
        "corner": [Wall.facing(1500.0, (0.1, 0.6, 0.0), paint), Wall.facing(1500.0, (0.1, -0.6, 0.0), paint)],
    }[scene]
    return render(
        rig, Scene(surfaces, ambient=(0.02, 0.02, 0.02)), grid.render(), model, seed=seed, projector_blur_px=0.6
    )


def main() -> None:
    print(f"{'scene and disturbance':36} {'there':>6} {'points':>6} {'wrong':>5} {'RMS px':>7} {'error/sigma':>11}")
    for scene in ("wall", "ball", "corner"):
        report(scene, "webcam", WEBCAM)
    for electrons in (1000, 300, 100, 30):
        report("wall", f"noise, {electrons} electrons", replace(WEBCAM, electrons=electrons))
    for blur in (0.5, 1.3, 1.7, 2.2):
        report("wall", f"blur, {blur} px", replace(WEBCAM, blur_px=blur))
    for leak in (0.0, 0.4, 0.6):
        report("wall", f"colour mixing, {leak} of neighbours", replace(WEBCAM, mixing=mixing(leak)))
    for gains in ((1.0, 1.0, 1.0), (0.25, 1.0, 1.0), (1.0, 0.7, 0.4)):
        report("wall", f"white balance {gains}", replace(WEBCAM, mixing=mixing(0.2, gains)))
    for exposure in (4.0, 0.4, 0.1):
        report("wall", f"exposure, white at {exposure}", replace(WEBCAM, exposure=exposure))
    for gamma in (1.0, 3.0):
        report("wall", f"gamma {gamma}", replace(WEBCAM, gamma=gamma))
    for contrast in (0.4, 0.8):
        report("ball", f"print, contrast {contrast}", WEBCAM, contrast=contrast)
    for turn in (0.4, 0.8, 1.57, 3.14, -1.57):
        report("wall", f"turned by {turn} rad", WEBCAM, turn=turn)
    print("stripes: points, wrong, RMS across the line, error/sigma")
    for axis, name in enumerate(("columns", "rows")):
        for scene in ("wall", "ball", "corner"):
            report_stripes(axis, scene, f"{name} alone", WEBCAM)
    for turn in (0.4, 0.8, 1.57):
        report_stripes(0, "wall", f"columns turned by {turn} rad", WEBCAM, turn=turn)
    report_stripes(0, "ball", "columns, print, contrast 0.8", WEBCAM, contrast=0.8)
    report_stripes(0, "wall", "columns, noise, 100 electrons", replace(WEBCAM, electrons=100))
    report_stripes(0, "wall", "columns, blur, 2.2 px", replace(WEBCAM, blur_px=2.2))


def report(scene: str, name: str, model: CameraModel, turn: float = 0.0, contrast: float = 0.0) -> None:
    seeds = (1, 2)
    truths = [capture(scene, model, seed, turn=turn, contrast=contrast) for seed in seeds]
    scores = [score(GRID, truth, decode_line_grid(GRID, truth.image)) for truth in truths]
    there, points, wrong = (sum(getattr(s, key) for s in scores) for key in ("countable", "points", "wrong"))
    rms, over = (np.mean([getattr(s, key) for s in scores]) for key in ("rms_px", "error_over_sigma"))
    print(f"{scene + ', ' + name:36} {there:6} {points:6} {wrong:5} {rms:7.3f} {over:11.2f}", flush=True)


def report_stripes(
    axis: int, scene: str, name: str, model: CameraModel, turn: float = 0.0, contrast: float = 0.0
) -> None:
    grid = replace(GRID, **{("rows", "columns")[axis]: None})
    lines = (grid.columns, grid.rows)[axis]
    assert lines is not None
    truth = capture(scene, model, 1, grid=grid, turn=turn, contrast=contrast)
    points = decode_line_grid(grid, truth.image)
    there, jacobian = _projector_at(truth, points.camera_px)
    off = (points.projector_px - there)[:, axis]
    right = np.abs(off) < WRONG_PITCHES * lines.pitch
    error = (off / np.linalg.norm(jacobian[:, axis], axis=1))[right]
    rms = float(np.sqrt(np.mean(error**2))) if len(error) else np.nan
    assert points.camera_sigma_px is not None
    over = rms / points.camera_sigma_px[0] if len(error) else np.nan
    print(f"{scene + ', ' + name:36} {len(points):13} {int((~right).sum()):5} {rms:7.3f} {over:11.2f}", flush=True)


if __name__ == "__main__":
    main()
