"""What the camera sees of pictures that are known, and how much two frames of one thing differ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import cv2
import numpy as np

from retrue.geometry.arrays import FloatArray, Image

BANDS = 24  # of rows, in which frames are compared: a change that rolls over the picture is in some of them
NOISE_FACTOR = 1.1  # by which the noise of a pair may exceed its usual level
FEWEST_LIT = 0.2  # of the light of the brightest band: a darker one says nothing of what is shown
DRIFT = 0.02  # of white over black, between a reference and a later frame of the same
SMALL = (64, 48)  # pixels: of a picture in which noise is averaged out
LEVELS_16_BIT = 257  # of 65535, to one of 255


@dataclass(frozen=True)
class References:
    """White, black and the tags as the camera sees them.

    Attributes
    ----------
    white, black : (h, w) or (h, w, 3) uint8.
    tags : the same of each of `tag_pictures`; empty where no passes are run.
    white_noise, black_noise : (BANDS,) mean difference of two frames of the same, in grey levels.
    agree_levels : what two frames may differ beyond their noise.
    """

    white: Image
    black: Image
    tags: tuple[Image, ...]
    white_noise: FloatArray
    black_noise: FloatArray
    agree_levels: float

    @cached_property
    def contrast(self) -> float:
        """White over black where the projector's light is, in the brightest twentieth of the picture: grey levels."""
        small = [cv2.resize(picture, SMALL, interpolation=cv2.INTER_AREA) for picture in (self.white, self.black)]
        return float(np.percentile(cv2.absdiff(*small), 95))

    @cached_property
    def _ends(self) -> tuple[FloatArray, FloatArray]:
        return band_means(self.black), band_means(self.white)

    def agree(self, one: Image, other: Image, drift: float = 0.0) -> bool:
        """Whether two frames are of one thing: no band differs by more than noise, and that share of the light."""
        return self.excess(one, other, drift) <= 1

    def excess(self, one: Image, other: Image, drift: float = 0.0) -> float:
        """How many times as much two frames differ as two of one thing may, in the band where it is most."""
        return float(np.max(self.excesses(one, other, drift)))

    def excesses(self, one: Image, other: Image, drift: float = 0.0) -> FloatArray:
        """(BANDS,) the same of each band."""
        dark, bright = self._ends
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.clip(np.nan_to_num((band_means(one) - dark) / (bright - dark)), 0, 1)
        noise = np.sqrt((1 - share) * self.black_noise**2 + share * self.white_noise**2)
        allowed = NOISE_FACTOR * noise + self.agree_levels + drift * np.abs(bright - dark)
        return band_differences(one, other) / allowed

    def louder(self, factor: float) -> References:
        """The same of pictures whose noise is that many times as large."""
        return replace(
            self,
            white_noise=factor * self.white_noise,
            black_noise=factor * self.black_noise,
            agree_levels=factor * self.agree_levels,
        )

    def differ(self, one: Image, other: Image, share: float) -> bool:
        """Whether two frames are of different things: by that share of white over black, in some lit band."""
        dark, bright = self._ends
        light = np.abs(bright - dark)
        return bool(np.any((band_differences(one, other) >= share * light) & (light >= FEWEST_LIT * light.max())))

    def matches(self, frame: Image, reference: Image) -> bool:
        """Whether a frame is of what a reference shows, from which lamp and room may have drifted a little."""
        return self.agree(frame, reference, DRIFT)


def grey_levels(picture: Image) -> Image:
    """uint8 of a picture of 8 or 16 bits."""
    return picture if picture.dtype == np.uint8 else (picture // LEVELS_16_BIT).astype(np.uint8)


def band_differences(one: Image, other: Image) -> FloatArray:
    """(BANDS,) mean |one - other|, in grey levels."""
    return band_means(cv2.absdiff(one, other))


def band_means(picture: Image) -> FloatArray:
    """(BANDS,) over each of as many bands of rows."""
    rows = cv2.reduce(picture.reshape(picture.shape[0], -1), 1, cv2.REDUCE_AVG, dtype=cv2.CV_32F)[:, 0]
    return np.array([part.mean() for part in np.array_split(rows.astype(np.float64), BANDS)])


def still_noise(frames: Sequence[Image]) -> FloatArray:
    """(BANDS,) mean difference of frames of the same thing with the next one."""
    return np.mean([band_differences(a, b) for a, b in pairwise(frames)], axis=0)
