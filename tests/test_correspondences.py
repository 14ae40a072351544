"""What points carry beside their pixels."""

import numpy as np
import pytest

from retrue import Correspondences, InputError
from retrue.correspondences import require_each_once
from retrue.errors import CaptureError

POINTS = Correspondences(
    [[1, 2], [3, 4]],
    [[5, 6], [7, 8]],
    light=[0.5, np.nan],
    light_class=[3, 1],
    camera_size=[640.0, 480.0],
    projector_size=(1024, 768),
)


def test_a_selection_keeps_light_and_rasters():
    one = POINTS.select(np.array([1]))
    assert np.isnan(one.light).tolist() == [True]
    assert one.light_class.tolist() == [1]
    assert (one.camera_size, one.projector_size) == ((640, 480), (1024, 768))


def test_light_and_rasters_make_a_difference():
    assert POINTS.select([0, 1]) == POINTS
    assert hash(POINTS.select([0, 1])) == hash(POINTS)
    for name in ("light", "light_class", "camera_size", "projector_size"):
        values = {key: getattr(POINTS, key) for key in ("light", "light_class", "camera_size", "projector_size")}
        assert Correspondences(POINTS.camera_px, POINTS.projector_px, **(values | {name: None})) != POINTS


def test_rasters_are_shown():
    assert "camera_size     640 x 480\n  projector_size  1024 x 768" in repr(POINTS)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"projector_sigma_px": [-0.1, np.nan]}, "projector_sigma_px: expected no number below 0, found -0.1"),
        ({"camera_size": (640, 0)}, "camera_size: expected width and height in whole pixels"),
        ({"projector_size": (640.5, 480)}, "projector_size: expected width and height in whole pixels"),
        ({"camera_size": 640}, "camera_size: expected shape 2"),
        ({"light": [1.0]}, "light: expected 2 rows as in camera_px, found 1"),
        ({"light_class": [0.5, 1]}, "light_class: expected numbers that int64 holds"),
    ],
)
def test_what_they_cannot_be(wrong, said):
    with pytest.raises(InputError, match=said):
        Correspondences([[1, 2], [3, 4]], [[1, 2], [3, 4]], **wrong)


def test_a_capture_is_handed_in_once_whatever_the_order_of_its_points():
    again = Correspondences(POINTS.camera_px[::-1], POINTS.projector_px[::-1])
    other = Correspondences(POINTS.camera_px + np.array([[0, 0], [0, 1e-12]]), POINTS.projector_px)
    columns = Correspondences(POINTS.camera_px, POINTS.projector_px * [1, np.nan])
    with pytest.raises(CaptureError, match="c: holds the same points as a"):
        require_each_once([("a", POINTS), ("b", other), ("c", again)])
    with pytest.raises(CaptureError, match="b: holds the same points as a"):
        require_each_once([("a", columns), ("b", columns)])
    none = POINTS.select(np.zeros(2, bool))
    require_each_once([*zip("abcde", [POINTS, other, columns, none, none], strict=True)])
