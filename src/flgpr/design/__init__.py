"""Planning an array before it is built."""

from flgpr.lazy import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
