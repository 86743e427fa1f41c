"""Run, tables, frames and sensors: what the stages meet in."""

from flgpr.lazy import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
