"""What all pages share: templates that are filled in, maps in colours, and figures as images."""

from __future__ import annotations

import math
from base64 import b64encode
from collections.abc import Iterable, Mapping
from functools import cache
from io import BytesIO
from typing import Any, Literal

import numpy as np
import pandas as pd
import xarray as xr
from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

import flgpr
from flgpr.model import Lane
from flgpr.model.figure_text import show_dollar_signs
from flgpr.types import ArrayLike, FloatArray, floats

_PACKAGE = "flgpr.report"


def render(template: str, package: str = _PACKAGE, **values: Any) -> str:
    """Return a page: a template with its values filled in.

    The page is self-contained. Text is escaped, and a value that the template uses must be given.
    Beside Jinja's own filters there are ``fmt``, Python's ``format``; ``metres``, which writes a
    length to the centimetre; ``data_url``, which turns a figure or its PNG into the address of an
    image; ``inches``, its width; and ``css_text``, which writes text as a string of a style sheet.

    Parameters
    ----------
    template : str
        File name of the template.
    package : str
        Package that holds it; its templates may extend and import those of this package.
    **values
        Values for the template.

    Returns
    -------
    str
        The page, HTML.
    """
    return _environment(package).get_template(template).render(version=flgpr.__version__, **values)


@cache
def _environment(package: str) -> Environment:
    """Return the environment of a package's templates."""
    packages = dict.fromkeys((package, _PACKAGE))
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(name) for name in packages]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {
        "fmt": format,
        "known": lambda value, spec: format(_Number(value), spec),
        "in_words": in_words,
        "metres": _metres,
        "data_url": _data_url,
        "inches": _inches,
        "css_text": _css_text,
    }
    return environment


def table_rows(table: pd.DataFrame, cells: Iterable[str]) -> list[list[str]]:
    """Return the rows of a table by the formats of its cells, as of ``str.format``.

    A number that is NaN is "not known".
    """
    formats = list(cells)
    rows = []
    for row in table.to_dict("records"):
        known = {
            name: _Number(value) if isinstance(value, float) else value
            for name, value in row.items()
        }
        rows.append([cell.format_map(known) for cell in formats])
    return rows


class _Number(float):
    """A number of a table, rounded where no format is given."""

    def __format__(self, spec: str) -> str:
        return "not known" if math.isnan(self) else format(float(self), spec or ".5g")


def in_words(value: Any) -> str:
    """Return a value of the rules, nested or not, as text."""
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {in_words(entry)}" for name, entry in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(in_words(entry) for entry in value) or "unnamed"
    if isinstance(value, float) and math.isfinite(value):
        return f"{value:.6g}"
    return str(value)


def figure_png(figure: Figure, dpi: float = 110) -> bytes:
    """Return a figure as PNG, the same bytes for equal figures.

    Text is shown as it is: dollar signs in names do not make formulas.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        The figure.
    dpi : float
        Dots per inch.

    Returns
    -------
    bytes
        Content of the file.
    """
    show_dollar_signs(figure)
    stream = BytesIO()
    figure.dpi = dpi
    # savefig would draw a figure with a layout twice. The metadata would hold the library's
    # version.
    FigureCanvasAgg(figure).print_png(stream, metadata={"Software": None})  # type: ignore[no-untyped-call]
    return stream.getvalue()


def shaded(
    axes: Axes,
    x: ArrayLike,
    y: ArrayLike,
    values: ArrayLike,
    limits: tuple[float, float],
    shading: Literal["nearest", "gouraud"] = "nearest",
    colours: str = "viridis",
) -> QuadMesh:
    """Draw a map (y, x) of values as colours between two limits."""
    low, high = limits
    return axes.pcolormesh(
        x, y, values, vmin=low, vmax=high, cmap=colours, shading=shading, rasterized=True
    )


def lane_patch(lane: Lane, along: bool = False, **style: Any) -> Rectangle:
    """Return the outline of a lane, x to the right or, along the picture, y."""
    corner = (lane.x_min, lane.y_min)
    size = (lane.x_max - lane.x_min, lane.y_max - lane.y_min)
    if along:
        corner, size = corner[::-1], size[::-1]
    return Rectangle(corner, *size, **style)


def decibels(view: xr.DataArray) -> FloatArray:
    """Return a view's magnitudes in dB."""
    return floats(20 * np.log10(np.maximum(view.values, 1e-12)))


def strongest(view: xr.DataArray, lane: Lane) -> float:
    """Return the level of the strongest pixel of a view (y, x) in the lane, dB; 0 without one."""
    is_inside = lane.contains(*np.meshgrid(view["x"].values, view["y"].values))
    level = decibels(view)[is_inside]
    imaged = level[np.isfinite(level)]
    return float(imaged.max()) if imaged.size else 0.0


def _metres(value: float) -> str:
    """Return a length in m to the centimetre, without trailing zeros."""
    text = f"{value:.2f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def _css_text(text: str) -> Markup:
    """Return text as a string of CSS; all but plain letters and digits are escaped.

    Nothing in the text can end the string or the style sheet, whose text HTML does not unescape. A
    blank is escaped, too: after an escape CSS would drop it.
    """
    escaped = []
    for letter in text:
        is_plain = letter.isascii() and letter.isalnum()
        escaped.append(letter if is_plain else f"\\{ord(letter):06x}")
    return Markup('"' + "".join(escaped) + '"')  # noqa: S704 - nothing unescaped is left


def _inches(picture: Figure | bytes, dpi: float) -> float:
    """Return how wide a figure or a PNG is, so that a narrow screen can keep its text legible."""
    if isinstance(picture, Figure):
        return float(picture.get_figwidth())
    return int.from_bytes(picture[16:20], "big") / dpi


def _data_url(picture: Figure | bytes, dpi: float = 110) -> str:
    """Return a figure or a PNG as a data address."""
    png = figure_png(picture, dpi) if isinstance(picture, Figure) else picture
    return "data:image/png;base64," + b64encode(png).decode()
