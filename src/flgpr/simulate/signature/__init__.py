"""Signatures: what buried bodies scatter, by Maxwell's equations inside and around them, tabulated.

Round bodies, metal and dielectric, are solved mode by mode on a grid (``revolution``), with the surface above them to
all orders (``multiples``); boxes as lattices of dipoles (``box``, ``dipoles``). ``build`` makes tables, ``table`` reads
them.
"""

from flgpr.simulate.signature.body import Body, BodyLayer, load_body, packaged_bodies
from flgpr.simulate.signature.build import build_table
from flgpr.simulate.signature.table import (
    FREQUENCY,
    PERMITTIVITY,
    SEPARATION,
    SINE,
    SignatureTable,
    find_table,
    load_table,
    packaged_table,
    save_table,
)

__all__ = [
    "FREQUENCY",
    "PERMITTIVITY",
    "SEPARATION",
    "SINE",
    "Body",
    "BodyLayer",
    "SignatureTable",
    "build_table",
    "find_table",
    "load_body",
    "load_table",
    "packaged_bodies",
    "packaged_table",
    "save_table",
]
