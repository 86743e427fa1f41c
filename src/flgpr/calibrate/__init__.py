"""Calibration: what stands between a recorded signal and the field of the papers."""

from flgpr.lazy import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
