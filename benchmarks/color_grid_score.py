"""Score decoded block centres against the exact truth of a render."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.correspondences import Correspondences
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.patterns.color_grid import ColorGrid

WRONG_PITCHES = 0.5
MIN_BLOCK_PX = 6.0
NEARBY = 0.15  # pitches


@dataclass(frozen=True, slots=True, eq=False)
class BlockTruth:
    """Where each block really is: centre (rows, columns, 2) in camera pixels, NaN where it cannot be seen.

    `countable` marks the blocks that are wholly visible and at least 6 px wide along both sides.
    """

    centre: FloatArray
    countable: BoolArray
    side_px: FloatArray


@dataclass(frozen=True, slots=True)
class Score:
    """What a decoder made of one picture; `error_over_sigma` is 1 where each point's own sigma is right."""

    countable: int
    decoded: int
    points: int
    wrong: int
    rms_px: float
    worst_px: float
    error_over_sigma: float

    @property
    def recall(self) -> float:
        return self.decoded / self.countable if self.countable else float("nan")


def block_truth(pattern: ColorGrid, projector_px: FloatArray, visible: BoolArray, surface: IntArray) -> BlockTruth:
    """From the projector pixel (h, w, 2) that lights each camera pixel, and whether light gets there."""
    code = np.asarray(pattern.code)
    rows, columns = code.shape
    cell = (projector_px - np.asarray(pattern.origin)) / pattern.pitch
    with np.errstate(invalid="ignore"):
        nearest = np.round(cell)
        offset = cell - nearest
        half = 0.5 * pattern.block / pattern.pitch
        inside = visible & (np.abs(offset).max(axis=-1) <= half)
        inside &= (nearest >= 0).all(axis=-1) & (nearest[..., 0] < columns) & (nearest[..., 1] < rows)
    y, x = np.nonzero(inside)
    index = (nearest[y, x, 1] * columns + nearest[y, x, 0]).astype(np.int64)
    d = offset[y, x]
    count = np.bincount(index, minlength=code.size)
    first_surface = np.full(code.size, -1)
    first_surface[index] = surface[y, x]
    mixed = np.bincount(index, surface[y, x] != first_surface[index], minlength=code.size) > 0

    terms = np.stack([np.ones(len(x)), d[:, 0], d[:, 1], d[:, 0] ** 2, d[:, 0] * d[:, 1], d[:, 1] ** 2], axis=-1)
    nearby = np.exp(-np.sum((d / NEARBY) ** 2, axis=-1))  # so that a crease through the block does not bend the fit
    normal = np.zeros((code.size, 6, 6))
    right = np.zeros((code.size, 6, 2))
    for i in range(6):
        for j in range(6):
            normal[:, i, j] = np.bincount(index, nearby * terms[:, i] * terms[:, j], minlength=code.size)
        right[:, i, 0] = np.bincount(index, nearby * terms[:, i] * x, minlength=code.size)
        right[:, i, 1] = np.bincount(index, nearby * terms[:, i] * y, minlength=code.size)
    enough = count >= 12
    solution = np.full((code.size, 6, 2), np.nan)
    solution[enough] = np.linalg.solve(normal[enough] + 1e-9 * np.eye(6), right[enough])
    residual = np.einsum("ni,nij->nj", terms, solution[index]) - np.stack([x, y], axis=-1)
    spread = np.sqrt(
        np.bincount(index, nearby * (residual**2).sum(axis=-1), minlength=code.size) / np.maximum(count, 1)
    )

    a, b = solution[:, 1], solution[:, 2]
    ratio = pattern.block / pattern.pitch
    width, height = np.linalg.norm(a, axis=-1) * ratio, np.linalg.norm(b, axis=-1) * ratio
    determinant = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    area = np.abs(determinant) * ratio**2
    side = np.minimum(area / np.maximum(width, 1e-9), area / np.maximum(height, 1e-9))  # across, also when sheared
    centre = solution[:, 0]
    # A block is whole when the pixels that see it fill the area that its outline spans.
    whole = enough & (count > area - 1.2 * np.sqrt(np.maximum(area, 0))) & ~mixed & (spread < 0.3)
    countable = whole & (side >= MIN_BLOCK_PX)
    with np.errstate(invalid="ignore"):
        size = np.array(visible.shape[::-1])
        reach = (np.abs(a) + np.abs(b)) * ratio / 2
        countable &= ((centre - reach >= 0) & (centre + reach <= size - 1)).all(axis=-1)
    return BlockTruth(centre.reshape(rows, columns, 2), countable.reshape(rows, columns), side.reshape(rows, columns))


def score(pattern: ColorGrid, projector_px: FloatArray, truth: BlockTruth, points: Correspondences) -> Score:
    """Wrong: more than half a pitch between the decoded block and the one that lights that camera pixel."""
    cell = np.round((points.projector_px - np.asarray(pattern.origin)) / pattern.pitch).astype(int)
    at = truth.centre[cell[:, 1], cell[:, 0]]
    error = np.linalg.norm(points.camera_px - at, axis=-1)
    height, width = projector_px.shape[:2]
    pixel = np.clip(np.round(points.camera_px).astype(int), 0, [width - 1, height - 1])
    lit_by = projector_px[pixel[:, 1], pixel[:, 0]]
    off = np.abs(lit_by - points.projector_px).max(axis=-1) / pattern.pitch
    counted = truth.countable[cell[:, 1], cell[:, 0]]
    # A point is wrong when the pixel under it is not lit by its block; where the pixel sees nothing, also
    # when it is far from the block's true centre.
    wrong = ~(off <= WRONG_PITCHES) & ~(error <= 0.5 * truth.side_px[cell[:, 1], cell[:, 0]])
    right = counted & ~wrong
    close = error[right]
    sigma = np.ones(len(error)) if points.camera_sigma_px is None else points.camera_sigma_px
    return Score(
        countable=int(truth.countable.sum()),
        decoded=len(np.unique(cell[right] @ [1, 100_000])),
        points=len(points),
        wrong=int(wrong.sum()),
        rms_px=float(np.sqrt(np.mean(close**2))) if len(close) else float("nan"),
        worst_px=float(close.max()) if len(close) else float("nan"),
        error_over_sigma=float(np.sqrt(np.mean((close / sigma[right]) ** 2) / 2)) if len(close) else float("nan"),
    )
