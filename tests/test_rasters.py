"""Pictures, patterns and rigs that do not belong together are told by their sizes."""

from dataclasses import replace

import numpy as np
import pytest

from retrue import Camera, CaptureError, Correspondences, Rig, RigidTransform, recalibrate, reconstruct, verify
from retrue.rasters import check_alike, check_extent, check_rasters, looks_like

K = [[1500, 0, 640], [0, 1500, 480], [0, 0, 1]]
RIG = Rig(Camera((1280, 960), K), Camera((1024, 768), K), RigidTransform(np.eye(3), [-100.0, 0, 0]))
POINTS = Correspondences([[640, 480], [700, 500]], [[600, 480], [650, 500]])


@pytest.mark.parametrize(
    ("size", "like"),
    [
        ((640, 480), "binned by 2"),
        ((426, 320), "binned by 3"),
        ((2560, 1920), "no longer binned by 2"),
        ((960, 1280), "turned by a quarter"),
        ((1280, 720), "cropped, so that the principal point moved"),
        ((1024, 768), "cropped, so that the principal point moved"),
        ((1600, 1200), "of another size"),
        ((1920, 480), "of another size"),
    ],
)
def test_what_became_of_the_pictures(size, like):
    assert looks_like(size, (1280, 960)) == like
    with pytest.raises(CaptureError) as error:
        check_rasters(RIG, replace(POINTS, camera_size=size), "wall.csv")
    said = f"the pictures are {size[0]} x {size[1]}, those of the rig's camera 1280 x 960: {like}; take them"
    assert str(error.value).startswith(f"wall.csv: {said}")


def test_a_pattern_for_another_projector():
    with pytest.raises(CaptureError, match=r"for a projector of 1280 x 800, the rig's is 1024 x 768: pattern"):
        check_rasters(RIG, replace(POINTS, projector_size=(1280, 800)))


def test_the_rigs_own_sizes_and_none_are_welcome():
    check_rasters(RIG, POINTS)
    check_rasters(RIG, replace(POINTS, camera_size=(1280, 960), projector_size=(1024, 768)))
    check_alike([])
    check_alike([("a", (4, 3)), ("b", (4, 3))])


def test_captures_of_two_sizes():
    with pytest.raises(CaptureError, match="b: expected pictures of 4 x 3 as in a, found 3 x 4: turned by a quarter"):
        check_alike([("a", (4, 3)), ("b", (3, 4))])


@pytest.mark.parametrize("job", [recalibrate, verify])
def test_the_jobs_ask_before_they_start(job):
    with pytest.raises(CaptureError, match=r"captures\[1\]: the pictures are 640 x 480, .*: binned by 2"):
        job(RIG, [POINTS, replace(POINTS, camera_size=(640, 480))])


def test_a_cloud_asks_too():
    with pytest.raises(CaptureError, match="pattern for another projector"):
        reconstruct(RIG, replace(POINTS, projector_size=(1280, 800)))


@pytest.mark.parametrize(
    ("places", "outside"),
    [([-0.5, 1279.5], 0), ([1279.6, *[5.0] * 98], 1), ([1279.6, *[5.0] * 99], 0), ([-0.6, *[1279.6] * 9], 0)],
    ids=["edges", "more than one in a hundred", "one in a hundred", "undistorted: on both sides"],
)
def test_points_that_tell_no_size_are_asked_where_they_lie(places, outside):
    camera_px = np.column_stack([places, np.full(len(places), 9.0)])
    points = Correspondences(camera_px, np.full_like(camera_px, 9.0))
    check_extent(RIG, replace(points, camera_size=(1280, 960)), "told.csv")
    if not outside:
        check_extent(RIG, points, "points.csv")
        return
    with pytest.raises(CaptureError, match=r"points\.csv: .* lie beyond the last pixel of .* 1280 x 960"):
        check_extent(RIG, points, "points.csv")


PIXELS = np.random.default_rng(3).uniform([[100, 50]], [[900, 700]], (60, 2))
SEEN = Correspondences(PIXELS, PIXELS + np.array([5, 3]))


@pytest.mark.parametrize("device", ["camera", "projector"])
@pytest.mark.parametrize(
    ("normalised", "like"),
    [
        (lambda lens, pixels: (pixels + 0.5) / lens.size, r"between 0\.\d+ and 0\.\d+, .* shares of the picture"),
        (lambda lens, pixels: (pixels - lens.K[:2, 2]) / lens.K[0, 0], r"between -0\.\d+ and 0\.\d+, .* rays, .*K\^-1"),
        (lambda lens, pixels: 2 * (pixels + 0.5) / lens.size - 1, "between .* look normalised: hand in"),
    ],
)
def test_coordinates_that_are_no_pixels(device, normalised, like):
    name = f"{device}_px"
    points = replace(SEEN, **{name: normalised(getattr(RIG, device), getattr(SEEN, name))})
    for job in (recalibrate, verify, reconstruct):
        with pytest.raises(CaptureError, match=f"the {device}'s points lie {like}"):
            job(RIG, points if job is reconstruct else [points])
    check_rasters(RIG, SEEN)


def test_columns_alone_as_shares():
    columns = np.column_stack([SEEN.projector_px[:, 0] / 1024, np.full(len(SEEN), np.nan)])
    check_rasters(RIG, replace(SEEN, projector_px=columns * 1024))
    with pytest.raises(CaptureError, match=r"the projector's points lie .* shares"):
        check_rasters(RIG, replace(SEEN, projector_px=columns))


def test_points_beyond_the_picture_on_its_longer_side():
    pixels = np.column_stack([PIXELS[:, 1], np.linspace(10, 1250, len(PIXELS))])
    with pytest.raises(CaptureError, match="x and y are exchanged, or it is turned by a quarter"):
        check_extent(RIG, replace(SEEN, camera_px=pixels))


@pytest.mark.parametrize("job", [recalibrate, verify])
def test_the_jobs_take_each_capture_once(job):
    with pytest.raises(CaptureError, match=r"captures\[1\]: holds the same points as captures\[0\]"):
        job(RIG, [SEEN, replace(SEEN, light=np.ones(len(SEEN)))])
