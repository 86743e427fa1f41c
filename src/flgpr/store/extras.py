"""Optional packages, imported when first needed."""

from __future__ import annotations

from importlib import import_module
from typing import Any


class MissingExtraError(ValueError):
    """A package of an optional extra is not installed."""


def optional(module: str, extra: str) -> Any:
    """Import a module of an optional extra of flgpr; the error, if it is not installed, names the extra."""
    try:
        return import_module(module)
    except ImportError as error:
        raise MissingExtraError(
            f"{module.split('.')[0]} is needed for this and is not installed: pip install 'flgpr[{extra}]' ({error})"
        ) from None
