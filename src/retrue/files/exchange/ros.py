"""A rig and its clouds for ROS 2: URDF, static transforms, camera_info, bags. Metres, as REP 103 has it.

Frames end in `_optical_frame`, z forward and y down, as REP 103 names those of cameras; `camera_link` is the same place
with x forward and z up, to mount the rig by. No ROS needs to be installed: bags are written by `rosbags`.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from numbers import Integral
from pathlib import Path
from typing import Any

import numpy as np

from retrue.errors import FileError, InputError, require_kinds, require_path
from retrue.files.atomic import replaced_file
from retrue.files.device_formats import ROS_MODELS, ros_text
from retrue.geometry.arrays import FloatArray
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.reconstruction.cloud import Cloud
from retrue.rig import Rig, require_rig
from retrue.units import metres_per

LINK = "camera_link"
CAMERA_FRAME, PROJECTOR_FRAME = "camera_optical_frame", "projector_optical_frame"
LINK_FROM_OPTICAL = RigidTransform(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]), np.zeros(3))
POINT_FIELDS = (("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("rgb", 12, 7))  # name, offset, 7: FLOAT32


def static_transforms(rig: Rig) -> list[tuple[str, str, RigidTransform]]:
    """Parent, child, parent_from_child in metres, from `camera_link` outwards."""
    pose = rig.projector_from_camera.inverse()
    in_metres = RigidTransform(pose.R, pose.t * metres_per(rig.unit))
    return [(LINK, CAMERA_FRAME, LINK_FROM_OPTICAL), (CAMERA_FRAME, PROJECTOR_FRAME, in_metres)]


def write_ros(folder: str | Path, rig: Rig) -> None:
    """`rig.urdf`, `static_transforms.launch.xml`, and a camera_info of each device.

    Raises `InputError` for a lens with more than eight coefficients, and a unit of unknown length.
    """
    folder = require_path(folder, "write_ros(folder, rig)")
    require_rig(rig)
    contents = {
        "rig.urdf": urdf(rig),
        "static_transforms.launch.xml": launch(rig),
        "camera.yaml": ros_text(rig.camera, "camera"),
        "projector.yaml": ros_text(rig.projector, "projector"),
    }
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(folder, f"cannot be made a folder: {error.strerror or error}") from error
    for name, text in contents.items():
        with replaced_file(folder / name) as stream:
            stream.write(text.encode())


def urdf(rig: Rig) -> str:
    """Three links and the fixed joints between them; rpy are the angles about the fixed axes x, y, z."""
    from scipy.spatial.transform import Rotation

    lines = ['<?xml version="1.0"?>', '<robot name="retrue_rig">', f'  <link name="{LINK}"/>']
    for parent, child, pose in static_transforms(rig):
        rpy = _numbers(Rotation.from_matrix(pose.R).as_euler("xyz"))
        lines += [
            f'  <link name="{child}"/>',
            f'  <joint name="{child}_joint" type="fixed">',
            f'    <parent link="{parent}"/>',
            f'    <child link="{child}"/>',
            f'    <origin xyz="{_numbers(pose.t)}" rpy="{rpy}"/>',
            "  </joint>",
        ]
    return "\n".join([*lines, "</robot>", ""])


def launch(rig: Rig) -> str:
    """A launch file that publishes the transforms, where no robot_state_publisher reads the URDF."""
    lines = ["<launch>"]
    for parent, child, pose in static_transforms(rig):
        words = [f"--{name} {value!r}" for name, value in zip("xyz", pose.t.tolist(), strict=True)]
        words += [f"--q{name} {value!r}" for name, value in zip("xyzw", _quaternion(pose.R), strict=True)]
        words += [f"--frame-id {parent} --child-frame-id {child}"]
        lines.append(f'  <node pkg="tf2_ros" exec="static_transform_publisher" args="{" ".join(words)}"/>')
    return "\n".join([*lines, "</launch>", ""])


def point_cloud_fields(cloud: Cloud) -> dict[str, Any]:
    """The fields of a sensor_msgs/PointCloud2 but its header, its data bytes of x y z and packed rgb, FLOAT32 each.

    >>> grey = np.full((1, 3), 128, np.uint8)
    >>> fields = point_cloud_fields(Cloud(np.array([[0.0, 0, 1500]]), grey, np.zeros((1, 2)), "mm"))
    >>> fields["width"], fields["point_step"], np.frombuffer(fields["data"], "<f4")[:3].tolist()
    (1, 16, [0.0, 0.0, 1.5])
    """
    red, green, blue = cloud.colors.T.astype(np.uint32)
    table = np.empty((len(cloud), 4), "<f4")
    table[:, :3] = cloud.points * metres_per(cloud.unit)
    table[:, 3] = (red << 16 | green << 8 | blue).view(np.float32)
    row = 16 * len(cloud)
    return {
        "height": 1,
        "width": len(cloud),
        "is_bigendian": False,
        "point_step": 16,
        "row_step": row,
        "data": table.tobytes(),
        "is_dense": True,
    }


def camera_info_fields(camera: Camera) -> dict[str, Any]:
    """The fields of a sensor_msgs/CameraInfo that say something; nothing is rectified."""
    models = {count: model for model, count in ROS_MODELS.items()}
    if len(camera.distortion) not in models:
        raise InputError(f"distortion: ROS holds 5 or 8 coefficients, this lens has {len(camera.distortion)}")
    return {
        "width": camera.size[0],
        "height": camera.size[1],
        "distortion_model": models[len(camera.distortion)],
        "d": np.array(camera.distortion),
        "k": camera.K.ravel().copy(),
        "r": np.eye(3).ravel(),
        "p": np.hstack([camera.K, np.zeros((3, 1))]).ravel(),
    }


def write_bag(path: str | Path, rig: Rig, clouds: Sequence[Cloud], stamps_ns: Sequence[int]) -> None:
    """A ROS 2 bag: `/tf_static`, `/camera/camera_info`, `/projector/camera_info`, and `/points`, one cloud a stamp.

    Parameters
    ----------
    path : the folder that a bag is; one that is there already is left alone.
    stamps_ns : when each cloud was taken, nanoseconds since 1970.

    Raises
    ------
    FileError : it exists, or cannot be written. `InputError` : no rosbags, or what `write_ros` refuses.
    """
    path = require_path(path, "write_bag(path, rig, clouds, stamps_ns)")
    require_rig(rig)
    require_kinds(clouds, Cloud, "clouds", "retrue.reconstruct makes them")
    require_kinds(stamps_ns, Integral, "stamps_ns")
    if len(stamps_ns) != len(clouds):
        raise InputError(f"stamps_ns: expected one for each of {len(clouds)} clouds, found {len(stamps_ns)}")
    require_bag(path)
    metres_per(rig.unit)
    infos = {"camera": camera_info_fields(rig.camera), "projector": camera_info_fields(rig.projector)}
    try:
        with tempfile.TemporaryDirectory(prefix=f".{path.name}.", suffix=".part", dir=path.parent) as whole:
            made = Path(whole) / path.name
            _write_messages(made, rig, infos, clouds, stamps_ns)
            shutil.move(made, path)
    except OSError as error:
        raise FileError(path, f"cannot be written: {error.strerror or error}") from error


def require_bag(path: Path) -> None:
    """What `write_bag` would refuse, before there is a cloud."""
    if find_spec("rosbags") is None:
        raise InputError('bag: expected the library rosbags, found none; pip install ".[ros]"')
    if path.exists():
        raise FileError(path, "expected a new name for the bag, found one that exists; move it away or choose another")


def _write_messages(
    path: Path, rig: Rig, infos: Mapping[str, dict[str, Any]], clouds: Sequence[Cloud], stamps_ns: Sequence[int]
) -> None:
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store: Any = get_typestore(Stores.ROS2_HUMBLE)
    kinds: Any = store.types

    def header(stamp: int, frame: str) -> Any:
        when = kinds["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
        return kinds["std_msgs/msg/Header"](stamp=when, frame_id=frame)

    start = min(stamps_ns)
    transforms = [
        kinds["geometry_msgs/msg/TransformStamped"](
            header=header(start, parent),
            child_frame_id=child,
            transform=kinds["geometry_msgs/msg/Transform"](
                translation=kinds["geometry_msgs/msg/Vector3"](**dict(zip("xyz", pose.t.tolist(), strict=True))),
                rotation=kinds["geometry_msgs/msg/Quaternion"](**dict(zip("xyzw", _quaternion(pose.R), strict=True))),
            ),
        )
        for parent, child, pose in static_transforms(rig)
    ]
    roi = kinds["sensor_msgs/msg/RegionOfInterest"](x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    messages: list[tuple[str, str, int, Any]] = [
        ("/tf_static", "tf2_msgs/msg/TFMessage", start, kinds["tf2_msgs/msg/TFMessage"](transforms=transforms))
    ]
    for device, fields in infos.items():
        info = kinds["sensor_msgs/msg/CameraInfo"](
            header=header(start, f"{device}_optical_frame"), **fields, binning_x=0, binning_y=0, roi=roi
        )
        messages.append((f"/{device}/camera_info", "sensor_msgs/msg/CameraInfo", start, info))
    columns = [
        kinds["sensor_msgs/msg/PointField"](name=name, offset=offset, datatype=kind, count=1)
        for name, offset, kind in POINT_FIELDS
    ]
    for cloud, stamp in sorted(zip(clouds, stamps_ns, strict=True), key=lambda pair: pair[1]):
        fields = point_cloud_fields(cloud)
        fields["data"] = np.frombuffer(fields["data"], np.uint8)
        message = kinds["sensor_msgs/msg/PointCloud2"](header=header(stamp, CAMERA_FRAME), fields=columns, **fields)
        messages.append(("/points", "sensor_msgs/msg/PointCloud2", stamp, message))
    with Writer(path, version=9) as writer:
        connections: dict[str, Any] = {}
        for topic, kind, stamp, message in messages:
            if topic not in connections:
                qos = _latched() if topic == "/tf_static" else ()
                connections[topic] = writer.add_connection(topic, kind, typestore=store, offered_qos_profiles=qos)
            writer.write(connections[topic], stamp, store.serialize_cdr(message, kind))


def _latched() -> list[Any]:
    """What `/tf_static` promises: whoever listens later gets it still. Source: ROS 2, tf2_ros, StaticBroadcasterQoS."""
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

    never = QosTime(0, 0)
    kinds = QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL
    return [Qos(*kinds, never, never, QosLiveliness.SYSTEM_DEFAULT, never, False)]


def _quaternion(R: FloatArray) -> list[float]:
    """(x, y, z, w), w not negative."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(R).as_quat(canonical=True).tolist()


def _numbers(values: FloatArray) -> str:
    return " ".join(map(repr, values.tolist()))
