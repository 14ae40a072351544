"""A ROS 2 node: for every picture on `image` it publishes the scene as `points`, and the rig's transforms once.

    python3 ros2_scanner.py --ros-args -p rig:=rig.json -p pattern:=pattern.json

It needs rclpy and the messages of a ROS 2 installation, and retrue in the same Python. A picture that no longer fits
the rig is answered by a warning and no points: then recalibrate.
"""

import numpy as np
import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import Image, PointCloud2, PointField
from tf2_ros import StaticTransformBroadcaster

import retrue
from retrue.files.exchange.ros import CAMERA_FRAME, POINT_FIELDS, point_cloud_fields, static_transforms


class Scanner(Node):
    """One rig, one pattern."""

    def __init__(self):
        super().__init__("retrue_scanner")
        self.rig = retrue.read_rig(self.declare_parameter("rig", "rig.json").value)
        self.pattern = retrue.read_pattern(self.declare_parameter("pattern", "pattern.json").value)
        self.points = self.create_publisher(PointCloud2, "points", 1)
        self.transforms = StaticTransformBroadcaster(self)
        self.transforms.sendTransform([self.transform(*each) for each in static_transforms(self.rig)])
        self.create_subscription(Image, "image", self.scan, 1)

    def transform(self, parent, child, pose):
        message = TransformStamped()
        message.header.stamp = self.get_clock().now().to_msg()
        message.header.frame_id, message.child_frame_id = parent, child
        t, q = message.transform.translation, message.transform.rotation
        t.x, t.y, t.z = pose.t.tolist()
        q.x, q.y, q.z, q.w = Rotation.from_matrix(pose.R).as_quat().tolist()
        return message

    def scan(self, message):
        if message.encoding not in ("rgb8", "bgr8"):
            self.get_logger().error(f"expected rgb8 or bgr8, found {message.encoding}")
            return
        rows = np.frombuffer(message.data, np.uint8).reshape(message.height, message.step)
        picture = rows[:, : 3 * message.width].reshape(message.height, message.width, 3)
        try:
            found = retrue.decode(self.pattern, picture if message.encoding == "rgb8" else picture[..., ::-1].copy())
            verification = retrue.verify(self.rig, [found])
            if verification.forbids_measuring:
                self.get_logger().warning(f"no points: {verification.reason}")
                return
            cloud = retrue.reconstruct(self.rig, found)
        except retrue.RetrueError as error:
            self.get_logger().warning(str(error))
            return
        fields = [PointField(name=name, offset=at, datatype=kind, count=1) for name, at, kind in POINT_FIELDS]
        points = PointCloud2(fields=fields, **point_cloud_fields(cloud))
        points.header.stamp, points.header.frame_id = message.header.stamp, CAMERA_FRAME
        self.points.publish(points)


def main():
    rclpy.init()
    rclpy.spin(Scanner())


if __name__ == "__main__":
    main()
