"""What the figures of the studies share: panels, and images on their axes."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray


def subplots(
    width: float, height: float, rows: int = 1, columns: int = 1, **options: Any
) -> tuple[Figure, Any]:
    """Return a figure of so many inches, and its panels; the options are those of ``subplots``."""
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(rows, columns, **options)


def decibels(magnitude: ArrayLike, least: float = 1e-6) -> NDArray[np.float64]:
    """Return magnitudes in dB, none of them below ``least``; what is unknown counts as zero."""
    known = np.nan_to_num(np.asarray(magnitude, dtype=np.float64))
    return np.asarray(20 * np.log10(np.maximum(known, least)))


def show(
    axes: Axes, image: ArrayLike, extent: tuple[float, ...], low: float, high: float, **style: Any
) -> Any:
    """Draw an image (y, x) between two levels, y upwards.

    ``extent`` has its borders, left to right and then from bottom to top; the style is that of
    ``imshow``.
    """
    options = {"origin": "lower", "aspect": "equal", "vmin": low, "vmax": high, **style}
    left, right, bottom, top = map(float, extent)
    return axes.imshow(np.asarray(image), extent=(left, right, bottom, top), **options)
