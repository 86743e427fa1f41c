"""Recordings in MCAP, those of ROS 2 among them, read and written."""
