import json
from dataclasses import replace

import numpy as np
import pycolmap
import pytest

from retrue.errors import InputError
from retrue.files.exchange.photogrammetry import rig_views, write_colmap, write_nerfstudio
from retrue.files.images import read_image
from retrue.files.models import read_model
from retrue.geometry.camera import Camera
from retrue.reconstruction.depth_map import depth_map
from retrue.rig import Rig
from tests.files.exchange.rigs import CAMERA, PROJECTOR, RIG, wall

CLOUD = wall()
PHOTOGRAPH = np.random.default_rng(0).integers(0, 255, (48, 64, 3), dtype=np.uint8)
SHOWN = np.random.default_rng(1).integers(0, 255, (60, 80, 3), dtype=np.uint8)


def test_colmap_sees_every_point_where_both_devices_see_it(tmp_path):
    write_colmap(tmp_path, CLOUD, rig_views(RIG, CLOUD, PHOTOGRAPH, SHOWN))
    model = pycolmap.Reconstruction(tmp_path / "sparse" / "0")
    assert model.num_points3D() == len(CLOUD)
    assert {number: image.name for number, image in model.images.items()} == {1: "camera.png", 2: "projector.png"}
    for number, device in ((1, CAMERA), (2, PROJECTOR)):
        image = model.images[number]
        assert (model.cameras[image.camera_id].width, model.cameras[image.camera_id].height) == device.size
        pose = RIG.projector_from_camera if number == 2 else None
        seen = CLOUD.points if pose is None else pose.apply(CLOUD.points)
        in_image = image.cam_from_world() * CLOUD.points
        assert np.allclose(in_image, seen, atol=1e-9)
        pixels = np.array([model.cameras[image.camera_id].img_from_cam(point) for point in in_image])
        assert np.allclose(pixels, device.project(seen) + 0.5, atol=1e-6)
        assert np.allclose([point.xy for point in image.points2D], pixels, atol=1e-6)
    first = model.points3D[1]
    assert np.allclose(first.xyz, CLOUD.points[0])
    assert np.array_equal(first.color, CLOUD.colors[0])
    assert first.track.length() == 2
    assert first.error < 1e-6
    assert np.array_equal(read_image(tmp_path / "images" / "camera.png"), PHOTOGRAPH)


def test_nerfstudio_projects_the_points_to_the_same_pixels(tmp_path):
    depths = depth_map(CLOUD, CAMERA), depth_map(CLOUD, PROJECTOR, RIG.projector_from_camera)
    write_nerfstudio(tmp_path, CLOUD, rig_views(RIG, CLOUD, PHOTOGRAPH, SHOWN, *depths))
    said = json.loads((tmp_path / "transforms.json").read_text())
    points = read_model(tmp_path / said["ply_file_path"], "mm").points
    assert np.allclose(points, CLOUD.points / 1000, rtol=2**-23)
    for frame, device in zip(said["frames"], (CAMERA, PROJECTOR), strict=True):
        world_from_view = np.array(frame["transform_matrix"])
        view = (CLOUD.points / 1000 - world_from_view[:3, 3]) @ world_from_view[:3, :3]
        assert (view[:, 2] < 0).all()  # OpenGL's cameras look along -z
        x, y = view[:, 0] / -view[:, 2], -view[:, 1] / -view[:, 2]
        r2 = x * x + y * y
        radial = 1 + r2 * (frame["k1"] + r2 * (frame["k2"] + r2 * frame["k3"]))
        u = x * radial + 2 * frame["p1"] * x * y + frame["p2"] * (r2 + 2 * x * x)
        v = y * radial + frame["p1"] * (r2 + 2 * y * y) + 2 * frame["p2"] * x * y
        pixels = np.column_stack([frame["fl_x"] * u + frame["cx"], frame["fl_y"] * v + frame["cy"]])
        pose = RIG.projector_from_camera if device is PROJECTOR else None
        expected = device.project(CLOUD.points if pose is None else pose.apply(CLOUD.points)) + 0.5
        assert np.allclose(pixels, expected, atol=1e-9)
        assert (tmp_path / frame["file_path"]).is_file()
        depth = read_image(tmp_path / frame["depth_file_path"]) * said["depth_unit_scale_factor"]
        column, row = np.rint(expected - 0.5).astype(int).T
        inside = (column >= 0) & (row >= 0) & (column < depth.shape[1]) & (row < depth.shape[0])
        there = np.flatnonzero(inside)[depth[row[inside], column[inside]] > 0]  # at the rim half round outwards
        assert len(there) > 0.5 * len(CLOUD)
        assert np.allclose(depth[row[there], column[there]], -view[there, 2], rtol=0.02)


def test_nerfstudio_has_depths_of_all_frames_or_of_none(tmp_path):
    """Its parser refuses folders where only some frames have one."""
    for name, depth, expected in (("some", depth_map(CLOUD, CAMERA), 2), ("none", None, 0)):
        write_nerfstudio(tmp_path / name, CLOUD, rig_views(RIG, CLOUD, PHOTOGRAPH, SHOWN, depth))
        frames = json.loads((tmp_path / name / "transforms.json").read_text())["frames"]
        assert sum("depth_file_path" in frame for frame in frames) == expected
    assert not read_image(tmp_path / "some" / "depth" / "projector.png").any()


def test_what_a_tool_cannot_hold_is_refused_before_anything_is_written(tmp_path):
    skewed = Rig(Camera((64, 48), [[70, 1, 30], [0, 71, 24], [0, 0, 1]]), PROJECTOR, RIG.projector_from_camera)
    with pytest.raises(InputError, match="camera: COLMAP has no skew, this device has 1"):
        write_colmap(tmp_path, CLOUD, rig_views(skewed, CLOUD, None, None))
    with pytest.raises(InputError, match="expected a view with a picture, found none"):
        write_nerfstudio(tmp_path, CLOUD, rig_views(RIG, CLOUD, None, None))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("write", [write_colmap, write_nerfstudio])
@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"name": "two words"}, "expected names of one word each, all different, found 'two words'"),
        ({"name": "../up"}, "found '../up'"),
        ({"name": ""}, "found ''"),
        ({"name": "projector"}, "found 'projector' in \\['projector', 'projector'\\]"),
        ({"picture": PHOTOGRAPH[:24]}, "camera: expected a picture of the camera's 64 x 48 pixels, found 64 x 24"),
        ({"pixels": CLOUD.camera_px[1:]}, "camera: expected a pixel of each of"),
    ],
)
def test_views_that_do_not_suit_are_refused_before_anything_is_written(tmp_path, write, change, said):
    camera, projector = rig_views(RIG, CLOUD, PHOTOGRAPH, SHOWN)
    with pytest.raises(InputError, match=said):
        write(tmp_path, CLOUD, [replace(camera, **change), projector])
    assert not list(tmp_path.iterdir())
