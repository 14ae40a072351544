"""Views of an object on a turntable, decoded from their pictures: are all tied, rightly, and as surely as a merge says?

    python -m benchmarks.object.turn [SEED] [VIEWS] [--shuffled] [--foreign] [--open3d]

How far points lie from where their views' true poses have them, RMS, also by Open3D's multiway registration of the same
clouds. Views may come in random order, and one of another object among them.

Points of a decoded view err together over many pixels. Of each pair of neighbours, what turn and shift its surfaces
want of the true pose, in sigmas of the pair, RMS over six numbers; of the poses, their squared errors in their own
covariance, by six. Both are 1 where sigmas are right.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from benchmarks.merging import open3d_poses
from benchmarks.object.scenes import PATTERNS, make_rig, take
from retrue.geometry.transform import RigidTransform, vector_from_rotation
from retrue.merging import merge as merging
from retrue.merging.graph import LOOP_FREEDOM, Adjusted, shared_errors
from retrue.merging.pairs import counterparts, normal_equations
from retrue.merging.view import View
from retrue.reconstruction.cloud import Cloud
from retrue.reconstruction.reconstruct import reconstruct
from retrue.simulation.scene import Scene
from retrue.simulation.surfaces import Box, Paint, Sphere, Surface

DISTANCE = 640.0  # mm
AXIS = np.array([0.05, 0.99, 0.1]) / np.linalg.norm([0.05, 0.99, 0.1])
SPREAD = np.array([45.0, 50.0, 45.0])  # of the parts about the axis
PAINT = Paint((0.8, 0.8, 0.8))


def make_object(seed: int, camera_from_object: RigidTransform) -> Scene:
    """Seven balls and four boxes grown into each other."""
    rng = np.random.default_rng([seed, 77])
    things: list[Surface] = []
    for _ in range(7):
        middle = rng.normal(size=3) * SPREAD
        things.append(Sphere(camera_from_object.apply(middle[None])[0], rng.uniform(25, 45), PAINT))
    for _ in range(4):
        middle = rng.normal(size=3) * SPREAD
        pose = camera_from_object @ RigidTransform.from_rotation_vector(rng.uniform(-1, 1, 3), middle)
        things.append(Box(pose, tuple(rng.uniform(20, 40, 3).tolist()), PAINT))
    return Scene(things, (0.04, 0.04, 0.04), bright_at=DISTANCE)


def make_views(seed: int, count: int) -> tuple[list[Cloud], list[RigidTransform]]:
    """Their clouds, and the true camera_from_object of each."""
    rig, pattern = make_rig((640, 480)), PATTERNS["gray code"]()
    clouds: list[Cloud] = []
    poses: list[RigidTransform] = []
    for view in range(count):
        turn = RigidTransform.from_rotation_vector(2 * np.pi * view / count * AXIS, [0.0, 0.0, 0.0])
        poses.append(RigidTransform(turn.R, np.array([0.0, 10.0, DISTANCE])))
        shot = take(rig, make_object(seed, poses[-1]), pattern, DISTANCE, 1000 * seed + view)
        clouds.append(reconstruct(rig, shot.points))
    return clouds, poses


def rms_off(clouds: list[Cloud], poses: list[RigidTransform], found: dict[int, RigidTransform]) -> tuple[float, float]:
    """Of all points of the views found, in mm, the first view where it truly is; and of the view farthest off."""
    first = next(iter(found))
    squares = [
        ((pose.apply(clouds[view].points) - (poses[first] @ poses[view].inverse()).apply(clouds[view].points)) ** 2)
        .sum(axis=1)
        for view, pose in found.items()
    ]  # fmt: skip
    return float(np.sqrt(np.mean(np.concatenate(squares)))), float(np.sqrt(max(map(np.mean, squares))))


def main(seed: int, count: int) -> None:
    clouds, poses = make_views(seed, count)
    if "--shuffled" in sys.argv:
        order: list[int] = np.random.default_rng(seed).permutation(count).tolist()
        clouds, poses = [clouds[view] for view in order], [poses[view] for view in order]
    if "--foreign" in sys.argv:
        others, other_poses = make_views(seed + 1000, 1)
        clouds, poses = [*clouds, *others], [*poses, *other_poses]
    kept: list[tuple[dict[int, View], list[tuple[int, int]], float, Adjusted]] = []
    adjust = merging.adjust

    def watched(
        views: dict[int, View], start: dict[int, RigidTransform], pairs: list[tuple[int, int]], cell: float
    ) -> Adjusted:
        kept.append((views, list(pairs), cell, adjust(views, start, pairs, cell)))
        return kept[-1][-1]

    merging.adjust = watched
    start = time.perf_counter()
    merged = merging.merge(clouds)
    seconds = time.perf_counter() - start
    print(merged)
    if not isinstance(merged, merging.Merged):
        sys.exit("no view was tied to another: ask for more")
    print("points off by {:.3f} mm RMS, of one view {:.3f};".format(*rms_off(clouds, poses, merged.poses)), end=" ")
    print(f"{seconds:.0f} s")
    if "--open3d" in sys.argv:
        start = time.perf_counter()
        off = rms_off(clouds, poses, open3d_poses(clouds))
        print("Open3D: {:.3f} mm, {:.3f};".format(*off), f"{time.perf_counter() - start:.0f} s")
    views, pairs, cell, adjusted = kept[-1]
    settled = [
        counterparts(views[i], views[j], adjusted.poses[i].inverse() @ adjusted.poses[j], cell) for i, j in pairs
    ]
    shared, _ = shared_errors(settled, adjusted.level, cell)
    wanted: list[float] = []
    for i, j in pairs:
        H, g, _ = normal_equations(
            counterparts(views[i], views[j], poses[i] @ poses[j].inverse(), cell), adjusted.level
        )
        wanted.append(float(g @ np.linalg.pinv(H) @ g) / LOOP_FREEDOM / shared / adjusted.level**2)
    print(f"counterparts err alike: gradients vary {shared:.1f} times as much as if each erred by itself")
    print(
        f"{len(pairs)} pairs: error in sigmas, RMS {np.sqrt(np.mean(wanted)):.2f}, largest {np.sqrt(max(wanted)):.2f}"
    )
    print(f"poses: squared error in their covariance, by six, mean {np.mean(_off(adjusted, poses)):.2f}")


def _off(adjusted: Adjusted, poses: list[RigidTransform]) -> list[float]:
    first, *others = adjusted.poses
    found: list[float] = []
    for place, view in enumerate(others, start=1):
        off = adjusted.poses[view] @ (poses[first] @ poses[view].inverse()).inverse()
        move = np.append(vector_from_rotation(off.R), off.t)
        own = slice(6 * place, 6 * place + 6)
        found.append(float(move @ np.linalg.solve(adjusted.covariance[own, own], move)) / LOOP_FREEDOM)
    return found


if __name__ == "__main__":
    words = [int(word) for word in sys.argv[1:] if word.isdigit()]
    main(*(words[k] if k < len(words) else usual for k, usual in enumerate((1, 12))))
