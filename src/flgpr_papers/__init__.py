"""The papers' experiments, run again on simulated lanes.

Every paper has a package of its own and a page; ``kit`` is what they share.
"""

from flgpr.lazy import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
