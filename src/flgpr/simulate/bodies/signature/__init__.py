"""Signatures: what buried bodies scatter, by Maxwell's equations in and around them, in tables.

Round bodies, metal and dielectric, are solved mode by mode on a grid, with the surface above them
to all orders (``revolution``); boxes as lattices of dipoles (``dipoles``). ``build`` makes tables,
``table`` reads them.
"""

from flgpr.lazy import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
