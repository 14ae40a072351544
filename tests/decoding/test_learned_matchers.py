"""The adapters of learned matchers, with networks that are made up: their real weights are not ours to ship."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from retrue import InputError, decode
from retrue.decoding.photographs.learned import LightGlue, LoFTR, named_matcher
from retrue.patterns.photographs import Matcher, Photographs

SHIFT = np.array([6.0, 2.0])


class Tensor:
    """What the adapters ask of one."""

    def __init__(self, values: np.ndarray) -> None:
        self.values = np.asarray(values)

    def __getitem__(self, key: object) -> Tensor:
        return Tensor(self.values[key])

    def repeat(self, *counts: int) -> Tensor:
        return Tensor(np.tile(self.values, counts))

    def detach(self) -> Tensor:
        return self

    def cpu(self) -> Tensor:
        return self

    def numpy(self) -> np.ndarray:
        return self.values


def places(shape: tuple[int, ...]) -> np.ndarray:
    y, x = np.mgrid[20 : shape[-2] - 20 : 8, 20 : shape[-1] - 20 : 8]
    return np.stack([x.ravel(), y.ravel()], axis=-1).astype(float)


class Network:
    """Knows the shift, but for noise; eval() as of any module."""

    def __init__(self, *_: object, **__: object) -> None: ...

    @classmethod
    def from_pretrained(cls, _: str) -> Network:
        return cls()

    def eval(self) -> Network:
        return self


class FakeLoFTR(Network):
    def __call__(self, images: dict[str, Tensor]) -> dict[str, Tensor]:
        shape = images["image0"].values.shape
        assert all(side % 8 == 0 for side in shape[-2:])
        assert images["image0"].values.max() <= 1
        here = places(shape)
        there = here + SHIFT + np.random.default_rng(0).normal(0, 0.4, here.shape)
        confidence = np.where(np.arange(len(here)) % 10, 0.9, 0.1)
        return {"keypoints0": Tensor(here), "keypoints1": Tensor(there), "confidence": Tensor(confidence)}


class FakeDisk(Network):
    def __call__(self, image: Tensor, count: int, *, pad_if_not_divisible: bool) -> list[SimpleNamespace]:
        assert image.values.shape[1] == 3
        assert count > 0
        assert pad_if_not_divisible
        found = places(image.values.shape)
        return [SimpleNamespace(keypoints=Tensor(found), descriptors=Tensor(np.ones((len(found), 128))))]


class FakeGlue(Network):
    def __call__(self, first: Tensor, second: Tensor, *frames: object) -> tuple[Tensor, Tensor]:
        assert len(frames) == 2
        rows = np.arange(0, len(first.values), 2)
        return Tensor(np.full((len(rows), 1), 0.25)), Tensor(np.stack([rows, rows], axis=-1))


@pytest.fixture
def kornia(monkeypatch: pytest.MonkeyPatch) -> None:
    from contextlib import nullcontext

    torch, package, features = ModuleType("torch"), ModuleType("kornia"), ModuleType("kornia.feature")
    torch.from_numpy, torch.inference_mode = Tensor, nullcontext
    features.LoFTR, features.DISK, features.LightGlueMatcher = FakeLoFTR, FakeDisk, FakeGlue
    features.laf_from_center_scale_ori = lambda keypoints: keypoints
    for name, module in (("torch", torch), ("kornia", package), ("kornia.feature", features)):
        monkeypatch.setitem(sys.modules, name, module)


def shifted_pair() -> tuple[np.ndarray, np.ndarray]:
    import cv2

    noise = np.random.default_rng(5).normal(128, 90, (250, 330)).astype(np.float32)
    wide = np.clip(cv2.GaussianBlur(noise, (0, 0), 2) * 3 - 256, 0, 255).astype(np.uint8)
    dx, dy = SHIFT.astype(int)
    return wide[dy : dy + 203, dx : dx + 301], wide[:203, :301]


def test_loftr_is_aligned_to_a_fraction_of_a_pixel(kornia: None) -> None:
    points = decode(Photographs(matcher=LoFTR()), shifted_pair())
    assert len(points) > 200
    assert np.median(np.abs(points.projector_px - points.camera_px - SHIFT)) < 0.02
    assert np.all(points.confidence == 0.9)


def test_lightglue_takes_rows_of_both_sides(kornia: None) -> None:
    left, right = shifted_pair()
    matches = LightGlue().match(left, right)
    assert np.array_equal(matches.left_px, matches.right_px)
    assert np.allclose(matches.confidence, 0.75)
    assert matches.sigma_px == 1.0


def test_names_and_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    assert named_matcher("sift") is None
    matcher: Matcher | None = named_matcher("loftr")
    assert matcher is not None
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(InputError, match=r"pip install '\.\[matchers\]'"):
        matcher.match(*shifted_pair())
