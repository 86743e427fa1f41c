"""From alarms to numbers: patches, local contrast, ratios and polarimetric decompositions."""

from flgpr.lazy import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
