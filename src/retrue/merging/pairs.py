"""Two views of one object: how they lie to each other, and whether they do at all.

Coarse by KISS-Matcher (features of the local shape, outliers pruned by a graph) and by trying turns all around, fine by
small_gicp (plane to plane). What they say is believed only where the surfaces then lie on each other, and neither lies
where the other's camera saw through.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np

from retrue.errors import InputError
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.robust import MAD_TO_SIGMA, biweight
from retrue.geometry.transform import RigidTransform, rotation_from_vector
from retrue.merging.sight import Sight, evidence, sight
from retrue.merging.view import View, prepared

GATE = 2.0  # cells within which the other surface's nearest point is a counterpart
ALIKE = np.cos(np.radians(40.0))  # between normals of counterparts
NOISE_SIGMAS, SAMPLING = 3.0, 0.01  # on the other's surface is what is so near; of the cell
COARSE_CELLS = (1.0, 1.4, 2.0)  # by half octaves: shapes of one size that fail are told by others
COARSE_REACH = 4.0
MATCHER_CELL = 0.3
TURNS = 240  # none is farther than 38 degrees from one of these, few than 27: surfaces of views 60 degrees apart find
# each other over 20 degrees nearly always, over 40 half of the time
SPIRALS = (np.sqrt(2.0), 1.533751168755204288118041)  # periods, the second with psi^4 = psi + 4
BEHIND = (0.4, 1.0, 1.6)  # what is seen of an object lies so far before its middle, in standard deviations of its width
TRIALS = ((100, 5), (300, 20))  # points and steps: all starts, then the likeliest ones again
MOST_TURNS = 8  # of the places that they lead to
TRIAL_REACH, TRIAL_NEIGHBOURS = 6.0, 6
EVERY = 16  # points, of which one tells whether poses are alike
FINE_STEPS, SETTLING_STEPS = 20, 3
FEWEST_COUNTERPARTS = 20


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """What ties view j to view i.

    Attributes
    ----------
    first, second : i and j.
    pose : first_from_second.
    overlap : share of the smaller view that lies on the other.
    contradicted : the larger of the shares of the two that lie where the other saw through.
    overlooked : the larger of the shares of what the one ought to have seen of the other, and did not.
    evidence : log odds that the pose is right, by what each camera saw of the other's points.
    """

    first: int
    second: int
    pose: RigidTransform
    overlap: float
    contradicted: float
    overlooked: float
    evidence: float


@dataclass(frozen=True, slots=True, eq=False)
class Counterparts:
    """M points of one view on another's surface.

    Attributes
    ----------
    places : (M, 3) in the first view's frame. normals : (M, 3) the mean of both surfaces' normals, there.
    distance : (M,) along the normal. sigma : (M,) of the distance. rows : (M,) which ones of the second view's points.
    """

    places: FloatArray
    normals: FloatArray
    distance: FloatArray
    sigma: FloatArray
    rows: IntArray


def require_libraries() -> None:
    """An `InputError` where what aligns is not installed."""
    for name in ("kiss_matcher", "small_gicp"):
        if find_spec(name) is None:
            raise InputError(f'merge: expected the library {name}, found none; pip install ".[merge]"')


def shaped_poses(first: View, second: View, cell: float) -> Iterator[RigidTransform]:
    """first_from_second by shapes of each size."""
    return (coarse_pose(first, second, cell, cells) for cells in COARSE_CELLS)


def coarse_pose(first: View, second: View, cell: float, cells: float) -> RigidTransform:
    """first_from_second from shapes of so many cells alone; whatever it says of views without common surface."""
    import kiss_matcher

    library: Any = kiss_matcher
    scale = MATCHER_CELL / (cells * cell)  # its limits are lengths, and mean this cell
    matcher = library.KISSMatcher(library.KISSMatcherConfig(MATCHER_CELL))
    clouds = [list((scale * view.points).astype(np.float32)) for view in (second, first)]
    found = matcher.estimate(*clouds)
    u, _, vt = np.linalg.svd(np.array(found.rotation, dtype=np.float64))
    R = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return RigidTransform(R, np.array(found.translation, dtype=np.float64).ravel() / scale)


def turned_poses(first: View, second: View, cell: float) -> list[RigidTransform]:
    """first_from_second by turns of every kind, both objects' middles on each other, aligned by few points; likeliest
    first.

    Far turned views have too little in common for shapes to tell.
    """
    middles = [(_middle(first, behind), _middle(second, behind)) for behind in BEHIND]
    facing = [R for R in _all_around(TURNS) if R[2, 2] > 0]  # else no surface faces both cameras
    poses = [RigidTransform(R, one - R @ other) for one, other in middles for R in facing]
    for count, steps in TRIALS:
        places = second.points[:: -(-len(second.points) // count)]
        few = prepared(places, TRIAL_NEIGHBOURS)
        poses = [_aligned(first, few, pose, TRIAL_REACH * cell, steps) for pose in poses]
        poses = sorted(poses, key=lambda pose: -_share_near(first, pose.apply(places), cell))
        poses = _distinct(second, poses, cell)
    return poses


def _all_around(count: int) -> FloatArray:
    """(count, 3, 3) evenly spread turns.

    Source: M. Alexa, "Super-Fibonacci spirals: fast, low-discrepancy sampling of SO(3)", CVPR 2022.
    """
    from scipy.spatial.transform import Rotation

    along = np.arange(count) + 0.5
    inner, outer = np.sqrt(along / count), np.sqrt(1 - along / count)
    one, other = (2 * np.pi * along / each for each in SPIRALS)
    turns = np.column_stack([inner * np.sin(one), inner * np.cos(one), outer * np.sin(other), outer * np.cos(other)])
    return np.array(Rotation.from_quat(turns).as_matrix())


def _distinct(view: View, poses: Sequence[RigidTransform], cell: float) -> list[RigidTransform]:
    """The first few poses that put a view to places of their own."""
    found: list[RigidTransform] = []
    for pose in poses:
        if len(found) == MOST_TURNS:
            break
        if not any(alike(view, pose, other, cell) for other in found):
            found.append(pose)
    return found


def _middle(view: View, behind: float) -> FloatArray:
    x, y, z = view.points.mean(axis=0)
    return np.array([x, y, z + behind * view.points[:, :2].std(axis=0).mean()])


def _share_near(view: View, places: FloatArray, cell: float) -> float:
    distance, _ = view.tree.query(places, distance_upper_bound=cell)
    return float(np.isfinite(distance).mean())


def fine_pair(first: int, second: int, views: Mapping[int, View], pose: RigidTransform, cell: float) -> Pair:
    """The pair, its pose refined from `pose` on the two surfaces."""
    target, source = views[first], views[second]
    pose = _aligned(target, source.prepared, pose, COARSE_REACH * cell, FINE_STEPS)
    pose = _aligned(target, source.prepared, pose, GATE * cell, FINE_STEPS)
    pose = _settled(target, source, pose, cell)
    back = pose.inverse()
    small, large = (target, source) if len(target.points) < len(source.points) else (source, target)
    large_from_small = back if small is target else pose
    found = counterparts(large, small, large_from_small, cell)
    off = _off(target, source, cell)
    overlap = float((np.abs(found.distance) < off).sum()) / len(small.points)
    each = both_sights(target, source, pose, cell)
    contradicted, overlooked = max(one.contradicted for one in each), max(one.overlooked for one in each)
    return Pair(first, second, pose, overlap, contradicted, overlooked, sum(evidence([one]) for one in each))


def both_sights(target: View, source: View, pose: RigidTransform, cell: float) -> tuple[Sight, Sight]:
    """What the target's camera says of the source's points, and the other way round."""
    off = _off(target, source, cell)
    return sight(target, source, pose, cell, off), sight(source, target, pose.inverse(), cell, off)


def counterparts(target: View, source: View, pose: RigidTransform, cell: float) -> Counterparts:
    """Points of `source` that have one on `target`, as by `pose`, target_from_source.

    The distance is along the mean of both normals, whose curvature then cancels: a sphere's neighbours are at none.
    Source: S. Rusinkiewicz, "A symmetric objective function for ICP", ACM Transactions on Graphics 38 (2019).
    """
    moved, turned = pose.apply(source.points), source.normals @ pose.R.T
    near, row = _nearest(target, moved, turned, cell)
    p, q, row = moved[near], target.points[row[near]], row[near]
    normals = turned[near] + target.normals[row]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    sigma = np.hypot(source.sigma[near], target.sigma[row])
    return Counterparts((p + q) / 2, normals, ((p - q) * normals).sum(axis=1), sigma, np.flatnonzero(near))


def normal_equations(
    found: Counterparts, level: float, share: FloatArray | float = 1.0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Information (6, 6) and gradient (6,) of a small turn and shift of the source in the target's frame; weights (M,).

    A turn w and a shift v about the target's origin move a point at X by w x X + v, its distance by (X x n, n) . (w,
    v). Each counterpart counts as so large a `share` (M,) of one.
    """
    weights = share * biweight(found.distance / (level * found.sigma)) / found.sigma**2
    design = np.column_stack([np.cross(found.places, found.normals), found.normals])
    return (design * weights[:, None]).T @ design, design.T @ (weights * found.distance), weights


def moved(pose: RigidTransform, step: FloatArray) -> RigidTransform:
    """The pose after a small turn and shift (6,) in the target's frame."""
    return RigidTransform(rotation_from_vector(step[:3]), step[3:]) @ pose


def _aligned(target: View, source: Any, pose: RigidTransform, reach: float, steps: int) -> RigidTransform:
    """By generalised ICP, `source` as small_gicp keeps it; the pose that it began from, where it came to nothing."""
    import small_gicp

    library: Any = small_gicp
    start = np.eye(4)
    start[:3, :3], start[:3, 3] = pose.R, pose.t
    cloud, tree = target.prepared
    found = library.align(
        cloud,
        source[0],
        tree,
        init_T_target_source=start,
        max_correspondence_distance=reach,
        max_iterations=steps,
    ).T_target_source
    return RigidTransform(found[:3, :3], found[:3, 3]) if np.isfinite(found).all() else pose


def alike(view: View, one: RigidTransform, other: RigidTransform, cell: float) -> bool:
    """Whether two poses put a view to one place: so near that surfaces lead from the one to the other."""
    places = view.points[::EVERY]
    apart = one.apply(places) - other.apply(places)
    return bool(np.sqrt((apart**2).sum(axis=1).mean()) < GATE * cell)


def _settled(target: View, source: View, pose: RigidTransform, cell: float) -> RigidTransform:
    """A few steps of the symmetric distance, which sampling does not pull aside."""
    for _ in range(SETTLING_STEPS):
        found = counterparts(target, source, pose, cell)
        if len(found.distance) < FEWEST_COUNTERPARTS:
            break
        level = MAD_TO_SIGMA * float(np.median(np.abs(found.distance / found.sigma)))
        H, g, _ = normal_equations(found, max(level, 1e-9))
        pose = moved(pose, -np.linalg.pinv(H) @ g)
    return pose


def _off(target: View, source: View, cell: float) -> float:
    """Distance beyond which a point is not on the other's surface: by noise, and a little for the sampling."""
    return NOISE_SIGMAS * float(np.hypot(target.noise, source.noise)) + SAMPLING * cell


def _nearest(target: View, places: FloatArray, normals: FloatArray, cell: float) -> tuple[BoolArray, IntArray]:
    """Which places have a counterpart, and its row."""
    distance, row = target.tree.query(places, distance_upper_bound=GATE * cell)
    near = np.isfinite(distance)
    row = np.where(near, row, 0)
    return near & ((target.normals[row] * normals).sum(axis=1) > ALIKE), row
