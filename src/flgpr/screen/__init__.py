"""From images to alarms: the run-view and the prescreeners."""

from flgpr.lazy import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
