"""Features of two photographs, each with the other's most similar one where both agree and no third is near.

Source: Lowe, "Distinctive image features from scale-invariant keypoints", 2004; the root of Arandjelovic and Zisserman,
"Three things everyone should know to improve object retrieval", 2012: distances of the square roots of normalised
histograms are Hellinger's, and no large entry outweighs the others.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from retrue.geometry.arrays import BoolArray, FloatArray, Image, IntArray
from retrue.patterns.photographs import Matches

PIXELS_EACH = 200  # for each feature that is asked for; of a picture that has more, and is large, its half is searched
LARGE = 640 * 480
LEAST_CONTRAST = 0.015  # of full scale, as OpenCV's SIFT counts it; a third of its default finds faint texture, too
ROWS = 512  # of the table of similarities at a time


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """K features of one photograph: place (K, 2), size (K,) px, direction (K,) radians, descriptor (K, 128)."""

    places: FloatArray
    size: FloatArray
    direction: FloatArray
    descriptors: Any

    def __len__(self) -> int:
        return len(self.places)


def match_sift(left: Image, right: Image, most_features: int, ratio: float) -> tuple[Matches, tuple[int, int]]:
    """Mutual nearest neighbours that pass the ratio test, and how many features each photograph (h, w), uint8, has."""
    with ThreadPoolExecutor(2) as threads:
        first, second = threads.map(find_features, (left, right), (most_features, most_features))
    rows, columns, distances = mutual(first.descriptors, second.descriptors, ratio)
    matches = Matches(
        first.places[rows],
        second.places[columns],
        1 - distances[:, 0] / np.maximum(distances[:, 1], 1e-9),
        np.stack([first.size[rows], second.size[columns]], axis=-1),
        second.direction[columns] - first.direction[rows],
    )
    return matches, (len(first), len(second))


def find_features(picture: Image, most: int) -> Features:
    """The strongest features of a grey picture (h, w), uint8.

    A picture with pixels to spare is halved first: the smallest features are most of the work, hardly any are among the
    strongest, and what a place is worth is settled when its match is aligned, in the picture itself.
    """
    height, width = picture.shape
    small = picture
    while small.size > max(PIXELS_EACH * most, LARGE):
        small = cv2.resize(small, (small.shape[1] // 2, small.shape[0] // 2), interpolation=cv2.INTER_AREA)
    pixel = np.array([width / small.shape[1], height / small.shape[0]])
    finder = cv2.SIFT.create(most, contrastThreshold=LEAST_CONTRAST, enable_precise_upscale=True)
    keypoints, found = finder.detectAndCompute(small, cast(Any, None))
    descriptors = cast("NDArray[np.float32] | None", found)
    if descriptors is None:
        return Features(np.empty((0, 2)), np.empty(0), np.empty(0), np.empty((0, 128), dtype=np.float32))
    descriptors = np.sqrt(descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-9))
    return Features(
        (np.array([point.pt for point in keypoints], dtype=np.float64) + 0.5) * pixel - 0.5,
        np.array([point.size for point in keypoints], dtype=np.float64) * float(np.sqrt(pixel.prod())),
        np.radians([point.angle for point in keypoints]),
        descriptors,
    )


def mutual(first: Any, second: Any, ratio: float) -> tuple[IntArray, IntArray, FloatArray]:
    """Rows of `first` (K, D) and of `second` (L, D), unit vectors, that are each other's nearest.

    With the distances (M, 2) to the nearest and the second nearest. Memory stays below a megabyte or so a thousand.
    """
    if len(first) < 2 or len(second) < 2:
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64), np.empty((0, 2))
    best = np.empty(len(first), dtype=np.int64)
    similar = np.empty((len(first), 2))
    backwards = np.full(len(second), -np.inf, dtype=np.float32)
    for top in range(0, len(first), ROWS):
        table = first[top : top + ROWS] @ second.T
        here, lines = slice(top, top + len(table)), np.arange(len(table))
        np.maximum(backwards, table.max(axis=0), out=backwards)
        best[here] = table.argmax(axis=1)
        similar[here, 0] = table[lines, best[here]]
        table[lines, best[here]] = -np.inf
        similar[here, 1] = table.max(axis=1)
    distances = np.sqrt(np.maximum(2 - 2 * similar, 0))
    agreed: BoolArray = similar[:, 0] >= backwards[best]
    alone = np.bincount(best[agreed], minlength=len(second))[best] == 1  # of copies that are equally near, none counts
    rows = np.flatnonzero(agreed & alone & (distances[:, 0] < ratio * distances[:, 1]))
    return rows, best[rows], distances[rows]
