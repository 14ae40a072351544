"""Captures judged as they are, and as they may be meant: a picture turned or mirrored back, x and y exchanged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from retrue.answers import Reason
from retrue.correspondences import Correspondences
from retrue.errors import DegenerateError
from retrue.rasters import MOST_MIRRORED, MOST_OUTSIDE, PictureMirrored, mirrored_share
from retrue.recalibration.fit import own_pose
from retrue.recalibration.judge import Judgement, judge, objection
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.reasons import (
    AxesExchanged,
    DevicesExchanged,
    PictureTurned,
    PoseInverted,
    PoseUndetermined,
    RivalUnbeaten,
    Undecidable,
)
from retrue.recalibration.rivals import evidence_across, move_deg, move_nats
from retrue.recalibration.swapped import FAR_MOVE_DEG
from retrue.recalibration.turned_pictures import Reading, axes_exchanged, inside, readings
from retrue.rig import Rig

FAR_TURN_DEG = 45.0  # what turns a picture moves the rig by more
SELDOM_TURNED = 7.0  # nats: one capture in a thousand is turned
SELDOM_EXCHANGED = 9.0  # and one in ten thousand has both axes exchanged
MAY_BE_MIRRORED = 0.5
"""Share of triangles that run the other way round: wrong points make half of theirs do so."""


@dataclass(frozen=True, slots=True, eq=False)
class _Read:
    """One way to read the captures, what it says, and how far the rig moved by it, in degrees."""

    reading: Reading
    judgement: Judgement
    moved_deg: float


def judge_as_meant(rig: Rig, captures: Sequence[Correspondences], options: RecalibrateOptions) -> Judgement:
    """`judge`, and whether a picture was turned or mirrored, or axes exchanged: its points then say that a device moved
    far, blame a lens, or lie beyond a raster.

    DegenerateError where no pose is determined, and where that is because a picture is not as it was.
    """
    share = mirrored_share(captures)
    mirrored = share > MAY_BE_MIRRORED
    if share > MOST_MIRRORED:
        raise Undecidable(_whose_mirrored(rig, captures, share, options))
    try:
        judgement = judge(rig, captures, options)
    except DegenerateError:
        back = _all_read(rig, _readings(rig, captures, mirrored=mirrored), options)
        if not back:
            raise
        raise Undecidable(_reason(min(back, key=lambda one: one.moved_deg), share, None)) from None
    moved = move_deg(judgement.answer.pose, own_pose(rig))
    if moved > FAR_TURN_DEG:
        judgement = _or_inverted(rig, judgement, moved, options)
    beyond = inside(rig, captures) < 1 - MOST_OUTSIDE
    turned = mirrored or beyond or moved > FAR_TURN_DEG or judgement.lens.verdict == "changed"
    if not (turned or moved > FAR_MOVE_DEG):
        return judgement
    meant = _readings(rig, captures, mirrored=mirrored) if turned else axes_exchanged(rig, captures)
    back = _all_read(rig, meant, options)
    seldom = [0.0 if beyond else _seldom(one.reading) for one in back]  # points beyond a raster are as seldom
    evidence = [_evidence(judgement, moved, one.judgement, one.moved_deg) for one in back]
    margins = np.add(evidence, seldom).tolist()
    if back and not min(margins) >= options.min_margin:
        read, exchanged = back[int(np.argmin(margins))], judgement.misread
        nearer = judgement.inverted or (exchanged if isinstance(exchanged, DevicesExchanged | PoseInverted) else None)
        if not (nearer is not None and nearer.meant_deg <= read.moved_deg):
            lens = replace(judgement.lens, verdict="unchecked")  # what was blamed is none of theirs
            return replace(judgement, misread=_reason(read, share, moved), lens=lens)
    return judgement


def _or_inverted(rig: Rig, judgement: Judgement, moved_deg: float, options: RecalibrateOptions) -> Judgement:
    """The same, and whether the rig's pose is written the other way round: seen from its inverse, the best of all poses
    then moved far less. Where that is another pose than the answer, the captures are misread."""
    inverse = own_pose(replace(rig, projector_from_camera=rig.projector_from_camera.inverse()))
    found = [(0.0, judgement.answer.pose)]
    found += [(one.points + one.light, one.posterior.pose) for one in judgement.rivals if one not in judgement.near]
    moves = [move_deg(pose, inverse) for _, pose in found]
    costs = [nats + move_nats(degrees) for (nats, _), degrees in zip(found, moves, strict=True)]
    best = int(np.argmin(costs))
    if costs[best] + SELDOM_TURNED - move_nats(moved_deg) >= options.min_margin:
        return judgement
    inverted = PoseInverted(moves[best], moved_deg)
    if best:
        return replace(judgement, misread=judgement.misread or inverted)
    misread = judgement.misread
    if isinstance(misread, DevicesExchanged):
        misread = replace(misread, inverted=inverted)
    return replace(judgement, inverted=inverted, misread=misread)


def _whose_mirrored(
    rig: Rig, captures: Sequence[Correspondences], share: float, options: RecalibrateOptions
) -> PictureMirrored:
    """Whose picture it is, and which way, where the points and the old pose tell."""
    back = _all_read(rig, readings(rig, captures, mirrored=True), options)
    if len(back) == 2:
        one, other = back
        margin = _evidence(one.judgement, one.moved_deg, other.judgement, other.moved_deg)
        back = [] if not abs(margin) >= options.min_margin else [one if margin > 0 else other]
    near = [one.reading for one in back if one.moved_deg <= FAR_TURN_DEG]  # else all may be seen in a mirror as well
    return PictureMirrored(share, near[0].device, near[0].quarters) if near else PictureMirrored(share)


def _reason(read: _Read, share: float, moved_deg: float | None) -> Reason:
    reading = read.reading
    if reading.device == "both":
        return AxesExchanged(read.moved_deg, moved_deg)
    if reading.mirrored:
        return PictureMirrored(share, reading.device, reading.quarters)
    return PictureTurned(reading.device, reading.quarters, read.moved_deg, moved_deg)


def _seldom(reading: Reading) -> float:
    return SELDOM_EXCHANGED if reading.device == "both" else SELDOM_TURNED


def _readings(rig: Rig, captures: Sequence[Correspondences], *, mirrored: bool) -> list[Reading]:
    """With a picture turned back, or axes exchanged back, and where one may be mirrored, mirrored back, too."""
    back = readings(rig, captures) + axes_exchanged(rig, captures)
    return back + (readings(rig, captures, mirrored=True) if mirrored else [])


def _all_read(rig: Rig, several: Sequence[Reading], options: RecalibrateOptions) -> list[_Read]:
    """Those readings through which the points have a pose that nothing but its sigma, or a rival, speaks against."""
    old, found = own_pose(rig), list[_Read]()
    for reading in several:
        try:
            judgement = judge(rig, reading.captures, options)
        except DegenerateError:
            continue
        if isinstance(objection(judgement, None, None, options), PoseUndetermined | RivalUnbeaten):
            found.append(_Read(reading, judgement, move_deg(judgement.answer.pose, old)))
    return found


def _evidence(one: Judgement, moved: float, other: Judgement, other_moved: float) -> float:
    """Nats for the first of two readings: what points say across their epipolar lines, and the moves."""
    return evidence_across(one.compared, other.compared) + move_nats(other_moved) - move_nats(moved)
