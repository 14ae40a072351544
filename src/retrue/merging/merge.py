"""Several views of one object, merged into one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retrue.answers import Reason
from retrue.correspondences import repeated_in
from retrue.errors import DegenerateError, InputError, require_kind, require_kinds, require_names
from retrue.geometry.arrays import FloatArray
from retrue.geometry.transform import RigidTransform
from retrue.merging.graph import Adjusted, adjust
from retrue.merging.options import MergeOptions
from retrue.merging.pairs import Pair, fine_pair, require_libraries
from retrue.merging.standing import find_standing, without
from retrue.merging.surface import Surface, cell_in_reach, make_surface, surface_mesh
from retrue.merging.ties import Progress, good, ties
from retrue.merging.view import FEWEST_POINTS, View, local_normals, make_view, usual_cell, usual_spacing
from retrue.reconstruction.cloud import Cloud, Mesh
from retrue.shown import ShortRepr, Shown, counted, figures, in_space
from retrue.values import ByValue

LEAST_IN_GROUP = 2
TOLD = 0.005  # of the points: less rounds to nothing
SURFACE_REACH = 1.5  # spacings of the points: the h of the surface
MESH_CELL = 1.2  # spacings


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Merged(ByValue, ShortRepr):
    """One object of several views.

    Attributes
    ----------
    cloud : the points of all views on the one surface that they agree on, in the first merged view's camera frame.
    poses : object_from_view of each view that was merged, by its number among those handed in.
    pose_sigma : (turn in radians, shift at the object's middle in the cloud's unit) of each, one standard deviation.
    left_out : the numbers of the views that show no surface, or none in common with the others, and why.
    residuals : RMS distance between the surfaces of each two neighbours, in the cloud's unit.
    closure_sigma : by how many of its sigmas the worst pair misses what all others say of it.
    standing : share of the points that were left out because they stood still before the camera.
    names : of the views, as they were handed in.
    """

    cloud: Cloud
    poses: dict[int, RigidTransform]
    pose_sigma: dict[int, tuple[float, float]]
    left_out: dict[int, Reason]
    residuals: dict[tuple[int, int], float]
    closure_sigma: float
    standing: float
    names: tuple[str, ...]
    surface: Surface
    spacing: float

    verdict = "merged"

    @property
    def cause(self) -> Reason | None:
        """The first view that was left out; None where all were merged."""
        return next(iter(self.left_out.values()), None)

    @property
    def reason(self) -> str:
        """A sentence."""
        words = [f"{len(self.poses)} of {counted(len(self.names), 'view')}"]
        if self.standing:
            words.append(f"without what stood still before the camera, {self.standing:.0%} of the points")
        return "; ".join([*words, *map(str, self.left_out.values())])

    def mesh(self, cell: float | None = None) -> Mesh:
        """The surface as triangles, counter-clockwise from outside, by cells of that size; holes stay open.

        By default cells are as fine as the points, or as fine as memory allows.

        Raises `InputError` without scikit-image, and `DegenerateError` where there is no surface.
        """
        cell = cell or cell_in_reach(self.surface, MESH_CELL * self.spacing)
        surface = replace(self.surface, reach=max(self.surface.reach, cell))  # else cells would fall between points
        vertices, faces = surface_mesh(surface, cell)
        _, row = self.surface.tree.query(vertices)
        return Mesh(vertices, self.cloud.colors[row], faces, self.cloud.unit)

    def _shown(self) -> Shown:
        typical = float(np.median(list(self.residuals.values())))
        rows = {
            "points": f"{len(self.cloud):,}",
            "views apart": f"{figures(typical)} {self.cloud.unit} (median RMS of neighbours)",
            "loops close": f"within {figures(self.closure_sigma, 2)} sigma",
        }
        return self.reason, rows

    def _in_space(self) -> str:
        return in_space(self.cloud)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RefusedMerge(ByValue, ShortRepr):
    """No two views show a common surface.

    Attributes
    ----------
    left_out : the numbers of the views that were not asked, as they show no surface at all, and why.
    """

    cause: Reason
    left_out: dict[int, Reason] = field(default_factory=dict[int, Reason])

    verdict = "refused"

    @property
    def reason(self) -> str:
        """A sentence."""
        return "; ".join(map(str, (self.cause, *self.left_out.values())))

    def _shown(self) -> Shown:
        return self.reason, {}


@dataclass(frozen=True, slots=True)
class NoSurface(Reason):
    """A view shows too little to be laid on any other: too few points, or none beside each other."""

    view: str
    why: str

    def __str__(self) -> str:
        return f"{self.view} was left out: {self.why}"


@dataclass(frozen=True, slots=True)
class NoCommonSurface(Reason):
    """A view shows nothing that the others show.

    Attributes
    ----------
    best : the largest share of it, or of its neighbour, that lay on the other's surface.
    contradicted : the share that then lay before what the other's camera saw.
    overlooked : the share of what that camera ought to have seen, and did not.
    """

    view: str
    best: float
    contradicted: float
    overlooked: float

    def __str__(self) -> str:
        why = _why(self.best, self.contradicted, self.overlooked)
        return f"{self.view} was left out: {why}: another object, or too far turned"


@dataclass(frozen=True, slots=True)
class NothingInCommon(Reason):
    """Of all views no two overlap; see `NoCommonSurface`."""

    views: int
    best: float
    contradicted: float
    overlooked: float

    def __str__(self) -> str:
        return (
            f"no two of {self.views} views show a common surface: "
            f"{_why(self.best, self.contradicted, self.overlooked)}; "
            "take them with more overlap, each in its own camera's frame"
        )


def _why(best: float, contradicted: float, overlooked: float) -> str:
    words = [f"at most {best:.0%} of one lies on another's surface"]
    words += [f"{contradicted:.0%} before what that camera saw"] if contradicted >= TOLD else []
    words += [f"{overlooked:.0%} of what that camera ought to have seen is missing there"] if overlooked >= TOLD else []
    *most, last = words
    return f"{', '.join(most)}, and {last}" if most else last


def merge(
    clouds: Sequence[Cloud],
    options: MergeOptions | None = None,
    *,
    names: Sequence[str] = (),
    progress: Progress | None = None,
) -> Merged | RefusedMerge:
    """Find how the views lie to each other, close all loops at once, and make one surface of them.

    Parameters
    ----------
    clouds : two or more, each in its own camera frame, as `reconstruct` makes them; in any order. Of their `sigma`
        only ratios count; without it, noise grows as the square of depth.
    names : for what is said of them; numbers, unless given.
    progress : called with the number of views tied and in all.

    Raises
    ------
    InputError : fewer than two clouds, one of them twice, clouds of several units, or the libraries of `.[merge]` are
        not installed.
    DegenerateError : fewer than two of the clouds show a surface; of more, those that do not are left out.
    """
    require_kinds(clouds, Cloud, "clouds", "retrue.reconstruct makes them")
    options = MergeOptions() if options is None else options
    require_kind(options, MergeOptions, "options")
    if len(clouds) < LEAST_IN_GROUP:
        raise InputError(f"merge: expected two clouds or more, found {len(clouds)}")
    units = sorted({cloud.unit for cloud in clouds})
    if len(units) > 1:
        raise InputError(f"merge: expected one unit of length, found {', '.join(units)}")
    if options.turntable not in (0, len(clouds)):
        raise InputError(f"turntable: expected as many views as steps of a turn, found {len(clouds)}")
    require_libraries()
    require_names(names, len(clouds))
    names = tuple(names) or tuple(f"view {number}" for number in range(1, len(clouds) + 1))
    left_out: dict[int, Reason] = {}
    finite = {
        number: cloud.select(np.flatnonzero(np.isfinite(cloud.points).all(axis=1)))
        for number, cloud in enumerate(clouds)
    }
    for first, again in repeated_in(list(finite.values()), _same_points):
        raise InputError(
            f"{names[again]}: holds the same points as {names[first]}, and would count twice: hand in each view once"
        )
    shown, views, cell = _views(finite, names, options, left_out)
    standing, share = None if options.keep_standing else find_standing(list(views.values()), cell), 0.0
    if standing is not None:
        moving = {
            number: shown[number].select(without(shown[number].points, view, stands))
            for (number, view), stands in zip(views.items(), standing, strict=True)
        }
        share = 1 - sum(map(len, moving.values())) / sum(map(len, shown.values()))
        shown, views, cell = _views(moving, names, options, left_out)
    tried: dict[tuple[int, int], Pair] = {}
    poses = ties(views, options, cell, tried, progress)
    if len(poses) < LEAST_IN_GROUP:
        return RefusedMerge(NothingInCommon(len(views), *_nearest_miss(tried.values())), left_out)
    neighbours = _neighbours(views, poses, options, cell)
    adjusted = adjust(views, poses, [(pair.first, pair.second) for pair in neighbours], cell)
    for view in views:
        if view not in poses:
            nearest = _nearest_miss(pair for key, pair in tried.items() if view in key)
            left_out[view] = NoCommonSurface(names[view], *nearest)
    return _merged(shown, views, adjusted, dict(sorted(left_out.items())), share, names)


def _same_points(one: Cloud, other: Cloud) -> bool:
    """The same places in the same order, some at least."""
    return len(one) > 0 and np.array_equal(one.points, other.points)


def _views(
    clouds: Mapping[int, Cloud], names: Sequence[str], options: MergeOptions, left_out: dict[int, Reason]
) -> tuple[dict[int, Cloud], dict[int, View], float]:
    """The clouds that show a surface, the same as views, and the cells' size; the others go into `left_out`."""
    enough = [cloud for cloud in clouds.values() if len(cloud) >= FEWEST_POINTS]
    cell = _cell(enough, options) if enough else np.inf
    views: dict[int, View] = {}
    for number, cloud in clouds.items():
        try:
            views[number] = make_view(cloud.points, cloud.sigma, cell)
        except DegenerateError as error:
            left_out[number] = NoSurface(names[number], str(error))
    if len(views) < LEAST_IN_GROUP:
        first = next(reason for reason in left_out.values() if isinstance(reason, NoSurface))
        raise DegenerateError(
            f"{first.view}: merge: {first.why}; of {counted(len(names), 'view')} fewer than two are left"
        )
    return {number: clouds[number] for number in views}, views, cell


def _cell(clouds: Sequence[Cloud], options: MergeOptions) -> float:
    if options.cell is None:
        return usual_cell([cloud.points for cloud in clouds])
    finest = min(usual_spacing(cloud.points) for cloud in clouds) / 2
    if not options.cell >= finest:
        raise InputError(
            f"cell: expected half of the points' distance or more, {finest:.3g} {clouds[0].unit}, "
            f"found {options.cell:g}"
        )
    return options.cell


def _nearest_miss(pairs: Iterable[Pair]) -> tuple[float, float, float]:
    """Overlap, and what contradicts it, of the pair that overlaps most."""
    best = max(pairs, key=lambda pair: pair.overlap, default=None)
    return (0.0, 0.0, 0.0) if best is None else (best.overlap, best.contradicted, best.overlooked)


def _neighbours(
    views: Mapping[int, View], poses: dict[int, RigidTransform], options: MergeOptions, cell: float
) -> list[Pair]:
    """All pairs that overlap at these poses; the tree's own are among them."""
    order = sorted(poses)
    found: list[Pair] = []
    for number, first in enumerate(order):
        for second in order[number + 1 :]:
            start = poses[first].inverse() @ poses[second]
            if not _face_alike(views[first], views[second], start):
                continue
            pair = fine_pair(first, second, views, start, cell)
            if good(pair, options):
                found.append(pair)
    return found


def _face_alike(first: View, second: View, pose: RigidTransform) -> bool:
    """Whether the two cameras look the same way at all: else no surface faces both."""
    return bool(pose.R[2, 2] > 0)


def _merged(
    clouds: Mapping[int, Cloud],
    views: Mapping[int, View],
    adjusted: Adjusted,
    left_out: dict[int, Reason],
    standing: float,
    names: tuple[str, ...],
) -> Merged:
    points: list[FloatArray] = []
    normals: list[FloatArray] = []
    noise: list[FloatArray] = []
    colors: list[NDArray[np.uint8]] = []
    spacings: list[float] = []
    for number, pose in adjusted.poses.items():
        cloud = clouds[number]
        found, flat = local_normals(cloud.points, 16)
        along = np.full(len(cloud), views[number].noise) if cloud.sigma is None else cloud.sigma
        cosine = np.abs((cloud.points * found).sum(axis=1)) / np.linalg.norm(cloud.points, axis=1)
        kept = flat & (cosine > 0.05)
        points.append(pose.apply(cloud.points[kept]))
        normals.append(found[kept] @ pose.R.T)
        noise.append((along * np.maximum(cosine, 0.2))[kept])
        colors.append(cloud.colors[kept])
        spacings.append(usual_spacing(cloud.points))
    spacing = float(np.median(spacings))
    together = np.concatenate(points), np.concatenate(normals), np.concatenate(noise)
    surface = make_surface(*together, SURFACE_REACH * spacing)
    on, normal, sigma_on = surface.onto(surface.points)
    middle = surface.points.mean(axis=0)
    pose_sigma = {view: _pose_sigma(adjusted, place, middle) for place, view in enumerate(adjusted.poses)}
    merged_colors = np.concatenate(colors)[surface.rows]
    good = np.isfinite(on).all(axis=1)
    card: dict[str, Any] = {"points": int(good.sum()), "views": len(adjusted.poses)}
    cloud = Cloud(
        on[good],
        merged_colors[good],
        np.full((int(good.sum()), 2), np.nan),
        next(iter(clouds.values())).unit,
        card=card,
        normals=normal[good],
        sigma=sigma_on[good],
    )
    return Merged(
        cloud,
        adjusted.poses,
        pose_sigma,
        left_out,
        {pair: rms for pair, (rms, _) in adjusted.residuals.items()},
        max(adjusted.closures.values(), default=0.0),
        standing,
        names,
        surface,
        spacing,
    )


def _pose_sigma(adjusted: Adjusted, place: int, middle: FloatArray) -> tuple[float, float]:
    """Of a view's turn, and of where its part of the object is, at the object's middle."""
    from retrue.geometry.transform import skew

    whole = adjusted.covariance[6 * place : 6 * place + 6, 6 * place : 6 * place + 6]
    move = np.hstack([-skew(middle), np.eye(3)])
    shift = move @ whole @ move.T
    return float(np.sqrt(np.trace(whole[:3, :3]))), float(np.sqrt(np.trace(shift)))
