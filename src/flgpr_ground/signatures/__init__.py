"""Making of tables of signatures: what buried bodies scatter, by Maxwell's equations.

Round bodies, metal and dielectric, are solved mode by mode on a grid, with the surface above them
to all orders (``revolution``); boxes as lattices of dipoles (``dipoles``). ``build`` makes the
tables that :mod:`flgpr.simulate.bodies.signature` reads.
"""
