"""Simulation: a scene and a sensor to a run with truth."""
