"""Simulation: a scene and a sensor to a run with truth."""

from flgpr.lazy import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
