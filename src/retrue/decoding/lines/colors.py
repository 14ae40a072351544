"""Which colour each line has, from what the picture itself shows of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from retrue.geometry.arrays import BoolArray, FloatArray

DISPLAY_GAMMA = 2.2
ROUNDS = 6
FEWEST = 8  # lines of a colour that its class follows
SPREAD = 0.22  # of the direction of one colour's light, one standard deviation
NOISE = 3.0  # grey levels of the light that a line adds
MISTAKEN = 0.1  # of the lines, whose light tells nothing


@dataclass(frozen=True, slots=True, eq=False)
class Colors:
    """How the colours of one family of lines look in one picture.

    Attributes
    ----------
    centres : (K, 3) unit vectors, the direction of the light of each colour.
    usual : (K,) median size of it.
    """

    centres: FloatArray
    usual: FloatArray

    def faint(self, light: FloatArray, share: float) -> BoolArray:
        """(N,) whether light (N, 3) is less than that share of what its colour usually adds."""
        unit, size = _directions(light)
        return size < share * self.usual[np.nan_to_num(unit @ self.centres.T).argmax(axis=1)]

    def likelihood(self, light: FloatArray) -> FloatArray:
        """Nats (N, K) by which light (N, 3) speaks for each colour, over a colour drawn by chance; 0 of light NaN."""
        unit, size = _directions(light)
        spread = SPREAD**2 + (NOISE / np.maximum(size, 1e-9)) ** 2
        square = ((unit[:, None] - self.centres) ** 2).sum(axis=-1)
        chance = np.exp(-0.5 * (square - square.min(axis=1, keepdims=True)) / spread[:, None])
        chance /= chance.sum(axis=1, keepdims=True)
        count = len(self.centres)
        nats = np.log((1 - MISTAKEN) * chance * count + MISTAKEN)
        return np.where(np.isfinite(nats), nats, 0.0)


def fit_colors(light: FloatArray, palette: ArrayLike, gain: FloatArray) -> Colors:
    """Classes of `light` (N, 3) for the colours of a `palette` (K, 3), where white adds about `gain` (3,).

    They start where projector and camera would have them without crosstalk, and move to where the picture has them.
    """
    linear = (np.asarray(palette, dtype=np.float64) / 255.0) ** (DISPLAY_GAMMA / 2)
    centres, _ = _directions(linear * gain)
    unit, size = _directions(light)
    seen = np.isfinite(unit).all(axis=1) & (size > NOISE)
    unit, size = unit[seen], size[seen]
    label = np.zeros(len(unit), np.int64)
    for _ in range(ROUNDS if len(unit) else 0):
        label = (unit @ centres.T).argmax(axis=1)
        moved = np.stack([unit[label == k].sum(axis=0) + FEWEST * centres[k] for k in range(len(centres))])
        centres, _ = _directions(moved)
    of_color = [size[label == k] for k in range(len(centres))]
    return Colors(centres, np.array([np.median(sizes) if len(sizes) >= FEWEST else 0.0 for sizes in of_color]))


def _directions(light: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit vectors (N, 3) and sizes (N,)."""
    light = np.maximum(light, 0.0)
    size = np.linalg.norm(light, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return light / size[..., None], size
