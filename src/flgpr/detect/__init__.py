"""From features to scores: the estimators and the search for features."""

from flgpr.lazy import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
