"""Signatures: what buried bodies scatter, by Maxwell's equations inside and around them, tabulated.

Round bodies, metal and dielectric, are solved mode by mode on a grid (``revolution``), with the
surface above them to all orders (``solve``); boxes as lattices of dipoles (``box``, ``dipoles``).
``build`` makes tables, ``table`` reads them.
"""

from flgpr.lazy import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
