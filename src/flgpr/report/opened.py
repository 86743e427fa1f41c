"""The figure of a file that was just opened: how strong its numbers are."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

_ROWS = 600  # of the picture, about
_RANGE = 60.0  # dB that the colours cover


def opened_figure(signal: NDArray[np.number], name: str) -> Figure:
    """Draw the level of an array: its last axis to the right, all others downwards.

    Parameters
    ----------
    signal : (..., n) ndarray
        The array that seems to be the signal.
    name : str
        Its name.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.
    """
    rows = signal.reshape(-1, signal.shape[-1])
    rows = rows[:: max(1, len(rows) // _ROWS)]
    with np.errstate(divide="ignore", invalid="ignore"):
        levels = 20 * np.log10(np.abs(rows.astype(np.complex128)))
    finite = levels[np.isfinite(levels)]
    top = float(finite.max()) if finite.size else 0.0
    figure = Figure(figsize=(9.5, 5.6), layout="constrained")
    axes = figure.subplots()
    image = axes.imshow(
        levels, cmap="viridis", vmin=top - _RANGE, vmax=top, aspect="auto", interpolation="nearest"
    )
    shape = " x ".join(map(str, signal.shape))
    axes.set(
        xlabel="index along the last axis",
        ylabel="all other axes, in their order",
        title=f"{name}: {shape}",
    )
    figure.colorbar(image, label="magnitude (dB)")
    return figure
