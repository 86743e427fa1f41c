"""The figure of depth slices."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from numpy.typing import NDArray

_COLUMNS = 4


def slices_figure(image: xr.DataArray, pose: NDArray[np.float64], span: float = 25.0) -> Figure:
    """Draw level slices of an image (polarization, z, y, x), complex, of its first polarization, side by side.

    All have one scale, ``span`` dB down from the strongest pixel of all of them. Poses (scan, 6) are drawn as dots.
    """
    level = np.abs(image.values[0]).astype(np.float64)
    top = max(float(level.max()), np.finfo(float).tiny)
    x, y = image["x"].values, image["y"].values
    count = level.shape[0]
    columns = min(_COLUMNS, count)
    rows = math.ceil(count / columns)
    width = 3.1
    ratio = float(np.clip(np.ptp(y) / np.ptp(x), 0.4, 2.2))
    figure = Figure(
        figsize=(width * columns + 1.4, (width * ratio + 0.7) * rows + 0.5), layout="compressed"
    )
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    drawn: Any = None
    for number, axes in enumerate(panels.ravel()):
        if number >= count:
            axes.set_axis_off()
            continue
        dx = np.diff(x).mean() / 2
        dy = np.diff(y).mean() / 2
        drawn = axes.imshow(
            20 * np.log10(np.maximum(level[number] / top, 1e-9)),
            origin="lower",
            extent=(x[0] - dx, x[-1] + dx, y[0] - dy, y[-1] + dy),
            cmap="magma",
            vmin=-span,
            vmax=0,
            aspect="equal" if 0.4 < np.ptp(y) / np.ptp(x) < 2.2 else "auto",
            interpolation="nearest",
        )
        axes.plot(pose[:, 0], pose[:, 1], ".", color="#4fc3f7", markersize=0.8)
        axes.set_title(f"{-float(image['z'][number]):g} m below", fontsize=9)
        if number % columns == 0:
            axes.set_ylabel("y (m)")
        if number >= count - columns:
            axes.set_xlabel("x (m)")
    figure.colorbar(
        drawn,
        ax=panels,
        label=f"{image['polarization'].values[0]}, dB re the strongest pixel",
        shrink=0.7,
    )
    figure.suptitle(str(image.attrs.get("title", "")), fontsize=10)
    return figure
