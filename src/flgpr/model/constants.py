"""Physical constants, and names that every table and run keeps to."""

SPEED_OF_LIGHT = 299_792_458.0
"""Speed of light in vacuum, m/s."""
POLARIZATIONS = ("HH", "HV", "VH", "VV")
"""Transmitted, then received."""
AXES = ("x", "y", "z")
POSE_COMPONENTS = ("x", "y", "z", "heading", "pitch", "roll")
