"""What all pages share: templates that are filled in, and figures that are put into them."""

from __future__ import annotations

from base64 import b64encode
from functools import cache
from io import BytesIO
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import flgpr

_HOME = "flgpr.report"


def render(template: str, package: str = _HOME, **values: Any) -> str:
    """Fill in a template of a package, which may extend and import those of this one; the page needs nothing beside it.

    Beside Jinja's own filters there are ``fmt``, Python's ``format``, ``metres``, which says a place in the lane to the
    centimetre, and ``data_url``, which makes of a figure or its PNG what an ``img`` shows. Text is escaped, and what is
    asked for and not given is an error.
    """
    return _environment(package).get_template(template).render(version=flgpr.__version__, **values)


@cache
def _environment(package: str) -> Environment:
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(name) for name in dict.fromkeys((package, _HOME))]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"fmt": format, "metres": _metres, "data_url": _data_url}
    return environment


def figure_png(figure: Figure, dpi: float = 110) -> bytes:
    """Render a figure as PNG, the same for equal figures; dpi in dots per inch."""
    stream = BytesIO()
    figure.dpi = dpi
    # savefig draws a figure with a layout twice. Without the metadata the library's version is in
    # it.
    FigureCanvasAgg(figure).print_png(stream, metadata={"Software": None})  # type: ignore[no-untyped-call]
    return stream.getvalue()


def _metres(value: float) -> str:
    """Say a length to the centimetre, without zeros that tell nothing."""
    text = f"{value:.2f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def _data_url(picture: Figure | bytes, dpi: float = 110) -> str:
    png = figure_png(picture, dpi) if isinstance(picture, Figure) else picture
    return "data:image/png;base64," + b64encode(png).decode()
