"""Scoring: alarms and truth in, ROC curves with intervals, comparisons, plans and reports out."""

from flgpr.lazy import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
