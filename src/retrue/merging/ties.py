"""Which views belong together: pairs tie them, strongest first, and every tie is heard by all views that it joins."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from retrue.geometry.transform import RigidTransform, vector_from_rotation
from retrue.merging.options import MergeOptions
from retrue.merging.pairs import Pair, alike, both_sights, fine_pair, shaped_poses, turned_poses
from retrue.merging.sight import Sight, evidence
from retrue.merging.view import View

PROVEN = 3.0  # log odds: twenty to one

Progress = Callable[[int, int], None]
Poses = dict[int, RigidTransform]
Tried = dict[tuple[int, int], Pair]


def good(pair: Pair, options: MergeOptions) -> bool:
    """Whether surfaces lie on each other, and hardly any lies where the other saw through."""
    return pair.overlap >= options.least_overlap and pair.contradicted <= options.most_contradicted


def ties(
    views: Mapping[int, View], options: MergeOptions, cell: float, tried: Tried, progress: Progress | None
) -> Poses:
    """Poses of the most views that can be tied, the first one's frame the object's; pairs tried go into `tried`.

    Neighbours in the order of taking first; of each pair the pose that has most for it. What a pair does not prove by
    itself waits for all that do: the back of an object may pass for its front, until another view knows better.
    """
    if options.turntable:
        return _turned(views, options, cell, tried)
    order, count = list(views), len(views)
    groups: list[Poses] = [{view: RigidTransform.identity()} for view in order]
    for step in range(1, count + 1):
        for first, second in zip(order, order[step:], strict=False):
            if not any(first in group and second in group for group in groups):
                tried[first, second] = _best(first, second, views, options, cell)
        last = step == count
        found = [pair for pair in tried.values() if good(pair, options) and (pair.evidence >= PROVEN or last)]
        for pair in sorted(found, key=lambda each: -each.evidence):  # again, as there are more to ask now
            groups = _joined(groups, pair, views, cell)
            if progress is not None:
                progress(max(map(len, groups)), count)
    return _in_order(max(groups, key=len))


def _best(first: int, second: int, views: Mapping[int, View], options: MergeOptions, cell: float) -> Pair:
    """Of the poses that turns lead to the likeliest; of those that shapes tell, too, where it is not proven.

    Each turn is a rival: none that is proven ends the search by itself, or objects that are nearly their own copies
    were tied by the first of their poses.
    """
    found: list[Pair] = []
    for starts in (turned_poses, shaped_poses):
        for start in starts(views[first], views[second], cell):
            if not any(alike(views[second], pair.pose, start, cell) for pair in found):
                found.append(fine_pair(first, second, views, start, cell))
        best = max(found, key=lambda each: _rank(each, options))
        if good(best, options) and best.evidence >= PROVEN:
            return best
    return max(found, key=lambda each: _rank(each, options))


def _rank(pair: Pair, options: MergeOptions) -> tuple[bool, float]:
    possible = good(pair, options)
    return possible, pair.evidence if possible else pair.overlap


def _joined(groups: list[Poses], pair: Pair, views: Mapping[int, View], cell: float) -> list[Poses]:
    """The groups, two of them made one by the pair, if all that they saw together proves it."""
    one, other = (next(group for group in groups if view in group) for view in (pair.first, pair.second))
    if one is other:
        return groups
    shift = one[pair.first] @ pair.pose @ other[pair.second].inverse()
    moved = {view: shift @ pose for view, pose in other.items()}
    said: dict[int, list[Sight]] = {view: [] for view in (*one, *moved)}
    for first, pose in one.items():
        for second, its in moved.items():
            by_first, by_second = both_sights(views[first], views[second], pose.inverse() @ its, cell)
            said[first].append(by_first)
            said[second].append(by_second)
    if not sum(map(evidence, said.values())) >= PROVEN:
        return groups
    return [one | moved if group is one else group for group in groups if group is not other]


def _repeated(step: RigidTransform, times: int) -> RigidTransform:
    return step if times == 1 else step @ _repeated(step, times - 1)


def _in_order(group: Poses) -> Poses:
    first = group[min(group)].inverse()
    return {view: first @ group[view] for view in sorted(group)}


def _turned(views: Mapping[int, View], options: MergeOptions, cell: float, tried: Tried) -> Poses:
    """The same on a turntable, where all steps are one motion: that which most of them fit. Over a view that is missing
    it is two of them."""
    order, angle = list(views), 2 * np.pi / options.turntable
    steps = [(a, b, (b - a) % options.turntable) for a, b in zip(order, [*order[1:], order[0]], strict=True)]
    best: list[Pair] = []
    for first, second, many in steps:
        if many > 1:
            continue
        pair = tried[first, second] = _best(first, second, views, options, cell)
        turned = float(np.linalg.norm(vector_from_rotation(pair.pose.R)))
        if not (good(pair, options) and abs(turned - angle) < 0.2 * angle):
            continue
        found = [fine_pair(a, b, views, _repeated(pair.pose, turns), cell) for a, b, turns in steps]
        found = [each for each in found if good(each, options)]
        best = found if len(found) > len(best) else best
        if len(best) >= len(order) - 1:
            break
    groups: list[Poses] = [{view: RigidTransform.identity()} for view in order]
    for pair in sorted(best, key=lambda each: -each.evidence):
        groups = _joined(groups, pair, views, cell)
    return _in_order(max(groups, key=len))
