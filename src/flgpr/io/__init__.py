"""Runs, tables, files of other programs and maps under one name: what `store`, `formats` and `geo` offer.

Programs that read and write runs need not know in which room a function lives. Every name has its
home there; this package only passes it on.
"""

from importlib import import_module
from typing import Any

_ROOMS = ("flgpr.store", "flgpr.formats", "flgpr.geo")

__all__ = sorted(name for room in _ROOMS for name in import_module(room).__all__)


def __getattr__(name: str) -> Any:
    for room in _ROOMS:
        module = import_module(room)
        if name in module.__all__:
            return getattr(module, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
