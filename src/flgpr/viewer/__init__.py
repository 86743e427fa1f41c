"""The viewer.

A page on this machine that shows what it reads or is handed, computes nothing and alters no result.
"""

from flgpr.lazy import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
