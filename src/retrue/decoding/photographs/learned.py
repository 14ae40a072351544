"""Matchers that were learned, by kornia: where light, season or view changed more than gradients bear.

They need `pip install ".[matchers]"`, and fetch their weights at the first use. What they find is aligned like any
other match; where it cannot be, it is kept at the matcher's own sigma.

Sources: Sun et al., "LoFTR: detector-free local feature matching with transformers", 2021; Lindenberger et al.,
"LightGlue: local feature matching at light speed", 2023, on DISK features, Tyszkiewicz et al. 2020.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any, Literal

import numpy as np

from retrue.errors import InputError
from retrue.geometry.arrays import Image
from retrue.patterns.photographs import Matcher, Matches

MatcherName = Literal["sift", "lightglue", "loftr"]
SIGMA_PX = 1.0  # of a match that was not aligned: a fraction of the 8 px that LoFTR looks at, and of DISK's pixel
LEAST_CONFIDENCE = 0.2
MOST_FEATURES = 4096
MULTIPLE = 8  # px: both want sides that this divides


def named_matcher(name: MatcherName) -> Matcher | None:
    """The matcher of that name; None for `sift`, which `match_photographs` has itself."""
    return {"sift": None, "lightglue": LightGlue(), "loftr": LoFTR()}[name]


@dataclass(frozen=True, slots=True)
class LoFTR:
    """Dense matches without features.

    Attributes
    ----------
    weights : "outdoor" or "indoor", what it was trained on.
    """

    weights: Literal["outdoor", "indoor"] = "outdoor"

    def match(self, left: Image, right: Image) -> Matches:
        """As `Matcher`."""
        torch, features = _libraries()
        network = features.LoFTR(pretrained=self.weights).eval()
        with torch.inference_mode():
            found = network({"image0": _tensor(torch, left), "image1": _tensor(torch, right)})
        confidence = _array(found["confidence"])
        good = confidence >= LEAST_CONFIDENCE
        return _matches(_array(found["keypoints0"])[good], _array(found["keypoints1"])[good], confidence[good])


@dataclass(frozen=True, slots=True)
class LightGlue:
    """Learned features, DISK, and which belong together."""

    def match(self, left: Image, right: Image) -> Matches:
        """As `Matcher`."""
        torch, features = _libraries()
        finder, matcher = features.DISK.from_pretrained("depth").eval(), features.LightGlueMatcher("disk").eval()
        with torch.inference_mode():
            sides = [
                finder(_tensor(torch, picture).repeat(1, 3, 1, 1), MOST_FEATURES, pad_if_not_divisible=True)[0]
                for picture in (left, right)
            ]
            frames = [features.laf_from_center_scale_ori(side.keypoints[None]) for side in sides]
            distances, pairs = matcher(sides[0].descriptors, sides[1].descriptors, *frames)
        rows = _array(pairs).astype(np.int64).reshape(-1, 2)
        places = [_array(side.keypoints) for side in sides]
        confidence = np.clip(1 - _array(distances).ravel(), 0, 1)
        return _matches(places[0][rows[:, 0]], places[1][rows[:, 1]], confidence)


def _libraries() -> tuple[Any, Any]:
    """torch, and kornia's features; an `InputError` that says what to install where they are not there."""
    try:
        return import_module("torch"), import_module("kornia.feature")
    except ImportError as error:
        raise InputError(
            f"matcher: expected kornia and torch, found none ({error}): pip install '.[matchers]'"
        ) from error


def _tensor(torch: Any, picture: Image) -> Any:
    """(1, 1, h, w) in 0 .. 1, with sides that the networks divide; what is added stands right and below."""
    height, width = picture.shape
    padded = np.pad(picture, ((0, -height % MULTIPLE), (0, -width % MULTIPLE)), mode="edge")
    return torch.from_numpy(np.ascontiguousarray(padded, dtype=np.float32) / 255)[None, None]


def _array(tensor: Any) -> Any:
    return np.asarray(tensor.detach().cpu().numpy(), dtype=np.float64)


def _matches(left: Any, right: Any, confidence: Any) -> Matches:
    return Matches(left.reshape(-1, 2), right.reshape(-1, 2), np.clip(confidence, 0, 1), sigma_px=SIGMA_PX)
