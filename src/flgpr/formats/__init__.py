"""Files of other programs and of makers' radars: read, described, mapped to runs."""

from flgpr.lazy import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
