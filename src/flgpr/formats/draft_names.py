"""Words by which the arrays of a file are known: one table for every draft of a mapping."""

from __future__ import annotations

import re

RECORDING = "MCAP recording"
"""Kind of file whose arrays are of topics: all are over messages."""
UNNAMED = ("array", "table")
"""Names of arrays in files that name none."""
FREQUENCY = re.compile(r"freq|tone|hz|(^|_)f($|_)")
SAMPLES = re.compile(r"range|delay|t_ns|twt|fast")
"""What delays or ranges of samples are called; a time may be the scans' clock as well."""
TIME = re.compile(r"time|stamp|(^|_)(t|utc|tow)($|_)")
"""What times of scans, of samples and of fixes are called."""
TRANSMITTER = re.compile(r"tx|trans(?!l)|source|sender")
RECEIVER = re.compile(r"rx|(?<![a-z])rec(?!h)|recei|recep|empf")
ANTENNA = re.compile(rf"{TRANSMITTER.pattern}|{RECEIVER.pattern}|ant|elem")
WAY = re.compile(r"way|track|gps|gnss|rtk|traj|odom")
"""What only positions of a vehicle are called."""
CLOCK = re.compile(rf"{WAY.pattern}|utc|epoch|stamp|scan|trace|pps|pose|slow")
"""What a time is called that is no delay of samples."""
POSITION = re.compile(rf"{WAY.pattern}|pos|xyz|coord|loc|place|transl|reference")
ROTATION = re.compile(r"orientation|rotation|quat")
COMPONENTS: dict[str, tuple[str, ...]] = {
    "longitude": ("longitude", "lon", "long", "lng", "laenge"),
    "latitude": ("latitude", "lat", "breite"),
    "x": ("x", "east", "easting", "rechts", "rechtswert", "cross", "across", "crosstrack"),
    "y": (
        "y",
        "north",
        "northing",
        "hoch",
        "hochwert",
        "along",
        "da",
        "dist",
        "distance",
        "downtrack",
        "chainage",
        "odometer",
    ),
    "z": ("z", "height", "alt", "altitude", "elevation", "up", "ellipsoidal", "hoehe", "hgt"),
    "heading": ("heading", "yaw", "hdg", "psi", "azimuth", "course"),
    "pitch": ("pitch",),
    "roll": ("roll",),
}
"""Words in the names of the components of a pose, the plainest first."""


def component_of(name: str) -> tuple[str, int] | None:
    """Return the component of a pose that a name is called by, and how plainly: 0 is plainest."""
    tokens = re.split(r"[_\W]+", name.lower())
    for component, words in COMPONENTS.items():
        for rank, word in enumerate(words):
            if word in tokens:
                return component, rank
    return None
