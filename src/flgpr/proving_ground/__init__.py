"""The proving ground: detectors side by side on lanes that every machine makes alike.

The truth of the test lanes is sealed.
"""

from flgpr.lazy import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
