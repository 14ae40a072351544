"""Static calibration: both intrinsics and the pose between the devices, from captures of a printed board.

see the board -> closed form -> one bundle adjustment -> leave out what does not fit -> judge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from retrue.answers import Reason
from retrue.calibration.board import Board
from retrue.calibration.bundle import Adjusted, adjust
from retrue.calibration.closed_form import first_camera, with_second
from retrue.calibration.evidence import gather_evidence, rms_px
from retrue.calibration.model_terms import Choice, choose_terms, fit_with_lens, with_honest_covariance
from retrue.calibration.observations import CornerObservations, View, corner_group, observation_groups, unknown_axes
from retrue.calibration.one_coordinate import squared
from retrue.calibration.options import CalibrationOptions
from retrue.calibration.reasons import (
    BoardNotSeen,
    BoardOfAnotherSize,
    BoardsParallel,
    CornersMiss,
    PointsUncertain,
    RigUndetermined,
    TooFewPoses,
)
from retrue.calibration.result import Calibrated, RefusedCalibration, fitted_views
from retrue.calibration.setup import Setup
from retrue.calibration.square_pixels import with_square_pixels
from retrue.calibration.uncertainty import normal_spread_deg, predicted_error
from retrue.calibration.views import BoardCapture, Capture, LeftOut, Progress, StereoCapture, picture_size, see_views
from retrue.errors import CaptureError, DegenerateError, InputError, require_kind, require_kinds
from retrue.geometry.arrays import FloatArray, IntArray
from retrue.geometry.camera import Camera
from retrue.rasters import picture_mirrored
from retrue.rig import Rig

Sizes = tuple[tuple[int, int], tuple[int, int]]
Known = tuple[Camera | None, Camera | None]


@dataclass(frozen=True, slots=True, eq=False)
class _Solution:
    fit: Adjusted
    choices: tuple[Choice, ...]
    views: list[View]
    dropped: list[int]


def calibrate(
    captures: Sequence[Capture],
    board: Board,
    projector_size: tuple[int, int] | None = None,
    options: CalibrationOptions | None = None,
    *,
    camera: Camera | None = None,
    projector: Camera | None = None,
    progress: Progress = lambda message: None,
) -> Calibrated | RefusedCalibration:
    """Calibrate camera and projector, or two cameras.

    Minimises the reprojection error of the board's corners in the camera, and of the decoded points on the board's
    plane in the projector (of its corners in the second camera), over both intrinsics, the relative pose and every
    pose of the board. Start: Zhang 2000; projector corners: Moreno and Taubin 2012.

    Parameters
    ----------
    captures : one a pose of the board, all `BoardCapture` or all `StereoCapture`.
    board : its unit becomes the rig's.
    projector_size : (width, height); of a second camera, its pictures tell.
    camera, projector : intrinsics that are known already and stay as they are.
    progress : told what is being done, from any thread.

    Raises
    ------
    InputError
        captures of mixed picture sizes, no capture at all, known intrinsics of another picture size.
    """
    require_kinds(captures, (BoardCapture, StereoCapture), "captures", "retrue.read_board_capture reads one")
    require_kind(board, Board, "board", "retrue.parse_board makes one of such a text")
    if options is not None:
        require_kind(options, CalibrationOptions, "options")
    sizes = _sizes(captures, projector_size, (camera, projector))
    if mirrored := picture_mirrored([capture.points for capture in captures if isinstance(capture, BoardCapture)]):
        return RefusedCalibration(mirrored)
    views, left_out = see_views(captures, board, progress)
    progress(f"fitting {len(views)} views")
    return calibrate_views(views, board, sizes, options, known=(camera, projector), left_out=left_out)


def calibrate_views(
    views: list[View],
    board: Board,
    sizes: Sizes,
    options: CalibrationOptions | None = None,
    *,
    known: Known = (None, None),
    left_out: Sequence[LeftOut] = (),
) -> Calibrated | RefusedCalibration:
    """`calibrate`, from views in which the board has been found; `left_out` had none."""
    options, left_out = options or CalibrationOptions(), list(left_out)
    if cause := _too_little(views, left_out, board, known):
        return RefusedCalibration(cause, {"left_out": _named(left_out)})
    try:
        solution = _solve(views, left_out, sizes, known, options)
    except DegenerateError as error:
        return RefusedCalibration(RigUndetermined(str(error)), {"left_out": _named(left_out)})
    return _judge(solution, left_out, board, (known[0] is not None, known[1] is not None), options)


def _solve(
    views: list[View],
    left_out: list[LeftOut],
    sizes: Sizes,
    known: Known,
    options: CalibrationOptions,
) -> _Solution:
    """The fit, without the views and corners that contradict the rest; those views are added to `left_out`."""
    fixed = (known[0] is not None, known[1] is not None)
    unknown = unknown_axes(views)
    fit = fit_with_lens(start(views, sizes, known), observation_groups(views, dense=False), fixed, ("k1",), unknown)
    while (better := _without_a_bad_view(fit, views, options)) is not None:
        fit, views, bad = better
        left_out.append(bad)
    groups = observation_groups(views, options.dense)
    fit = adjust(fit.setup, groups, fit.active)
    dropped, choices = np.zeros(len(views), dtype=int), tuple[Choice, ...]()
    for _ in range(2):  # terms first: of a flat board, corners of a bent one look wrong
        fit, choices = choose_terms(fit, groups, fixed)
        views, counts = _without_outliers(fit, views, options)
        dropped += counts
        groups = observation_groups(views, options.dense)
        fit = adjust(fit.setup, groups, fit.active, scales=fit.scales)
    fit, choices = with_square_pixels(with_honest_covariance(fit, groups, fixed), groups, choices)
    if known[1] is None:
        fit = replace(fit, setup=squared(fit.setup, unknown, views))
    return _Solution(fit, choices, views, dropped.tolist())


def start(views: list[View], sizes: Sizes, known: Known) -> Setup:
    """Closed form for the camera, refined by itself, then closed form for the second device."""
    setup = first_camera(views, sizes[0], known[0])
    # The principal point last: without k1, a lens drives it away.
    for free in (("fx", "fy", "k1"), ("fx", "fy", "cx", "cy", "k1")):
        active = np.zeros(setup.columns.shared, dtype=bool)
        active[[setup.columns.intrinsic(0, name) for name in free]] = known[0] is None
        setup = adjust(setup, (corner_group(views, 0),), active).setup
    return with_second(setup, views, sizes[1], known[1])


def _without_a_bad_view(
    fit: Adjusted, views: list[View], options: CalibrationOptions
) -> tuple[Adjusted, list[View], LeftOut] | None:
    """The fit without the view that contradicts the others; None where none does.

    A bad view pulls the fit towards itself, so its own error does not tell: that the others fit far better without
    it does. Of three views, it cannot be said which is wrong.
    """
    if len(views) < 4:
        return None
    for index in map(int, np.argsort(-_suspicion(fit, views))[:2]):
        rest = views[:index] + views[index + 1 :]
        try:
            without = adjust(fit.setup.without(index), observation_groups(rest, dense=False), fit.active)
        except DegenerateError:
            continue
        pairs = zip(fit.scales, without.scales, strict=True)
        gain = max(float(np.max(before / after)) for before, after in pairs)
        if gain > options.view_limit:
            reason = f"the other views fit {gain:.0f} times better without it; did the board move during the capture?"
            return without, rest, LeftOut(views[index].name, reason)
    return None


def _suspicion(fit: Adjusted, views: list[View]) -> FloatArray:
    """How much each view misses, over what is usual, in the group where that is most."""
    suspicion = np.ones(len(views))
    for group, error, scale in zip(observation_groups(views, dense=False), fit.errors, fit.scales, strict=True):
        size = np.linalg.norm(error / scale, axis=1) / group.sigma
        own = [size[group.view == index] for index in range(len(views))]
        typical = np.array([np.median(sizes) if len(sizes) else np.nan for sizes in own])
        suspicion = np.fmax(suspicion, typical / np.nanmedian(typical))
    return suspicion


def _without_outliers(fit: Adjusted, views: list[View], options: CalibrationOptions) -> tuple[list[View], IntArray]:
    """The views without the corners that miss by too many sigmas, and how many those were."""
    bad = [np.zeros(len(view.board_xy), dtype=bool) for view in views]
    for error, scale, group in zip(fit.errors, fit.scales, observation_groups(views, options.dense), strict=True):
        if isinstance(group, CornerObservations):
            misses = np.linalg.norm(error / scale, axis=1) / group.sigma > options.corner_limit
            for index, view in enumerate(views):
                seen = view.seen(group.device)
                own = seen[misses[group.view == index]]
                if len(own) <= len(seen) - 8:
                    bad[index][own] = True
    trimmed = [
        replace(view, pixels=tuple(np.where(own[:, None], np.nan, pixels) for pixels in view.pixels))
        for view, own in zip(views, bad, strict=True)
    ]
    return trimmed, np.array([own.sum() for own in bad])


def _judge(
    solution: _Solution, left_out: list[LeftOut], board: Board, fixed: tuple[bool, bool], options: CalibrationOptions
) -> Calibrated | RefusedCalibration:
    fit, views = solution.fit, solution.views
    error = predicted_error(fit)
    evidence = gather_evidence(fit, views, left_out, solution.dropped, solution.choices, fixed, error, board.unit)
    evidence, fitted = _finite(evidence), fitted_views(fit, views)
    angle = normal_spread_deg(fit)
    what_next = "; ".join(evidence["advice"]) or "capture more poses"
    if not all(fixed) and not angle > 5:
        return RefusedCalibration(BoardsParallel(angle, what_next), evidence, fitted)
    missed = rms_px(fit, views)["all"]
    if not missed <= options.largest_rms_px:
        return RefusedCalibration(CornersMiss(missed, options.largest_rms_px), evidence, fitted)
    if not error.relative <= options.largest_error:
        cause = PointsUncertain(error.length, error.distance, board.unit, what_next)
        return RefusedCalibration(cause, evidence, fitted)
    camera, projector = fit.setup.devices
    rig = Rig(camera, projector, fit.setup.second_from_first, board.unit, evidence)
    reason = (
        f"{len(views)} poses, corners within {evidence['rms_px']:.2f} px RMS, points within {error.length:.2g} "
        f"{board.unit} at {error.distance:.4g} {board.unit}"
    )
    return Calibrated(rig, reason, evidence, fitted)


def _too_little(views: list[View], left_out: list[LeftOut], board: Board, known: Known) -> Reason | None:
    """Why these views cannot do, before any fit."""
    if not views:
        return BoardNotSeen(tuple((view.name, view.reason) for view in left_out))
    spans = [np.ptp(view.board_xy, axis=0) / board.spacing for view in views]
    grids = {(round(float(span[0])) + 1, round(float(span[1])) + 1) for span in spans}
    if board.kind == "chessboard" and len(views) > 1 and len(grids) == 1 and not any(v.complete for v in views):
        return BoardOfAnotherSize((board.columns, board.rows), next(iter(grids)))
    if len(views) < 2 and not all(known):
        return TooFewPoses(tuple((view.name, view.reason) for view in left_out))
    return None


def _sizes(captures: Sequence[Capture], projector_size: tuple[int, int] | None, known: Known) -> Sizes:
    if not captures:
        raise InputError("calibration: expected captures of the board, found none")
    first = captures[0]
    if isinstance(first, StereoCapture):
        sizes = picture_size(first.left), picture_size(first.right)
    elif projector_size is not None:
        sizes = picture_size(first.white), projector_size
        _require_patterns(captures, projector_size)
    else:
        raise InputError("calibration: expected the size of the projector's picture, found none")
    for name, size, camera in zip(("camera", "projector"), sizes, known, strict=True):
        if camera is not None:
            require_kind(camera, Camera, name, "retrue.read_device reads one")
        if camera is not None and camera.size != size:
            raise InputError(
                f"{name}: expected known intrinsics of {size[0]} x {size[1]} pixels, "
                f"found {camera.size[0]} x {camera.size[1]}"
            )
    return sizes


def _require_patterns(captures: Sequence[Capture], projector_size: tuple[int, int]) -> None:
    for capture in captures:
        size = capture.points.projector_size if isinstance(capture, BoardCapture) else None
        if size is not None and size != tuple(projector_size):
            raise CaptureError(
                capture.name,
                f"decoded by a pattern for a projector of {size[0]} x {size[1]}, "
                f"expected {projector_size[0]} x {projector_size[1]}",
            )


def _named(left_out: list[LeftOut]) -> list[dict[str, str]]:
    return [{"name": view.name, "reason": view.reason} for view in left_out]


def _finite(value: Any) -> Any:
    """The same, with null for what is not finite: JSON has no NaN."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in cast(dict[str, Any], value).items()}
    if isinstance(value, list):
        return [_finite(item) for item in cast(list[Any], value)]
    return None if isinstance(value, float) and not np.isfinite(value) else value
