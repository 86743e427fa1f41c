"""Signatures: what buried bodies scatter, by Maxwell's equations in and around them, in tables.

``table`` reads tables; ``flgpr_ground.signatures`` makes them.
"""

from flgpr.lazy import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
