"""The public names of the proving ground: detectors side by side on lanes that every machine makes alike.

They are at home in the package ``flgpr_ground``, and left out where that is not installed. The
truth of the test lanes is sealed.
"""

from flgpr.lazy import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
