"""Documents in XML, from templates."""

from __future__ import annotations

import re
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

_NOT_IN_XML = re.compile(r"[\x00-\x08\x0b-\x1f\ud800-\udfff\ufffe\uffff]")


def document(package: str, template: str, **values: Any) -> bytes:
    """Return a document: a template with its values filled in, as UTF-8.

    Values are escaped; characters that XML does not allow become question marks.

    Parameters
    ----------
    package : str
        Package that holds the template in its folder ``templates``.
    template : str
        Its file name.
    **values
        Values for it.

    Returns
    -------
    bytes
        The document.
    """
    return _templates(package).get_template(template).render(**values).encode()


@cache
def _templates(package: str) -> Environment:
    """Return the templates of a package."""
    return Environment(
        loader=PackageLoader(package),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_printable,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )


def _printable(value: Any) -> Any:
    """Return a text with question marks for the characters that XML does not allow."""
    is_plain = isinstance(value, str) and not isinstance(value, Markup)
    return _NOT_IN_XML.sub("?", value) if is_plain else value
