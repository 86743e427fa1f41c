"""The energy prescreener, local maxima thinned by a density rule, and alarm labels (Wang et al. 2007, Sec. II-B)."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import binary_erosion, maximum_filter

from flgpr.model import Grid, Lane, check_truth

Count = Literal["lane", "view"]
_ALL = 10.0  # alarms per disc of their radius: more than there can be maxima
_AT_ONCE = 2**18  # neighbours of candidate maxima that are looked at in one go


def prescreen(
    view: xr.DataArray,
    lane: Lane,
    radius: float = 0.75,
    density: float = 0.75,
    count: Count = "lane",
) -> pd.DataFrame:
    """Raise alarms at the local maxima of a run-view.

    The density rule keeps the strongest alarms, as many as ``density`` per disc of the alarm
    radius. The paper counts area and alarms over the whole run-view. By default they are counted
    inside the lane: what a strong object at the roadside adds must not push alarms out of the lane.
    Alarms outside it that pass the same threshold are kept.

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
    count : {"lane", "view"}
        Where area and alarms are counted for the density rule: in the lane, or in all that was
        seen, as in the paper.

    Returns
    -------
    DataFrame
        x, y (m), magnitude, ordered from strong to weak; empty if there is no maximum. Pixels on
        the border of what was seen never raise an alarm.

    Examples
    --------
    >>> import numpy as np
    >>> import xarray as xr
    >>> from flgpr.model import Grid, Lane
    >>> from flgpr.screen import prescreen
    >>> grid = Grid.spanning((-2.0, 2.0), (0.0, 10.0), 0.1)
    >>> x, y = np.meshgrid(grid.x, grid.y)
    >>> bumps = [(0.5, 3.0, 4.0), (-1.0, 7.0, 9.0), (1.8, 7.0, 2.0)]  # x, y (m), height
    >>> values = sum(h * np.exp(-((x - a) ** 2 + (y - b) ** 2) / 0.1) for a, b, h in bumps)
    >>> view = xr.DataArray(values, dims=("y", "x"), coords={"y": grid.y, "x": grid.x})
    >>> prescreen(view, Lane(-1.5, 1.5, 0.0, 10.0)).head(3).round(2)
         x    y  magnitude
    0 -1.0  7.0        9.0
    1  0.5  3.0        4.0
    2  1.8  7.0        2.0
    """
    if count not in ("lane", "view"):
        raise ValueError(f"count must be lane or view, got {count!r}")
    table = local_maxima(view, radius)
    threshold = view_threshold(table, lane, _area_seen(view), radius, density, count)
    return table[table["magnitude"] >= threshold].reset_index(drop=True)


def frame_alarms(level: NDArray[Any], grid: Grid, area: Lane, radius: float) -> pd.DataFrame:
    """Raise alarms at all local maxima of one frame's magnitude (y, x) inside its detection area.

    ``area`` is in the frame's own coordinates, m. Pixels within the radius beyond its border take part, so that the
    flank of a peak outside is no alarm inside. The table is that of :func:`prescreen`, ``x`` being cross-range and
    ``y`` the distance ahead.
    """
    rows = np.flatnonzero((grid.y >= area.y_min - radius) & (grid.y <= area.y_max + radius))
    columns = np.flatnonzero((grid.x >= area.x_min - radius) & (grid.x <= area.x_max + radius))
    view = xr.DataArray(
        level[np.ix_(rows, columns)],
        dims=("y", "x"),
        coords={"y": grid.y[rows], "x": grid.x[columns]},
    )
    found = prescreen(view, area, radius, density=_ALL)
    return found[area.contains(found["x"], found["y"])].reset_index(drop=True)


def counts(x: ArrayLike, y: ArrayLike, lane: Lane, count: Count) -> NDArray[np.bool_]:
    """Tell which places (x and y in the lane frame, m) the density rule counts: those in the lane, or all."""
    inside = np.asarray(lane.contains(x, y), np.bool_)
    return inside if count == "lane" else np.ones_like(inside)


def view_threshold(
    maxima: pd.DataFrame, lane: Lane, seen: float, radius: float, density: float, count: Count
) -> float:
    """Apply the density rule to the local maxima (x, y in m, magnitude) of a whole run-view.

    ``seen`` is the area, m², of the run-view that was seen; the rest is as in :func:`prescreen`.
    """
    counted = maxima["magnitude"].to_numpy()[counts(maxima["x"], maxima["y"], lane, count)]
    return density_threshold(counted, seen if count == "view" else lane.area, radius, density)


def density_threshold(
    magnitude: NDArray[np.float64], area: float, radius: float, density: float
) -> float:
    """Find the magnitude from which on local maxima are alarms (Wang et al. 2007, Sec. II-B).

    They were found on ``area``, m²; ρ is the ``density`` of those kept per area π·radius². -inf if
    all are kept, inf if none is.

    Examples
    --------
    >>> density_threshold(np.array([5.0, 1.0, 3.0, 2.0]), area=4.0, radius=0.75, density=0.9)
    3.0
    """
    if not (radius > 0 and density > 0):
        raise ValueError(f"radius and density must be positive, got {radius} and {density}")
    keep = math.floor(density * area / (math.pi * radius**2))
    if len(magnitude) <= keep:
        return -math.inf
    return float(np.partition(magnitude, -keep)[-keep]) if keep else math.inf


def local_maxima(view: xr.DataArray, radius: float) -> pd.DataFrame:
    """Find the local maxima of a run-view (y, x), the largest pixels within ``radius`` m, before the density rule.

    They come as x, y (m) and magnitude, strong to weak. Pixels on the border of what was seen are never among them.
    """
    if view.dims != ("y", "x"):
        raise ValueError(f"view must have the dimensions (y, x), got {view.dims}")
    rows, columns = _maxima(view, radius)
    values = np.asarray(view.values, dtype=np.float64)
    return pd.DataFrame(
        {
            "x": view["x"].values[columns],
            "y": view["y"].values[rows],
            "magnitude": values[rows, columns],
        }
    )


def _area_seen(view: xr.DataArray) -> float:
    dy, dx = (float(view[axis].values[1] - view[axis].values[0]) for axis in ("y", "x"))
    return float(np.isfinite(view.values).sum()) * dy * dx


def _maxima(view: xr.DataArray, radius: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of the local maxima, strongest first; of equal neighbours the first by row and column."""
    values = np.asarray(view.values, dtype=np.float64)
    dy, dx = (float(view[axis].values[1] - view[axis].values[0]) for axis in ("y", "x"))
    seen = np.isfinite(values)
    filled = np.where(seen, values, -np.inf)
    ny = math.floor(radius / dy + 1e-9)
    nx = math.floor(radius / dx + 1e-9)
    inner = binary_erosion(seen, np.ones((3, 3), bool), border_value=0)
    # A maximum within the radius is one among its neighbours too, which is quickly found out.
    near = maximum_filter(
        filled, size=(3 if ny else 1, 3 if nx else 1), mode="constant", cval=-np.inf
    )
    rows, columns = (
        np.nonzero((filled == near) & inner)
        if min(dy, dx) <= radius / math.sqrt(2)
        else np.nonzero(inner)
    )
    padded = np.pad(filled, ((ny, ny), (nx, nx)), constant_values=-np.inf)
    v, u = np.mgrid[-ny : ny + 1, -nx : nx + 1].reshape(2, -1)
    disc = (v * dy) ** 2 + (u * dx) ** 2 <= radius**2 * (1 + 1e-9)
    # Far neighbours first, some at a time, as memory allows: after each lot few candidates are
    # left.
    v, u = (one[disc][np.argsort(-(v**2 + u**2)[disc], kind="stable")] for one in (v, u))
    begin = 0
    while begin < v.size:
        lot = slice(begin, begin + min(max(_AT_ONCE // max(rows.size, 1), 1), -(-v.size // 8)))
        begin = lot.stop
        around = padded[rows[:, None] + (ny + v[lot]), columns[:, None] + (nx + u[lot])]
        peak = (filled[rows, columns, None] >= around).all(axis=1)
        rows, columns = rows[peak], columns[peak]
    order = np.argsort(-values[rows, columns], kind="stable")
    rows, columns = rows[order], columns[order]
    kept: list[int] = []
    taken: dict[float, list[int]] = {}
    for i in range(rows.size):
        equal = taken.setdefault(float(values[rows[i], columns[i]]), [])
        if all(
            math.hypot((rows[k] - rows[i]) * dy, (columns[k] - columns[i]) * dx) > radius
            for k in equal
        ):
            kept.append(i)
            equal.append(i)
    return rows[kept], columns[kept]


HIT = "hit"
FALSE = "false"
NEITHER = "neither"


def label_alarms(
    alarms: pd.DataFrame, truth: pd.DataFrame, lane: Lane, radius: float = 1.0
) -> pd.DataFrame:
    """Label alarms as hits, false alarms or neither, each hit with its closest target.

    Parameters
    ----------
    alarms, truth : DataFrame
        x, y in the lane frame, m, and the truth table of the same lane. Only training may see it.
    lane : Lane
        The lane; alarms outside it that hit nothing are neither.
    radius : float
        r_label: alarms within it of a target's centre are hits, its border included, m.

    Returns
    -------
    DataFrame
        ``label`` ("hit", "false" or "neither"), ``target`` (row in the truth table of the closest
        target, -1 unless a hit) and ``distance`` to the closest target (m, NaN without any), with
        the index of ``alarms``.
    """
    if not radius > 0:
        raise ValueError(f"radius must be positive, got {radius}")
    targets = check_truth(truth)
    place, there = (t[["x", "y"]].to_numpy(dtype=np.float64) for t in (alarms, targets))
    if len(there):
        away = np.linalg.norm(place[:, None] - there[None], axis=-1)
        target = away.argmin(axis=1)
        distance = away.min(axis=1)
    else:
        target = np.full(len(place), -1)
        distance = np.full(len(place), np.nan)
    hit = distance <= radius
    inside = lane.contains(place[:, 0], place[:, 1])
    label = np.where(hit, HIT, np.where(inside, FALSE, NEITHER))
    return pd.DataFrame(
        {"label": label, "target": np.where(hit, target, -1), "distance": distance},
        index=alarms.index,
    )
