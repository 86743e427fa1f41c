"""Stores and tables on disk, import and export."""

from flgpr.lazy import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
