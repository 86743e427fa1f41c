"""Pages.

One kit of templates and figures for all of them, the report on a result, and the report on an
array.
"""

from flgpr.lazy import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
