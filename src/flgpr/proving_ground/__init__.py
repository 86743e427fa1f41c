"""The proving ground: lanes that every machine makes alike, sealed test truth, and detectors side by side on them."""

from flgpr.lazy import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
