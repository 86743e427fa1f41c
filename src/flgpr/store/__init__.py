"""What this project writes and reads itself: run stores, bundles, tables, scans as frames."""

from flgpr.lazy import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
