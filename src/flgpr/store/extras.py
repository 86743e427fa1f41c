"""Optional packages, imported when first needed."""

from __future__ import annotations

from importlib import import_module
from typing import Any


class MissingExtraError(ValueError):
    """A package of an optional extra is not installed."""


def optional(module: str, extra: str) -> Any:
    """Import a module of an optional extra of flgpr.

    Parameters
    ----------
    module : str
        Full name of the module.
    extra : str
        The extra of flgpr that installs it.

    Returns
    -------
    module
        The imported module.

    Raises
    ------
    MissingExtraError
        If it is not installed; the message names the extra.
    """
    try:
        return import_module(module)
    except ImportError as error:
        package = module.split(".")[0]
        raise MissingExtraError(
            f"{package} is needed for this and is not installed: "
            f"pip install 'flgpr[{extra}]' ({error})"
        ) from None
