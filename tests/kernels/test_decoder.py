"""An image decodes the same, to the last bit, from compiled and from uncompiled kernels, and uses all of them."""

from __future__ import annotations

import ast
from types import ModuleType
from typing import Any

import cv2
import numpy as np
import pytest

from retrue.decoding import surface
from retrue.decoding.blocks import blobs, centres, colors, growth, holders, islands, links, places, rims
from retrue.decoding.blocks.decode_color_grid import inspect_color_grid
from retrue.geometry import nearest
from retrue.patterns.color_grid import make_color_grid
from tests.kernels.plain import SOURCES, plain

KERNELS = ("blobs", "curvature", "lattice", "links", "patches", "places", "profiles")
FIELDS = ("label", "verdict", "holder", "centre_px", "sigma_px", "confidence", "color")


class Checked:
    """A kernel module whose every call is also made uncompiled, on copies of the same arrays."""

    def __init__(self, compiled: ModuleType, called: set[str]) -> None:
        self._compiled, self._called = compiled, called
        self._name = compiled.__name__.rpartition(".")[2]
        self._plain = plain(self._name)

    def __getattr__(self, name: str) -> Any:
        def call(*arguments: Any) -> Any:
            self._called.add(f"{self._name}.{name}")
            copies = [a.copy() if isinstance(a, np.ndarray) else a for a in arguments]
            result = getattr(self._compiled, name)(*arguments)
            with np.errstate(invalid="ignore"):
                assert getattr(self._plain, name)(*copies) == result
            for argument, copy in zip(arguments, copies, strict=True):
                np.testing.assert_array_equal(copy, argument, err_msg=f"{self._name}.{name}")
            return result

        return call


def scene(depth: type[np.unsignedinteger]) -> tuple[Any, np.ndarray]:
    """A small grid on a wall, with a print, in front of it a face that shows a few blocks of its own, and noise."""
    grid = make_color_grid((176, 144), rows=10, columns=12, pitch=13)
    wall = cv2.warpAffine(grid.render(), np.array([[1, 0.05, 4], [-0.04, 1, 8]]), (192, 160), flags=cv2.INTER_AREA)
    wall[70:74] = wall[70:74] // 3
    face = cv2.warpAffine(grid.render(), np.array([[1, 0.05, 10], [-0.04, 1, 14]]), (192, 160), flags=cv2.INTER_AREA)
    wall[86:132, 104:160] = 0
    wall[90:128, 108:156] = face[90:128, 108:156]
    noise = np.random.default_rng(2).normal(12, 2, wall.shape)
    picture = np.clip(cv2.GaussianBlur(wall.astype(float), (0, 0), 0.9) * 0.8 + noise, 0, 255)
    return grid, (picture * (np.iinfo(depth).max / 255)).astype(depth)


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_every_kernel_says_the_same_uncompiled(
    depth: type[np.unsignedinteger], monkeypatch: pytest.MonkeyPatch
) -> None:
    grid, picture = scene(depth)
    expected = inspect_color_grid(grid, picture)
    assert (expected.holder >= 0).sum() > 60
    called: set[str] = set()
    for module in (blobs, centres, colors, growth, holders, islands, links, nearest, places, rims, surface):
        for name in ("kernel", "link_kernel", "bend_kernel", "profile_kernel"):
            if hasattr(module, name):
                monkeypatch.setattr(module, name, Checked(getattr(module, name), called))
    found = inspect_color_grid(grid, picture)
    for field in FIELDS:
        np.testing.assert_array_equal(getattr(found, field), getattr(expected, field), err_msg=field)
    functions = {
        f"{name}.{node.name}"
        for name in KERNELS
        for node in ast.parse(SOURCES[name].read_text("utf-8")).body
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_")
    }
    assert called == functions
