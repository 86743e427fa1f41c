"""Frames of the live format, and poses of ROS in the lane frame; nothing here needs ROS or flgpr.

The format stands in docs/reference/live-format.md of flgpr.
"""

import json
import math
import struct
import zlib

MAGIC = b"FLGPRSC1"
_AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}


def frame(header, payload=b""):
    """Return a frame: its head, a header in JSON, what follows it, and a CRC-32 of all that."""
    text = json.dumps(header).encode()
    body = MAGIC + struct.pack("<IQ", len(text), len(payload)) + text + payload
    return body + struct.pack("<I", zlib.crc32(body))


def axis(name):
    """Return the unit vector of an axis such as ``x`` or ``-y``."""
    sign = -1 if name.startswith("-") else 1
    letter = name.removeprefix("-")
    if letter not in _AXES:
        raise ValueError(f"axis must be x, y or z, or one of them with a minus, got {name!r}")
    return tuple(sign * component for component in _AXES[letter])


def lane_pose(position, quaternion, lane_axes):
    """Return x, y, z (m) and heading, pitch, roll (rad) in the lane frame.

    ``position`` is x, y, z and ``quaternion`` x, y, z, w of the body in the map, by the conventions
    of ROS (REP 103): the body's x points ahead, y to the left, z up. ``lane_axes`` names which axes
    of the map are the lane's x (to the right), y (ahead) and z (up).
    """
    rows = [axis(name) for name in lane_axes]
    turn = _rotation(quaternion)
    place = [_dot(row, position) for row in rows]
    # Axes of flgpr's vehicle frame, x to the right and y ahead, in the lane frame.
    right = [-_dot(row, [line[1] for line in turn]) for row in rows]
    ahead = [_dot(row, [line[0] for line in turn]) for row in rows]
    up = [_dot(row, [line[2] for line in turn]) for row in rows]
    heading = math.atan2(ahead[0], ahead[1])
    pitch = math.asin(max(-1.0, min(1.0, ahead[2])))
    roll = math.atan2(-right[2], up[2])
    return [*place, heading, pitch, roll]


def _dot(first, second):
    """Return the scalar product of two vectors."""
    return float(sum(one * other for one, other in zip(first, second)))  # noqa: B905, for Python 3.8


def _rotation(quaternion):
    """Return the rotation matrix, as rows, of a quaternion x, y, z, w."""
    norm = math.sqrt(sum(component * component for component in quaternion))
    if not norm > 0:
        raise ValueError(f"quaternion must have a length, got {quaternion}")
    x, y, z, w = (component / norm for component in quaternion)
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
