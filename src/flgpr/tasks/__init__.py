"""The public doors, one function per command: files in, files out. Each is loaded when it is first used."""

from flgpr.lazy import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
