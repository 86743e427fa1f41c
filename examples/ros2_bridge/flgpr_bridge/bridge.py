"""A node that forwards scans and poses to ``flgpr live --tcp``.

Scans are ``std_msgs/Float32MultiArray``: real and imaginary parts that alternate, in the order
polarization, pair, frequency. Poses are ``geometry_msgs/PoseStamped`` of the array's reference
point. ROS has no message for the raw data of a radar: where yours differs, change ``_samples``.
"""

import json
import socket
from array import array
from pathlib import Path

import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from std_msgs.msg import Float32MultiArray

from flgpr_bridge.frames import axis, frame, lane_pose

PARAMETERS = {
    "address": "127.0.0.1:5601",  # where flgpr live listens
    "description": "run.json",  # file that describes the radar
    "scan_topic": "/radar/scan",
    "pose_topic": "/vehicle/pose",
    "lane_axes": ["-y", "x", "z"],  # axes of the map that are the lane's: x of the map is ahead
    "longest_pose_age": 0.2,  # s; the pose of a scan is unknown beyond it
}
_CONNECT_TIMEOUT = 2.0  # s


class Bridge(Node):
    """Sends every scan with the newest pose before it.

    While nobody listens, scans are left out and counted; the description of the radar is sent
    again with every new connection.
    """

    def __init__(self):
        super().__init__("flgpr_bridge")
        for name, default in PARAMETERS.items():
            self.declare_parameter(name, default)
        description = json.loads(Path(self._value("description")).read_text(encoding="utf-8"))
        self._described = frame({"kind": "run", **description})
        self._lane_axes = list(self._value("lane_axes"))
        for name in self._lane_axes:
            axis(name)  # refuses one that is none
        self._connection = None
        self._pose = None
        self._pose_time = 0.0
        self._number = 0
        self.left_out = 0
        self.create_subscription(
            PoseStamped, self._value("pose_topic"), self.take_pose, qos_profile_sensor_data
        )
        self.create_subscription(
            Float32MultiArray, self._value("scan_topic"), self.take_scan, qos_profile_sensor_data
        )

    def take_pose(self, message):
        """Keep a pose for the scans behind it."""
        place = message.pose.position
        turn = message.pose.orientation
        try:
            self._pose = lane_pose(
                (place.x, place.y, place.z), (turn.x, turn.y, turn.z, turn.w), self._lane_axes
            )
        except ValueError as error:
            self.get_logger().warning(str(error))
            return
        self._pose_time = self._now()

    def take_scan(self, message):
        """Send a scan; it keeps its number where it cannot be sent, so that flgpr counts it."""
        now = self._now()
        is_known = self._pose is not None and now - self._pose_time <= self._value(
            "longest_pose_age"
        )
        header = {
            "kind": "scan",
            "scan": self._number,
            "time": now,
            "pose": self._pose if is_known else None,
        }
        self._number += 1
        self._send(frame(header, _samples(message)))

    def end(self):
        """Announce the end of the run and close the connection."""
        if self._connection is not None:
            self._send(frame({"kind": "end"}))
        self._close()

    def _send(self, data):
        """Send a frame, over a new connection where there is none."""
        try:
            if self._connection is None:
                self._connect()
            self._connection.sendall(data)
        except OSError as error:
            self._close()
            self.left_out += 1
            self.get_logger().warning(f"scan left out, {self.left_out} in all: {error}")

    def _connect(self):
        """Connect to flgpr and describe the radar."""
        host, _, port = self._value("address").rpartition(":")
        connection = socket.create_connection((host.strip("[]"), int(port)), _CONNECT_TIMEOUT)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._connection = connection
        connection.sendall(self._described)
        self.get_logger().info(f"connected to {self._value('address')}")

    def _close(self):
        """Close the connection, if there is one."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def _value(self, name):
        """Return the value of a parameter."""
        return self.get_parameter(name).value

    def _now(self):
        """Return the time of the node's clock, s."""
        return self.get_clock().now().nanoseconds * 1e-9


def _samples(message):
    """Return the samples of a scan as complex64, little-endian, as the format has them."""
    values = array("f", message.data)
    if array("H", [1]).tobytes() == b"\0\1":  # a machine that is big-endian
        values.byteswap()
    return values.tobytes()


def main(arguments=None):
    """Forward until the node is shut down."""
    rclpy.init(args=arguments)
    node = Bridge()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.end()
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
