"""Two photographs of one scene -> correspondences: matched, aligned, one a place, spread over the picture."""

from __future__ import annotations

from typing import cast

import cv2
import numpy as np

from retrue.correspondences import Card, Correspondences
from retrue.decoding.photographs.alignment import Aligned, align
from retrue.decoding.photographs.features import match_sift
from retrue.decoding.pictures import coverage
from retrue.errors import CaptureError, InputError
from retrue.geometry.arrays import BoolArray, FloatArray, Image, IntArray
from retrue.patterns.photographs import Matches, Photographs

SPREAD_CELLS = 256  # of the picture, from which matches are taken in turn
NEAREST_PX = 3.0  # matches nearer than this, in both photographs, are one place
FARTHEST_LEVELS = 0.1, 99.9  # percentiles that become black and white
LEAST_RANGE = 8  # grey levels of 255; what has less is one colour
SIGMA_FACTOR = 1.2  # by which alignments of simulated pictures with known geometry are worse than their residual says
SIGMA_FLOOR_PX = 0.07  # what JPEG of quality 85 adds to the finest of them
GOOD_COUNT = 60


def match_photographs(asked: Photographs, left: Image, right: Image) -> Correspondences:
    """Places that both photographs show.

    Parameters
    ----------
    left, right : of the first and of the second camera, (h, w) or (h, w, 3), red green blue, uint8 or uint16; their
        sizes may differ.

    Returns
    -------
    Correspondences
        `camera_px` in the first, `projector_px` in the second, sigma of each from its own alignment, colours of the
        first, the size of both. The card counts features of the first; its advice says what the photographs lack.

    Raises
    ------
    InputError : what is no picture.
    CaptureError : the same photograph twice.
    """
    pictures = [_checked(image, name) for image, name in ((left, "left"), (right, "right"))]
    if np.array_equal(pictures[0], pictures[1]) and pictures[0].min() < pictures[0].max():
        raise CaptureError("photographs", "expected one of each camera, found the same twice")
    grey = [grey_levels(picture) for picture in pictures]
    sharp = [np.clip(np.rint(level), 0, 255).astype(np.uint8) for level in grey]
    if asked.matcher is None:
        matches, counts = match_sift(sharp[0], sharp[1], asked.most_features, asked.ratio)
    else:
        matches = asked.matcher.match(sharp[0], sharp[1])
        counts = (len(matches), len(matches))
    aligned = align(grey[0], grey[1], matches)
    good = aligned.settled & (aligned.likeness >= asked.min_likeness)
    right_px, sigma = _settled(matches, aligned, good)
    kept = good if matches.sigma_px is None else good | _within(matches, grey)
    rows = np.flatnonzero(kept)
    rows = rows[np.argsort(sigma[rows], kind="stable")]
    rows = rows[_one_a_place(matches.left_px[rows], right_px[rows])]
    places = len(rows)
    rows = np.sort(_spread(matches.left_px, rows, (left.shape[1], left.shape[0]), asked.most_points))
    height, width = left.shape[:2]
    each = sigma[rows] / np.sqrt(2)  # what the alignment knows is the difference; both photographs have their part
    return Correspondences(
        matches.left_px[rows],
        right_px[rows],
        each,
        each,
        matches.confidence[rows],
        _colors(pictures[0], matches.left_px[rows]),
        card=Card(
            "features",
            counts[0],
            len(rows),
            {
                "without a partner": counts[0] - len(matches),
                "look different": len(matches) - int(kept.sum()),
                "the same place twice": int(kept.sum()) - places,
                "more than asked for": places - len(rows),
            },
            coverage(matches.left_px[rows], width, height),
            _advice(pictures, counts, len(rows)),
            {"sigma_px": float(np.median(sigma[rows])) if len(rows) else None},
        ),
        camera_size=(width, height),
        projector_size=(right.shape[1], right.shape[0]),
    )


def grey_levels(picture: Image) -> Image:
    """(h, w) float32, 0 to 255 from its darkest to its brightest parts, of a grey or colour picture of 8 or 16 bits."""
    grey = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
    full = 255 if picture.dtype == np.uint8 else 65535
    dark, bright = np.percentile(grey[::4, ::4], FARTHEST_LEVELS)
    bright = max(bright, dark + LEAST_RANGE * full / 255)
    return ((grey.astype(np.float32) - dark) * (255 / (bright - dark))).astype(np.float32)


def _checked(image: Image, name: str) -> Image:
    """The picture, grey or in three channels, or an `InputError` that names it."""
    fits = image.dtype.name in ("uint8", "uint16") and image.size > 0
    if fits and image.ndim == 3 and image.shape[2] == 1:
        return image[..., 0]
    if not (fits and (image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 3))):
        raise InputError(
            f"{name}: expected a photograph (h, w) or (h, w, 3) of uint8 or uint16, found {image.dtype} {image.shape}"
        )
    return np.ascontiguousarray(image)


def _settled(matches: Matches, aligned: Aligned, good: BoolArray) -> tuple[FloatArray, FloatArray]:
    """(N, 2) where each match is in the right photograph, and (N,) its sigma: aligned, or as the matcher has it."""
    sigma = np.hypot(SIGMA_FLOOR_PX, SIGMA_FACTOR * aligned.sigma_px)
    if matches.sigma_px is not None:
        sigma = np.where(good, np.minimum(sigma, matches.sigma_px), matches.sigma_px)
    return np.where(good[:, None], aligned.right_px, matches.right_px), sigma


def _within(matches: Matches, pictures: list[Image]) -> BoolArray:
    """(N,) matches that lie in both pictures."""
    inside = np.ones(len(matches), dtype=np.bool_)
    for pixels, picture in zip((matches.left_px, matches.right_px), pictures, strict=True):
        inside &= np.all((pixels >= -0.5) & (pixels <= np.array(picture.shape[::-1]) - 0.5), axis=1)
    return inside


def _one_a_place(left: FloatArray, right: FloatArray) -> IntArray:
    """Rows of those that are nobody's neighbour that came before: a feature with two sizes counts once."""
    taken: dict[tuple[int, int], list[int]] = {}
    kept: list[int] = []
    cells = np.floor(left / NEAREST_PX).astype(np.int64)
    for row, (x, y) in enumerate(cells.tolist()):
        near = [other for dx in (-1, 0, 1) for dy in (-1, 0, 1) for other in taken.get((x + dx, y + dy), ())]
        if near:
            gaps = [np.hypot(*(pixels[near] - pixels[row]).T) for pixels in (left, right)]
            if bool(np.any((gaps[0] < NEAREST_PX) & (gaps[1] < NEAREST_PX))):
                continue
        taken.setdefault((x, y), []).append(row)
        kept.append(row)
    return np.array(kept, dtype=np.int64)


def _spread(left: FloatArray, rows: IntArray, size: tuple[int, int], most: int) -> IntArray:
    """At most so many of `rows`, which come best first: from each part of the picture in turn, its best."""
    if len(rows) <= most:
        return rows
    side = np.sqrt(size[0] * size[1] / SPREAD_CELLS)
    cell = np.floor(left[rows] / side).astype(np.int64) @ np.array([1, 1 + int(size[0] / side)])
    order = np.argsort(cell, kind="stable")
    starts = cast(IntArray, np.searchsorted(cell[order], cell[order]))
    turn = np.empty(len(rows), dtype=np.int64)
    turn[order] = np.arange(len(rows)) - starts  # the how manieth of its part
    return rows[np.lexsort((np.arange(len(rows)), turn))[:most]]


def _colors(picture: Image, places: FloatArray) -> np.ndarray:
    """(N, 3) uint8 at the nearest pixels."""
    column, row = np.rint(places).astype(np.int64).T
    height, width = picture.shape[:2]
    found = picture[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)]
    if found.dtype != np.uint8:
        found = (found // 257).astype(np.uint8)
    return found if found.ndim == 2 else np.repeat(found[:, None], 3, axis=1)


def _advice(pictures: list[Image], counts: tuple[int, int], points: int) -> tuple[str, ...]:
    """What to do about few matches; nothing where there are enough."""
    if points >= GOOD_COUNT:
        return ()
    said: list[str] = []
    for picture, name, count in zip(pictures, ("first", "second"), counts, strict=True):
        levels = np.percentile(picture[::4, ::4], FARTHEST_LEVELS) * (1 if picture.dtype == np.uint8 else 255 / 65535)
        if levels[1] < 40:
            said.append(f"the {name} camera's photograph is too dark: expose longer")
        elif levels[0] > 230:
            said.append(f"the {name} camera's photograph is overexposed: expose shorter")
        elif count < GOOD_COUNT:
            said.append(f"the {name} camera's photograph shows next to no texture: focus it, or show more of the scene")
    return tuple(said) or ("the photographs share few places: do both cameras see the same scene, at the same time?",)
