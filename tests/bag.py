"""Recordings of a vehicle as ROS 2 writes them."""

import io

import numpy as np
from scipy.spatial.transform import Rotation

HEADER = """
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
"""
POINT = """
================================================================================
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""
QUATERNION = """
================================================================================
MSG: geometry_msgs/Quaternion
float64 x 0
float64 y 0
float64 z 0
float64 w 1
"""
POSE = """std_msgs/Header header
geometry_msgs/Pose pose
================================================================================
MSG: geometry_msgs/Pose
Point position
Quaternion orientation
"""
TF = """geometry_msgs/TransformStamped[] transforms
================================================================================
MSG: geometry_msgs/TransformStamped
std_msgs/Header header
string child_frame_id # the frame that moves
geometry_msgs/Transform transform
================================================================================
MSG: geometry_msgs/Transform
geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation
"""
FIX = """std_msgs/Header header
uint8 UNKNOWN=0
int8 NO_FIX = -1
string<=8 note "none"
bool good
float64 latitude
float64 longitude
float64 altitude
float64[9] position_covariance
"""
RADAR = """std_msgs/Header header
string[] labels
uint8 antennas
int16[] iq
Detection[] found
================================================================================
MSG: made/Detection
float32 range
int64 cell
"""
TYPES = {
    "/pose": ("geometry_msgs/msg/PoseStamped", POSE + HEADER + POINT + QUATERNION),
    "/tf": ("tf2_msgs/msg/TFMessage", TF + HEADER + POINT + QUATERNION),
    "/fix": ("made/msg/Fix", FIX + HEADER),
    "/radar": ("made/msg/Radar", RADAR + HEADER),
}
MAPPING = """
title = "drive"
polarization = ["VV"]
[signal]
variable = "/radar/iq"
interleaved = true
shape = [-1, 2, 3]
dims = ["scan", "pair", "frequency"]
[frequency]
span = [1.0, 2.0]
unit = "GHz"
[antenna_position]
values = [[-0.5, 0, 0], [0.5, 0, 0]]
unit = "m"
[time]
variable = "/radar/header.stamp"
unit = "s"
[track]
time = {variable = "/pose/header.stamp", unit = "s"}
position = {variable = "/pose/pose.position", unit = "m"}
orientation = {variable = "/pose/pose.orientation", body = ["-y", "x", "z"]}
axes = ["-y", "x", "z"]
clock_offset = 0.0
"""
EPOCH = 1_700_000_000.25


def stamp(time):
    return {"stamp": {"sec": int(time), "nanosec": round((time % 1) * 1e9)}, "frame_id": "map"}


def parts(names, values):
    return dict(zip(names, map(float, values), strict=True))


def drive(scans=5, poses=40, compression="zstd", crcs=True, **changes):
    """Bytes of an MCAP file of a drive along +y of a lane at 2 m/s, x of the world being the lane's y."""
    from mcap.writer import CompressionType
    from mcap_ros2.writer import Writer

    out = io.BytesIO()
    writer = Writer(
        out, chunk_size=1024, compression=CompressionType[compression.upper()], enable_crcs=crcs
    )
    schemas = {topic: writer.register_msgdef(*told) for topic, told in TYPES.items()}

    def write(topic, time, message):
        writer.write_message(topic, schemas[topic], message, int(time * 1e9) + 7, int(time * 1e9))

    for k in range(poses):
        time = EPOCH + 0.1 * k
        turn = parts("xyzw", Rotation.from_euler("z", -0.05 * k * 0.1).as_quat())
        place = [0.2 * k, -0.1, 1.5]
        write(
            "/pose",
            time,
            {"header": stamp(time), "pose": {"position": parts("xyz", place), "orientation": turn}},
        )
        moved = [
            {
                "header": stamp(time),
                "child_frame_id": child,
                "transform": {"translation": parts("xyz", np.add(place, more)), "rotation": turn},
            }
            for child, more in (("base", 0.0), ("mast", 1.0))
        ]
        write("/tf", time, {"transforms": moved})
        fix = {"latitude": 47.9, "longitude": 11.3, "altitude": 300.0 + k, "good": True}
        write(
            "/fix",
            time,
            {"header": stamp(time), **fix, "position_covariance": [1.0] * 9, "note": "a"},
        )
    for k in range(scans):
        time = EPOCH + 0.5 + 0.5 * k
        echo = changes.get("iq", lambda k: np.arange(12) + 100 * k)(k)
        found = [{"range": 1.5, "cell": k}, {"range": 2.5, "cell": -k}]
        message = {
            "header": stamp(time),
            "labels": ["a", ""],
            "antennas": 2,
            "iq": echo.tolist(),
            "found": found,
        }
        write("/radar", time, message)
    inner = writer._writer
    level = inner.register_channel("/level", "json", 0)
    for k in range(3):
        inner.add_message(
            level, k, b'{"level": {"x": 1, "y": %d.5}, "list": [1, 2, null], "name": "a"}' % k, k
        )
    inner.add_message(inner.register_channel("/proto", "protobuf", 0), 5, b"??", 5)
    writer.finish()
    return out.getvalue()
