"""What goes wrong between a scene and a rig file: wrong matches, other light paths, other lenses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .capture import Capture
from .lens import Array, Generator, Lens
from .rig import Rig, random_direction


def part(rng: Generator, capture: Capture, share: float) -> Array:
    """(N,) a mask of the points on one side of a line across the camera's picture."""
    height = capture.camera_px @ random_direction(rng)[:2]
    return height < np.quantile(height, share)


def spoiled(capture: Capture, rows: Array, **columns: Array) -> Capture:
    """With other pixels in those rows, which are wrong from now on."""
    changed = {name: np.where(rows[:, None], value, getattr(capture, name)) for name, value in columns.items()}
    return replace(capture, **changed, right=capture.right & ~rows)


def wrong_matches(rng: Generator, capture: Capture, share: float, *, clustered: bool) -> Capture:
    """Projector pixels from anywhere in the lit part; clustered: in round patches of the camera's picture."""
    low, high = capture.projector_px.min(axis=0), capture.projector_px.max(axis=0)
    random = rng.uniform(low, high, (len(capture), 2))
    if not clustered:
        return spoiled(capture, rng.random(len(capture)) < share, projector_px=random)
    seeds = capture.camera_px[rng.integers(0, len(capture), max(1, int(8 * share + rng.integers(1, 4))))]
    nearness = np.linalg.norm(capture.camera_px[:, None] - seeds, axis=2).min(axis=1)
    return spoiled(capture, nearness < np.quantile(nearness, share), projector_px=random)


def mirror(rng: Generator, rig: Rig, capture: Capture, share: float) -> Capture | None:
    """Some points are seen through a mirror: consistent with one reflected scene. None where no mirror shows them."""
    rows = part(rng, capture, share)
    middle = capture.points[rows].mean(axis=0)
    for _ in range(200):
        pixel = rng.uniform(0.1, 0.9, (1, 2)) * np.array(rig.camera.size)
        image = rig.camera.rays(pixel)[0] * middle[2] * rng.uniform(0.6, 2)
        normal = image - middle
        normal /= np.linalg.norm(normal)
        depth = (capture.points - (image + middle) / 2) @ normal  # negative on the camera's side
        reflected = capture.points - 2 * depth[:, None] * normal
        seen = rig.camera.project(reflected)
        eye = (image + middle) @ normal * normal  # the camera, as the mirror shows it
        leaves = (capture.normals * (eye - capture.points)).sum(axis=1) > 0  # no surface shines from its back
        there = (depth[rows] < 0).all() and leaves[rows].all() and rig.camera.inside(seen[rows]).all()
        if -(image + middle) @ normal / 2 < 0 and there:
            noise = capture.noise.draw(rng, np.nan_to_num(seen), rig.camera.size)
            return spoiled(capture, rows, camera_px=seen + noise)
    return None


def shifted_copy(rng: Generator, capture: Capture, share: float) -> Capture:
    """Repeated texture: a part of the points displaced by a constant in one of the pictures."""
    rows = part(rng, capture, share)
    device = str(rng.choice(["camera", "projector"]))
    size = np.array(getattr(capture, f"{device}_size"))
    angle, length = rng.uniform(0, 2 * np.pi), rng.uniform(0.03, 0.25)
    shift = size * length * np.array([np.cos(angle), np.sin(angle)])
    return spoiled(capture, rows, **{f"{device}_px": getattr(capture, f"{device}_px") + shift})


def moved_object(rng: Generator, rig: Rig, capture: Capture, share: float) -> Capture:
    """A thing that came nearer between the column pictures and the row pictures: its y belongs to another depth."""
    rows = part(rng, capture, share)
    nearer = capture.points * (1 - rng.choice([-1, 1]) * rng.uniform(0.01, 0.1))
    later = rig.projector.project(rig.in_projector(nearer))
    mixed = np.stack([capture.projector_px[:, 0], later[:, 1]], axis=1)
    return spoiled(capture, rows & np.isfinite(later).all(axis=1), projector_px=mixed)


def interleaved(rng: Generator, first: Capture, second: Capture) -> Capture:
    """Each match from one of two poses: the rig moved while the pictures were taken."""
    count = min(len(first), len(second))
    first, second = first.select(np.arange(count)), second.select(np.arange(count))
    rows = rng.random(count) < rng.uniform(0.3, 0.7)
    return spoiled(first, rows, camera_px=second.camera_px, projector_px=second.projector_px)


def permuted(rng: Generator, capture: Capture) -> Capture:
    """Decoded with another pattern: any projector pixel for any camera pixel."""
    everywhere = np.ones(len(capture), dtype=bool)
    return spoiled(capture, everywhere, projector_px=rng.permutation(capture.projector_px))


def swapped(capture: Capture) -> Capture:
    """The columns of the two devices exchanged."""
    everywhere = np.ones(len(capture), dtype=bool)
    return spoiled(capture, everywhere, camera_px=capture.projector_px, projector_px=capture.camera_px)


def cropped(rng: Generator, capture: Capture) -> Capture:
    """A window of 50 to 90 % of the camera's picture, stored by itself."""
    size = np.round(np.array(capture.camera_size) * rng.uniform(0.5, 0.9))
    corner = np.round(rng.uniform(0, 1, 2) * (np.array(capture.camera_size) - size))
    inside = ((capture.camera_px >= corner) & (capture.camera_px < corner + size)).all(axis=1)
    kept = capture.select(inside)
    return replace(kept, camera_px=kept.camera_px - corner, camera_size=(int(size[0]), int(size[1])))


def binned(capture: Capture) -> Capture:
    """Two by two camera pixels stored as one."""
    width, height = capture.camera_size
    return replace(capture, camera_px=(capture.camera_px - 0.5) / 2, camera_size=(width // 2, height // 2))


def log_uniform(rng: Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def signed(rng: Generator, low: float, high: float) -> float:
    return float(rng.choice([-1, 1])) * log_uniform(rng, low, high)


def other_focal(rng: Generator, rig: Rig, device: str) -> tuple[Rig, dict[str, float]]:
    """The rig as the file has it: a focal length, or both, 0.3 to 20 % off."""
    off: dict[str, float] = {}
    for name in ("camera", "projector"):
        if device in (name, "both"):
            off[f"{name} focal"] = signed(rng, 0.003, 0.2)
            rig = replace(rig, **{name: getattr(rig, name).other(zoom=1 / (1 + off[f"{name} focal"]))})
    return rig, off


def other_centre(rng: Generator, rig: Rig, most: float = 30.0) -> tuple[Rig, dict[str, float]]:
    """A principal point 1 to 30 pixels off."""
    name, length, angle = str(rng.choice(["camera", "projector"])), log_uniform(rng, 1, most), rng.uniform(0, 2 * np.pi)
    lens: Lens = getattr(rig, name)
    shift = length * np.array([np.cos(angle), np.sin(angle)])
    return replace(rig, **{name: lens.other(shift=shift)}), {f"{name} centre": length}


def other_k1(rng: Generator, rig: Rig) -> tuple[Rig, dict[str, float]]:
    """A k1 0.01 to 0.3 off, as far as every pixel still has a ray."""
    name, change = str(rng.choice(["camera", "projector"])), signed(rng, 0.01, 0.3)
    while True:
        lens = getattr(rig, name).other(k1=change)
        if lens.covers_its_picture():
            return replace(rig, **{name: lens}), {f"{name} k1": change}
        change *= -0.7
