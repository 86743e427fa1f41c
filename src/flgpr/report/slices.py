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
    """
    level = np.abs(image.values[0]).astype(np.float64)
    top = max(float(level.max()), np.finfo(float).tiny)
    x = image["x"].values
    y = image["y"].values
    count = level.shape[0]
    columns = min(_COLUMNS, count)
    rows = math.ceil(count / columns)
    shape = np.ptp(y) / np.ptp(x)
    ratio = float(np.clip(shape, 0.4, 2.2))
    width = _PANEL_WIDTH * columns + 1.4
    height = (_PANEL_WIDTH * ratio + 0.7) * rows + 0.5
    figure = Figure(figsize=(width, height), layout="compressed")
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    half_dx = np.diff(x).mean() / 2
    half_dy = np.diff(y).mean() / 2
    mesh: Any = None
    for number, axes in enumerate(panels.ravel()):
        if number >= count:
            axes.set_axis_off()
            continue
        mesh = axes.imshow(
            20 * np.log10(np.maximum(level[number] / top, 1e-9)),
            origin="lower",
            extent=(x[0] - half_dx, x[-1] + half_dx, y[0] - half_dy, y[-1] + half_dy),
            cmap="magma",
            vmin=-span,
            vmax=0,
            aspect="equal" if 0.4 < shape < 2.2 else "auto",
            interpolation="nearest",
        )
        axes.plot(pose[:, 0], pose[:, 1], ".", color="#4fc3f7", markersize=0.8)
        axes.set_title(f"{-float(image['z'][number]):g} m below", fontsize=9)
        if number % columns == 0:
            axes.set_ylabel("y (m)")
        if number >= count - columns:
            axes.set_xlabel("x (m)")
    polarization = image["polarization"].values[0]
    figure.colorbar(mesh, ax=panels, label=f"{polarization}, dB re the strongest pixel", shrink=0.7)
    figure.suptitle(str(image.attrs.get("title", "")), fontsize=10)
    return figure
