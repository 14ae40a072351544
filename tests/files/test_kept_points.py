"""What was decoded, put aside and taken up again."""

from __future__ import annotations

import numpy as np
import pytest

from retrue.correspondences import Correspondences
from retrue.errors import FileError
from retrue.files.kept_points import keep_points, read_kept_points


def points() -> Correspondences:
    rng = np.random.default_rng(3)
    return Correspondences(rng.normal(size=(40, 2)), rng.normal(size=(40, 2)), camera_size=(1280, 960))


def test_they_are_the_same_to_the_last_bit(tmp_path):
    keep_points(tmp_path / "kept.npz", points())
    assert read_kept_points(tmp_path / "kept.npz") == points()


@pytest.mark.parametrize("content", [b"", b"PK rubbish", b"\x93NUMPY"])
def test_what_is_damaged_is_named(tmp_path, content):
    (tmp_path / "kept.npz").write_bytes(content)
    with pytest.raises(FileError, match=r"kept\.npz"):
        read_kept_points(tmp_path / "kept.npz")


def test_every_cut_is_named(tmp_path):
    keep_points(tmp_path / "whole.npz", points())
    whole = (tmp_path / "whole.npz").read_bytes()
    for end in range(0, len(whole), 97):
        (tmp_path / "cut.npz").write_bytes(whole[:end])
        with pytest.raises(FileError, match=r"cut\.npz"):
            read_kept_points(tmp_path / "cut.npz")
