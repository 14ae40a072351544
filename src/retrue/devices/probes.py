"""The pixels of a camera by which frames are told apart, and how much of the projector's light each of them sees."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from retrue.devices.references import BANDS, References
from retrue.geometry.arrays import FloatArray, Image

PROBES = 24  # pixels of each band
FEWEST_PROBES = 6
LIT = 0.4  # of the contrast of the best pixels: what is darker says little
SATURATED = 252


@dataclass(frozen=True, eq=False)
class Probes:
    """Pixels, in the middle row of each band, in which the projector's light is seen best.

    Attributes
    ----------
    index : (BANDS, PROBES) of flattened pixels.
    lit : (BANDS,) whether there are enough of them.
    black, white : (BANDS, PROBES, channels) what they look like.
    height : rows of the picture.
    """

    index: NDArray[np.intp]
    lit: NDArray[np.bool_]
    black: FloatArray
    white: FloatArray
    height: int

    @cached_property
    def edges(self) -> FloatArray:
        """(BANDS, 2) first and last row of each band, as shares of the picture."""
        parts = np.array_split(np.arange(self.height), BANDS)
        return np.array([(part[0], part[-1]) for part in parts]) / max(self.height - 1, 1)

    @cached_property
    def middle(self) -> FloatArray:
        """(BANDS,) where the probes are, as a share of the picture's height."""
        return self.edges.mean(axis=1)

    def of(self, levels: Image) -> FloatArray:
        """(BANDS, PROBES, channels)."""
        return levels.reshape(-1, 1 if levels.ndim == 2 else levels.shape[2])[self.index].astype(np.float64)

    def light(self, seen: FloatArray, gamma: float) -> FloatArray:
        """(..., BANDS, PROBES) 0 in black, 1 in white, and linear in the light between them."""
        black, white = ((end / 255) ** gamma for end in (self.black, self.white))
        top, span = ((seen / 255) ** gamma - black).sum(axis=-1), (white - black).sum(axis=-1)
        return np.where(self.lit[:, None], top / np.where(self.lit[:, None], span, 1.0), 0.0)


def find_probes(references: References) -> Probes:
    """Those of a rig, from what its white and black look like."""
    white, black = (
        picture.reshape(*picture.shape[:2], -1).astype(np.float64) for picture in (references.white, references.black)
    )
    height, width = int(white.shape[0]), int(white.shape[1])
    contrast = (white - black).sum(axis=2)
    contrast[white.max(axis=2) > SATURATED] = 0
    parts: list[NDArray[np.intp]] = np.array_split(np.arange(height), BANDS)
    rows = [int(part.mean()) for part in parts]
    least = LIT * np.percentile(contrast[rows], 95)
    index, lit = np.zeros((BANDS, PROBES), np.intp), np.zeros(BANDS, bool)
    for band, row in enumerate(rows):
        good = np.flatnonzero(contrast[row] >= least) if least > 0 else np.zeros(0, np.intp)
        lit[band] = len(good) >= FEWEST_PROBES
        if lit[band]:
            index[band] = row * width + good[np.linspace(0, len(good) - 1, PROBES).round().astype(int)]
    ends = [picture.reshape(height * width, -1)[index] for picture in (black, white)]
    return Probes(index, lit, ends[0], ends[1], height)
