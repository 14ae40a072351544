"""Every pixel of the first photograph that the second one shows too: semi-global matching, checked from both sides.

Source: Hirschmueller, "Stereo processing by semiglobal matching and mutual information", 2008, as OpenCV has it.
"""

from __future__ import annotations

from typing import Any, cast

import cv2
import numpy as np

from retrue.correspondences import Card, Correspondences
from retrue.decoding.photographs.match_photographs import grey_levels
from retrue.decoding.photographs.rectify import Rectification, rectify
from retrue.errors import CaptureError
from retrue.geometry.arrays import BoolArray, FloatArray, Image
from retrue.rig import Rig

BLOCK = 5  # px
SMOOTH, JUMP = 8 * BLOCK**2, 32 * BLOCK**2  # cost of a disparity that changes by one, and by more
UNIQUE = 10  # percent by which the best disparity must win
SPECKLE_PX, SPECKLE_STEP = 100, 2
STEPS = 16  # of one pixel of disparity
DISAGREE_PX = 1.0
MARGIN = 0.25  # of the range of disparities of the matches, added at both ends
MOST_DISPARITIES = 1024
WINDOW = 7  # px, in which both pictures are aligned last
REFINEMENTS = 2
SMOOTH_PX = 1.0
LEAST_SLOPE = 0.7  # grey levels a pixel
ON_ITS_ROW_PX = 2.0
LEAST_SIGMA_PX = 0.03
SIGMA_FACTOR = 1.9  # by which disparities of simulated pairs are worse than their residual says
PARABOLA_SIGMA_PX = 0.3
FEW_MATCHES = 12


def match_densely(rig: Rig, left: Image, right: Image, matches: Correspondences) -> Correspondences:
    """Where the second photograph shows each pixel of the first, for the pose that the rig has.

    Parameters
    ----------
    left, right : as in `match_photographs`.
    matches : of the same pair: the range of depths is theirs.

    Returns
    -------
    Correspondences
        `camera_px` whole pixels, `cells` the same as (row, column); `projector_px` in the second photograph, with the
        sigma of its disparity: depth has (Z^2 / f b) times that. No residual across rows checks such points: they are
        on the epipolar lines of the rig.

    Raises
    ------
    CaptureError : the matches do not fit the rig, so that rows of both photographs show other things.
    DegenerateError : as `rectify`.
    """
    plan = rectify(rig)
    disparity = _disparities_of(plan, rig, matches)
    sides = (rig.camera, plan.first_turn), (rig.projector, plan.second_turn)
    pictures = [plan.picture(grey_levels(p), *side) for p, side in zip((left, right), sides, strict=True)]
    least, count = _range(disparity)
    first, noise = refined(pictures, _checked(pictures, least, count))
    height, width = map(int, left.shape[:2])
    grid = np.stack(np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64)), axis=-1)
    at = np.nan_to_num(plan.rectified_px(rig.camera, plan.first_turn, grid), nan=-9.0).astype(np.float32)
    shift = _looked_up(first, at)
    there = plan.photograph_px(rig.projector, plan.second_turn, at - np.stack([shift, np.zeros_like(shift)], axis=-1))
    kept = np.isfinite(there).all(axis=-1) & rig.projector.contains(np.nan_to_num(there, nan=-9.0))
    row, column = np.nonzero(kept)
    sigma = cast(FloatArray, cv2.remap(noise, at, cast(Any, None), cv2.INTER_NEAREST)[row, column])
    sigma = sigma * _focal_ratio(rig, plan)
    color = left if left.dtype == np.uint8 else (left // 257).astype(np.uint8)
    colors = color[row, column].reshape(len(row), -1)
    return Correspondences(
        np.stack([column, row], axis=-1).astype(np.float64),
        there[row, column],
        np.full(len(row), 1e-3),
        sigma,
        colors=np.repeat(colors, 3, axis=1) if colors.shape[1] == 1 else colors,
        cells=np.stack([row, column], axis=-1),
        card=Card(
            "pixels",
            width * height,
            len(row),
            {"no unique partner": width * height - len(row)},
            len(row) / (width * height),
            details={
                "disparities": [least, least + count],
                "disparity_sigma_px": float(np.median(sigma)) if len(row) else None,
            },
        ),
        camera_size=rig.camera.size,
        projector_size=rig.projector.size,
    )


def _disparities_of(plan: Rectification, rig: Rig, matches: Correspondences) -> FloatArray:
    """(N,) of the matches that lie on one row, or a `CaptureError` where few do."""
    first = plan.rectified_px(rig.camera, plan.first_turn, matches.camera_px)
    second = plan.rectified_px(rig.projector, plan.second_turn, matches.projector_px)
    found = first - second
    good = np.isfinite(found).all(axis=1) & (np.abs(found[:, 1]) <= ON_ITS_ROW_PX)
    good &= found[:, 0] * np.sign(plan.baseline) > -ON_ITS_ROW_PX  # in front of both cameras
    if np.count_nonzero(good) < max(FEW_MATCHES, len(matches) / 3):
        raise CaptureError(
            "photographs",
            f"{np.count_nonzero(good)} of {len(matches)} matches lie on the rig's epipolar lines: recalibrate first",
        )
    return found[good, 0]


def _range(disparity: FloatArray) -> tuple[int, int]:
    """The least disparity that is looked for, and how many, a multiple of 16."""
    low, high = np.percentile(disparity, [1, 99])
    reach = MARGIN * (high - low) + 4
    least, most = int(np.floor(low - reach)), int(np.ceil(high + reach))
    return least, min(16 * (1 + (most - least) // 16), MOST_DISPARITIES)


def _checked(pictures: list[Image], least: int, count: int) -> FloatArray:
    """(h, w) disparity of the first picture that the second one's own, found by itself, agrees with; NaN elsewhere."""
    levels = [np.clip(np.rint(picture), 0, 255).astype(np.uint8) for picture in pictures]
    first = _disparity(levels[0], levels[1], least, count)
    mirrored = [np.ascontiguousarray(picture[:, ::-1]) for picture in levels]
    second = _disparity(mirrored[1], mirrored[0], least, count)[:, ::-1]
    width = int(first.shape[1])
    column = np.arange(width, dtype=np.float64) - np.nan_to_num(first, nan=-1e6)
    nearest = np.rint(column).astype(np.int64)
    there = (nearest >= 0) & (nearest < width)
    back = np.where(there, np.take_along_axis(second, np.clip(nearest, 0, width - 1), axis=1), np.nan)
    with np.errstate(invalid="ignore"):
        agreed: BoolArray = np.abs(first - back) <= DISAGREE_PX
    return np.where(agreed, first, np.nan)


def _disparity(first: Image, second: Image, least: int, count: int) -> FloatArray:
    finder = cv2.StereoSGBM.create(
        least, count, BLOCK, SMOOTH, JUMP, -1, 0, UNIQUE, SPECKLE_PX, SPECKLE_STEP, cv2.STEREO_SGBM_MODE_SGBM_3WAY
    )
    padded = [cv2.copyMakeBorder(side, 0, 0, *_padding(least, count), cv2.BORDER_REPLICATE) for side in (first, second)]
    found = finder.compute(padded[0], padded[1]).astype(np.float64) / STEPS
    before = _padding(least, count)[0]
    found = found[:, before : before + first.shape[1]]
    return np.where(found > least - 1 + 1 / STEPS, found, np.nan)


def refined(pictures: list[Image], disparity: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The disparity (h, w) moved to where a window of both pictures agrees best, by least squares along the row.

    Semi-global matching fits a parabola to costs of whole pixels, which is a fifth of a pixel off. Where no slope
    tells, or the window lies over a jump of depth, it stays. With its sigma (h, w): var(residual) over the slopes of
    the window, as of a match; where it stayed, the parabola's.
    """
    height, width = disparity.shape
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    known = np.isfinite(disparity)
    left = pictures[0].astype(np.float32)
    sigma = np.full(disparity.shape, PARABOLA_SIGMA_PX)
    for _ in range(REFINEMENTS):
        mean = _windowed(np.where(known, disparity, 0.0)) / np.maximum(_windowed(known.astype(np.float64)), 1e-6)
        smooth = known & (np.abs(mean - disparity) < SMOOTH_PX)
        shifted = np.where(known, mean, 0.0).astype(np.float32)
        warped = cv2.remap(pictures[1], x - shifted, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        slope = cv2.Sobel((left + warped) / 2, cv2.CV_32F, 1, 0, ksize=1) / 2
        gap = left - warped
        gap = (gap - _windowed(gap)) * smooth
        steep = _windowed(slope * slope * smooth)
        step = _windowed(slope * gap) / np.maximum(steep, 1e-6)  # warped(x + e) = left(x): the disparity shrinks by e
        sure = smooth & (steep > LEAST_SLOPE**2) & (np.abs(step) < SMOOTH_PX)
        disparity = np.where(sure, mean - step, disparity)
        held = np.maximum(_windowed(smooth), 1e-6)  # the rest of the window is of another surface, and bends the step
        rest = np.maximum(_windowed(((gap - slope * step) * smooth) ** 2), 0) / held
        known_to = SIGMA_FACTOR * np.sqrt(rest / np.maximum(steep, 1e-6)) / (held * WINDOW)
        sigma = np.where(sure, np.hypot(LEAST_SIGMA_PX, known_to), sigma)
    return disparity, np.minimum(sigma, DISAGREE_PX)


def _windowed(values: Any) -> FloatArray:
    """(h, w) mean over a window about each pixel."""
    return cast(FloatArray, cv2.blur(np.asarray(values, dtype=np.float64), (WINDOW, WINDOW)))


def _padding(least: int, count: int) -> tuple[int, int]:
    """Columns before and after a picture, so that its own borders are matched too."""
    return max(least + count, 0), max(-least, 0)


def _looked_up(disparity: FloatArray, at: Any) -> FloatArray:
    """Between its four neighbours where all are known; NaN elsewhere."""
    return cv2.remap(disparity, at, cast(Any, None), cv2.INTER_LINEAR, borderValue=np.nan).astype(np.float64)


def _focal_ratio(rig: Rig, plan: Rectification) -> float:
    """Pixels of the second photograph to one of the rectified picture."""
    K = rig.projector.K
    return float(np.sqrt(K[0, 0] * K[1, 1]) / plan.view.K[0, 0])
