"""An image in the lane frame as a figure: ground, section, or the three projections of a volume."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.figure import Figure
from numpy.typing import NDArray

_WIDE, _HIGH = 7.5, 6.0  # inches of a panel at most


def image_figure(image: xr.DataArray, peaks: pd.DataFrame, pose: NDArray[np.float64], span: float = 40.0) -> Figure:
    """Draw an image (polarization, z, y, x), complex, ``span`` dB down from each polarization's strongest pixel.

    An axis of one value is left out; a volume is drawn as its strongest pixels along each axis. ``peaks`` (x, y, z, m)
    are numbered in the first polarization's panels, poses (scan, 6) drawn where they lie in a panel.
    """
    labels = [str(label) for label in image["polarization"].values]
    wide = [axis for axis in ("x", "y", "z") if image.sizes[axis] > 1]
    planes = [("x", "y"), ("x", "z"), ("y", "z")]
    shown = [plane for plane in planes if all(axis in wide for axis in plane)]
    sizes = {axis: max(float(np.ptp(image[axis].values)), 1e-9) for axis in "xyz"}
    across, up = shown[0]
    ratio = np.clip(sizes[up] / sizes[across], 0.12, 2.5)
    width = min(_WIDE, _HIGH / ratio)
    figure = Figure(
        figsize=(width * len(shown) + 1.6, (width * ratio + 1.1) * len(labels)), layout="constrained"
    )  # fmt: skip
    panels = figure.subplots(len(labels), len(shown), squeeze=False)
    for row, (label, line) in enumerate(zip(labels, panels, strict=True)):
        level = np.abs(image.values[row])
        top = max(float(level.max()), np.finfo(float).tiny)
        for axes, (a, b) in zip(line, shown, strict=True):
            others = tuple(k for k, axis in enumerate(("z", "y", "x")) if axis not in (a, b))
            flat = 20 * np.log10(np.maximum(level.max(axis=others) / top, 1e-9))
            u, v = image[a].values, image[b].values
            du, dv = (np.diff(one).mean() / 2 for one in (u, v))
            drawn = axes.imshow(
                flat, origin="lower", extent=(u[0] - du, u[-1] + du, v[0] - dv, v[-1] + dv), cmap="magma", vmin=-span,
                vmax=0, aspect="equal" if 0.12 < np.ptp(v) / np.ptp(u) < 2.5 else "auto", interpolation="nearest",
            )  # fmt: skip
            window = axes.axis()
            axes.plot(pose[:, "xyz".index(a)], pose[:, "xyz".index(b)], ".", color="#4fc3f7", markersize=2)
            axes.axis(window)
            axes.set(xlabel=f"{a} (m)", ylabel=f"{b} (m)")
            if row == 0:
                for number, peak in enumerate(peaks[[a, b]].to_numpy(), 1):
                    axes.annotate(
                        str(number), peak, xytext=(6, 6), textcoords="offset points", color="white", fontsize=8
                    )
                    axes.plot(*peak, "o", mfc="none", mec="white", markersize=9)
        figure.colorbar(drawn, ax=line[-1], label=f"{label}, dB re its strongest pixel", shrink=0.8, pad=0.02)
    fixed = ", ".join(f"{axis} = {image[axis].values[0]:g} m" for axis in "xyz" if axis not in wide)
    figure.suptitle(", ".join(part for part in (str(image.attrs.get("title", "")), fixed) if part), fontsize=10)
    return figure
