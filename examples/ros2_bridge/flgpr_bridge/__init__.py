"""Forwards scans and poses from ROS 2 to ``flgpr live``."""
