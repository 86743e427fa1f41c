"""Trials: sealed truth, registers that only grow, plans and figures of a test."""

from flgpr.lazy import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
