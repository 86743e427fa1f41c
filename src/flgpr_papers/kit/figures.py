"""What the figures of the studies share: declared panels, images on their axes, and curves."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from functools import partial, wraps
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flgpr.scoring import random_pd
from flgpr.types import AnyArray, ArrayLike, Entries, FloatArray, floats
from flgpr_papers.kit.settings import packaged_text

Panels = AnyArray
"""Axes of a figure, as ``subplots`` returns them."""


class Figures:
    """Makes the figures of a paper: panels as ``figures.toml`` declares them, drawn by a function.

    It decorates the function that draws on the panels. What comes of it takes the same arguments
    but the panels, and returns the figure. Its declaration, by the name of the function, has the
    ``size`` (inches) and the options of ``subplots``. ``every``, ``left``, ``bottom`` and the list ``axes``
    say what all panels, those at an edge, and each by itself are given once they are drawn: the
    properties of ``Axes.set``, where a limit left out stays free, and the options of a ``legend``
    and a ``grid``.

    Parameters
    ----------
    paper : str
        Name of the paper.
    """

    def __init__(self, paper: str) -> None:
        self.declared: dict[str, Entries] = tomllib.loads(packaged_text(paper, "figures"))

    def __call__(self, draw: Callable[..., None]) -> Callable[..., Figure]:
        """Return what makes the figure that a function draws on."""
        return self._making(lambda *_: {}, draw)

    def sized(self, options: Callable[..., Entries]) -> Callable[..., Any]:
        """Return the decorator with options that follow from what is drawn, beside those declared."""
        return partial(self._making, options)

    def _making(
        self, options: Callable[..., Entries], draw: Callable[..., None]
    ) -> Callable[..., Figure]:
        """Return what makes the figure that a function draws on, with options of its own."""

        @wraps(draw)
        def make(*args: Any) -> Figure:
            declared = self.declared[draw.__name__] | options(*args)
            given = {name: declared.pop(name, {}) for name in ("every", "left", "bottom", "axes")}
            shape = [declared.pop(name, 1) for name in ("rows", "columns")]
            width, height = declared.pop("size")
            figure, panels = subplots(width, height, *shape, **declared)
            draw(panels, *args)
            grid: Any = np.reshape(panels, shape)
            for row, column in np.ndindex(*shape):
                _dress(grid[row, column], given["every"])
                _dress(grid[row, column], given["left"] if column == 0 else {})
                _dress(grid[row, column], given["bottom"] if row == shape[0] - 1 else {})
            for axes, properties in zip(grid.flat, given["axes"], strict=False):
                _dress(axes, properties)
            return figure

        return make


def _dress(axes: Axes, declared: Entries) -> None:
    """Give a panel what is declared for it."""
    properties = dict(declared)
    legend, grid = properties.pop("legend", None), properties.pop("grid", None)
    for name in {"xlim", "ylim"} & properties.keys():
        properties[name] = (properties[name] + [None])[:2]
    axes.set(**properties)
    if grid is not None:
        axes.grid(**grid)
    if legend is not None:
        axes.legend(**legend)


def subplots(
    width: float, height: float, rows: int = 1, columns: int = 1, **options: Any
) -> tuple[Figure, Any]:
    """Return a figure of so many inches, and its panels; the options are those of ``subplots``."""
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(rows, columns, **options)


def decibels(magnitude: ArrayLike, least: float = 1e-6) -> FloatArray:
    """Return magnitudes in dB, none of them below ``least``; what is unknown counts as zero."""
    known = np.nan_to_num(floats(magnitude))
    return 20 * np.log10(np.maximum(known, least))


def show(
    axes: Axes, image: ArrayLike, x: Any, y: Any, low: float, high: float, **style: Any
) -> Any:
    """Draw an image (y, x) between two levels, y upwards.

    It reaches over its axes, from their first to their last place; the style is that of ``imshow``.
    """
    options = {"origin": "lower", "aspect": "equal", "vmin": low, "vmax": high, **style}
    extent = float(x[0]), float(x[-1]), float(y[0]), float(y[-1])
    return axes.imshow(np.asarray(image), extent=extent, **options)


def colour_bar(panels: Any, shown: Any, label: str, **options: Any) -> Any:
    """Add the bar of an image to one or more panels, which share its scale."""
    every = np.ravel(panels).tolist()
    return every[0].figure.colorbar(shown, ax=every, label=label, **options)


def steps(axes: Axes, curve: pd.DataFrame | dict[Any, Any], label: str, **style: Any) -> None:
    """Draw a ROC as steps."""
    axes.step(curve["far"], curve["pd"], where="post", label=label, **style)


def chance_line(axes: Axes, far_max: float, halo: float) -> None:
    """Draw Pd of alarms strewn at random, found within a halo (radius, m), and end the axes."""
    rates = np.linspace(0, far_max, 101)
    axes.plot(rates, random_pd(rates, halo), color="0.5", ls=":", lw=1, label="chance")
    axes.set(xlim=(0, far_max), ylim=(0, 1.02))
    axes.grid(alpha=0.3)
