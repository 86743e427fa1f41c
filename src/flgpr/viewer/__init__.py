"""The viewer: a read-only page on this machine. It shows what it reads or is handed and never computes."""

from flgpr.lazy import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
