"""The energy prescreener: local maxima of a run-view, thinned by a density rule (Wang et al. 2007, Sec. II-B)."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, maximum_filter

from flgpr.model import Lane


def prescreen(view: xr.DataArray, lane: Lane, radius: float = 0.75, density: float = 0.75) -> pd.DataFrame:
    """Raise alarms at the local maxima of a run-view.

    The density rule keeps the strongest alarms, as many as ``density`` per disc of the alarm radius. Unlike the paper,
    which counts over the whole run-view, area and alarms are counted inside the lane: what a strong object at the
    roadside adds must not push alarms out of the lane. Alarms outside it that pass the same threshold are kept.

    Parameters
    ----------
    view : xarray.DataArray
        Run-view (y, x) in the lane frame; NaN where nothing was seen.
    lane : Lane
        Area for the density rule.
    radius : float
        An alarm is the largest pixel within this distance, m.
    density : float
        ρ, mean number of alarms kept per area π·radius².

    Returns
    -------
    DataFrame
        x, y (m), magnitude, ordered from strong to weak; empty if there is no maximum. Pixels on the border of what was
        seen never raise an alarm.

    Raises
    ------
    ValueError
        If radius or density is not positive or ``view`` is not two-dimensional.
    """
    if view.dims != ("y", "x"):
        raise ValueError(f"view must have the dimensions (y, x), got {view.dims}")
    if not (radius > 0 and density > 0):
        raise ValueError(f"radius and density must be positive, got {radius} and {density}")
    rows, columns = _maxima(view, radius)
    values = np.asarray(view.values, dtype=np.float64)
    table = pd.DataFrame(
        {"x": view["x"].values[columns], "y": view["y"].values[rows], "magnitude": values[rows, columns]}
    )
    inside = table[lane.contains(table["x"], table["y"])]
    keep = math.floor(density * lane.area / (math.pi * radius**2))
    if len(inside) > keep:
        threshold = inside["magnitude"].iloc[keep - 1] if keep else math.inf
        table = table[table["magnitude"] >= threshold]
    return table.reset_index(drop=True)


def _maxima(view: xr.DataArray, radius: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of the local maxima, strongest first; of equal neighbours the first by row and column."""
    values = np.asarray(view.values, dtype=np.float64)
    dy, dx = (float(view[axis].values[1] - view[axis].values[0]) for axis in ("y", "x"))
    seen = np.isfinite(values)
    filled = np.where(seen, values, -np.inf)
    ny, nx = math.floor(radius / dy + 1e-9), math.floor(radius / dx + 1e-9)
    oy, ox = np.mgrid[-ny : ny + 1, -nx : nx + 1]
    disc = (oy * dy) ** 2 + (ox * dx) ** 2 <= radius**2 * (1 + 1e-9)
    peak = filled == maximum_filter(filled, footprint=disc, mode="constant", cval=-np.inf)
    inner = binary_erosion(seen, np.ones((3, 3), bool), border_value=0)
    rows, columns = np.nonzero(peak & inner)
    order = np.argsort(-values[rows, columns], kind="stable")
    rows, columns = rows[order], columns[order]
    kept: list[int] = []
    for i in range(rows.size):
        equal = [k for k in kept if values[rows[k], columns[k]] == values[rows[i], columns[i]]]
        if all(math.hypot((rows[k] - rows[i]) * dy, (columns[k] - columns[i]) * dx) > radius for k in equal):
            kept.append(i)
    return rows[kept], columns[kept]
