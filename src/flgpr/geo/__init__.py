"""A lane on the Earth: its anchor, and what maps and geographic information systems read."""

from flgpr.lazy import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
