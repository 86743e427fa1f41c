"""From images to cleaned images: self-signature, gain background, model-based suppression."""

from flgpr.lazy import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
