"""From runs to images: the imaging operator and its use scan by scan."""

from flgpr.lazy import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
