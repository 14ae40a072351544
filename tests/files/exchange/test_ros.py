from xml.etree import ElementTree

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation

from retrue.errors import FileError
from retrue.files.exchange.ros import LINK_FROM_OPTICAL, launch, urdf, write_bag, write_ros
from retrue.files.rigs import read_device
from tests.files.exchange.rigs import CAMERA, PROJECTOR, RIG, wall

STAMPS = [1_700_000_001_000_000_000, 1_700_000_000_500_000_000]
CAMERA_FROM_PROJECTOR = RIG.projector_from_camera.inverse()


def test_a_bag_comes_back_through_rosbags(tmp_path):
    clouds = [wall(), wall(8)]
    write_bag(tmp_path / "bag", RIG, clouds, STAMPS)
    with AnyReader([tmp_path / "bag"]) as reader:
        messages = [(c.topic, stamp, reader.deserialize(raw, c.msgtype)) for c, stamp, raw in reader.messages()]
        latched = next(c for c in reader.connections if c.topic == "/tf_static").ext.offered_qos_profiles
    assert latched[0].durability.name == "TRANSIENT_LOCAL"
    (transforms,) = [message.transforms for topic, _, message in messages if topic == "/tf_static"]
    pose = transforms[1].transform
    assert (transforms[1].header.frame_id, transforms[1].child_frame_id) == (
        "camera_optical_frame",
        "projector_optical_frame",
    )
    t = [pose.translation.x, pose.translation.y, pose.translation.z]
    assert np.allclose(t, CAMERA_FROM_PROJECTOR.t / 1000, atol=1e-15)
    q = [pose.rotation.x, pose.rotation.y, pose.rotation.z, pose.rotation.w]
    assert np.allclose(Rotation.from_quat(q).as_matrix(), CAMERA_FROM_PROJECTOR.R, atol=1e-15)
    read = [(stamp, message) for topic, stamp, message in messages if topic == "/points"]
    for (stamp, message), cloud, expected in zip(read, clouds[::-1], sorted(STAMPS), strict=True):
        assert stamp == expected == message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        assert [field.name for field in message.fields] == ["x", "y", "z", "rgb"]
        table = message.data.view("<f4").reshape(-1, 4)
        assert np.allclose(table[:, :3], cloud.points / 1000, rtol=2**-23)
        packed = message.data.view("<u4").reshape(-1, 4)[:, 3]
        assert np.array_equal(packed >> 16, cloud.colors[:, 0])
    info = next(message for topic, _, message in messages if topic == "/projector/camera_info")
    assert (info.width, info.height) == PROJECTOR.size
    assert np.array_equal(info.k.reshape(3, 3), PROJECTOR.K)
    assert np.array_equal(info.d, PROJECTOR.distortion)


def test_a_bag_that_is_there_is_left_alone(tmp_path):
    write_bag(tmp_path / "bag", RIG, [wall()], STAMPS[:1])
    before = (tmp_path / "bag" / "metadata.yaml").read_bytes()
    with pytest.raises(FileError, match="expected a new name for the bag"):
        write_bag(tmp_path / "bag", RIG, [wall()], STAMPS[:1])
    assert (tmp_path / "bag" / "metadata.yaml").read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["bag"]


def test_the_urdf_says_where_the_projector_stands():
    joints = {joint.find("child").get("link"): joint for joint in ElementTree.fromstring(urdf(RIG)).findall("joint")}
    poses = {}
    for child, joint in joints.items():
        xyz, rpy = ([float(word) for word in joint.find("origin").get(name).split()] for name in ("xyz", "rpy"))
        roll, pitch, yaw = (Rotation.from_rotvec(angle * axis) for angle, axis in zip(rpy, np.eye(3), strict=True))
        poses[child] = (yaw * pitch * roll).as_matrix(), xyz
    R, t = poses["projector_optical_frame"]
    assert np.allclose(R, CAMERA_FROM_PROJECTOR.R, atol=1e-15)
    assert np.allclose(t, CAMERA_FROM_PROJECTOR.t / 1000, atol=1e-15)
    assert np.allclose(poses["camera_optical_frame"][0], LINK_FROM_OPTICAL.R, atol=1e-15)
    forward = poses["camera_optical_frame"][0] @ [0, 0, 1]
    assert np.allclose(forward, [1, 0, 0], atol=1e-15)  # x of a link, as REP 103 has it


def test_the_launch_file_and_the_camera_infos_are_read_back(tmp_path):
    write_ros(tmp_path, RIG)
    nodes = ElementTree.parse(tmp_path / "static_transforms.launch.xml").getroot().findall("node")
    words = nodes[1].get("args").split()
    said = dict(zip(words[::2], words[1::2], strict=True))
    assert said["--child-frame-id"] == "projector_optical_frame"
    assert float(said["--x"]) == CAMERA_FROM_PROJECTOR.t[0] / 1000
    assert launch(RIG).count("--frame-id") == 2
    for name, device in (("camera", CAMERA), ("projector", PROJECTOR)):
        read = read_device(tmp_path / f"{name}.yaml", name)
        assert read.camera == device if hasattr(read, "camera") else read == device
