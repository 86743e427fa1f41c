"""Physical constants, and names that every table and run keeps to."""

SPEED_OF_LIGHT = 299_792_458.0
"""Speed of light in vacuum, m/s."""
POLARIZATIONS = ("HH", "HV", "VH", "VV")
"""Transmitted, then received."""
AXES = ("x", "y", "z")
POSE_COMPONENTS = ("x", "y", "z", "heading", "pitch", "roll")
DIMS = {
    "signal": ("scan", "polarization", "pair", "frequency"),
    "valid": ("scan", "polarization", "pair"),
    "pose": ("scan", "component"),
    "tx_position": ("pair", "axis"),
    "rx_position": ("pair", "axis"),
    "frequency": ("frequency",),
    "time": ("scan",),
}
"""Dimensions of a run's variables of numbers."""
VARIABLE_ATTRS = {
    "signal": {"units": "1", "long_name": "received field over transmitted field"},
    "valid": {"units": "1", "long_name": "whether a sweep is finite, and so used"},
    "tx_position": {
        "units": "m",
        "long_name": "x, y, z of a pair's transmitting antenna in the vehicle frame",
    },
    "rx_position": {
        "units": "m",
        "long_name": "x, y, z of a pair's receiving antenna in the vehicle frame",
    },
    "pose": {
        "units": "m m m rad rad rad",
        "long_name": "x, y, z, heading, pitch, roll of the vehicle frame in the lane frame",
    },
    "frequency": {"units": "Hz", "long_name": "frequency", "standard_name": "radiation_frequency"},
    "polarization": {"long_name": "transmitted and received polarization"},
    "time": {"units": "s", "long_name": "time of the scan"},
}
"""Units and names of a run's variables, by the CF conventions where these have a word for them."""
IMAGE_ATTRS = {
    "image": {"units": "1", "long_name": "focused field, received over transmitted"},
    "run_view": {"units": "1", "long_name": "magnitude of the run-view"},
    "looks": {"units": "1", "long_name": "number of scans that see the pixel"},
    "x": {"units": "m", "long_name": "x cross-track, right positive"},
    "y": {"units": "m", "long_name": "y down-track, forward positive"},
    "z": {"units": "m", "long_name": "z above the mean ground"},
    "subband": {"long_name": "sub-band"},
    "polarization": VARIABLE_ATTRS["polarization"],
}
"""The same of images and run-views."""
