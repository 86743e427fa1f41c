"""The figure of depth slices."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from numpy.typing import NDArray

_COLUMNS = 4
_PANEL_WIDTH = 3.1  # inches
_RATIOS = (0.4, 2.2)  # length over width between which slices are drawn to scale


def slices_figure(image: xr.DataArray, pose: NDArray[np.float64], span: float = 25.0) -> Figure:
    """Draw level slices of an image of its first polarization, side by side.

    Parameters
    ----------
    image : xarray.DataArray
        Complex image (polarization, z, y, x).
    pose : (scan, 6) ndarray of float
        Poses, which are drawn as dots, m and rad.
    span : float
        Range of the common scale below the strongest pixel of all slices, dB.

    Returns
    -------
    matplotlib.figure.Figure
        A panel per slice, at most four side by side.
    """
    level = np.abs(image.values[0]).astype(np.float64)
    count = level.shape[0]
    columns = min(_COLUMNS, count)
    rows = math.ceil(count / columns)
    length_by_width = float(np.ptp(image["y"].values) / np.ptp(image["x"].values))
    panel_ratio = float(np.clip(length_by_width, *_RATIOS))
    width = _PANEL_WIDTH * columns + 1.4
    height = (_PANEL_WIDTH * panel_ratio + 0.7) * rows + 0.5
    figure = Figure(figsize=(width, height), layout="compressed")
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)

    # One scale for all slices: the strongest pixel of all of them is 0 dB.
    top = max(float(level.max()), np.finfo(float).tiny)
    extent = _extent(image)
    is_to_scale = _RATIOS[0] < length_by_width < _RATIOS[1]
    mesh: Any = None
    for number, axes in enumerate(panels.ravel()):
        if number >= count:
            axes.set_axis_off()
            continue
        mesh = axes.imshow(
            20 * np.log10(np.maximum(level[number] / top, 1e-9)),
            origin="lower",
            extent=extent,
            cmap="magma",
            vmin=-span,
            vmax=0,
            aspect="equal" if is_to_scale else "auto",
            interpolation="nearest",
        )
        axes.plot(pose[:, 0], pose[:, 1], ".", color="#4fc3f7", markersize=0.8)
        depth = -float(image["z"][number])
        axes.set_title(f"{depth:g} m below", fontsize=9)
        if number % columns == 0:
            axes.set_ylabel("y (m)")
        if number >= count - columns:
            axes.set_xlabel("x (m)")

    polarization = image["polarization"].values[0]
    figure.colorbar(
        mesh,
        ax=panels,
        label=f"{polarization}, dB re the strongest pixel",
        shrink=0.7,
    )
    figure.suptitle(str(image.attrs.get("title", "")), fontsize=10)
    return figure


def _extent(image: xr.DataArray) -> tuple[float, float, float, float]:
    """Return the outer edges of an image's pixels: x from and to, y from and to, m."""
    x = image["x"].values
    y = image["y"].values
    # Coordinates are those of pixel centres.
    half_dx = np.diff(x).mean() / 2
    half_dy = np.diff(y).mean() / 2
    return (x[0] - half_dx, x[-1] + half_dx, y[0] - half_dy, y[-1] + half_dy)
