"""Energy prescreener: local maxima thinned by a density rule.

See Wang et al. 2007, Sec. II-B.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import pandas as pd
import xarray as xr
from scipy.ndimage import binary_erosion, maximum_filter

from flgpr.model import Grid, Lane
from flgpr.screen.views import grid_of
from flgpr.types import AnyArray, ArrayLike, BoolArray, FloatArray, IndexArray, floats

Count = Literal["lane", "view"]
_ALL_MAXIMA = 10.0  # alarms per disc of their radius: more than there can be maxima
_NEIGHBOURS_AT_ONCE = 2**18  # compared with candidate maxima in one step


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
        Run-view (y, x) in the lane frame; NaN where no scan sees the pixel.
    lane : Lane
        Area for the density rule.
    radius : float
        An alarm is the largest pixel within this distance, m.
    density : float
        ρ, mean number of alarms kept per area π·radius².
    count : {"lane", "view"}
        Where area and alarms are counted for the density rule: in the lane, or wherever a scan
        sees, as in the paper.

    Returns
    -------
    DataFrame
        x, y (m), magnitude, ordered from strong to weak; empty if there is no maximum. Pixels on
        the border of the area seen never raise an alarm.

    Raises
    ------
    ValueError
        If ``count`` is unknown, the view has other dimensions, or radius or density is not
        positive.

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
    grid = grid_of(view)
    area_seen = float(np.isfinite(view.values).sum()) * grid.dy * grid.dx
    threshold = view_threshold(table, lane, area_seen, radius, density, count)
    return table[table["magnitude"] >= threshold].reset_index(drop=True)


def frame_alarms(level: AnyArray, grid: Grid, area: Lane, radius: float) -> pd.DataFrame:
    """Raise alarms at all local maxima of one frame inside its detection area.

    Pixels within the radius beyond the area's border are compared too, so that the flank of a peak
    outside is no alarm inside.

    Parameters
    ----------
    level : (y, x) ndarray
        Magnitude of the frame.
    grid : Grid
        Its pixels in the scan frame.
    area : Lane
        Detection area in the scan frame.
    radius : float
        An alarm is the largest pixel within this distance, m.

    Returns
    -------
    DataFrame
        As of :func:`prescreen`; x is cross-range and y the distance ahead.
    """
    rows = np.flatnonzero((grid.y >= area.y_min - radius) & (grid.y <= area.y_max + radius))
    columns = np.flatnonzero((grid.x >= area.x_min - radius) & (grid.x <= area.x_max + radius))
    view = xr.DataArray(
        level[np.ix_(rows, columns)],
        dims=("y", "x"),
        coords={"y": grid.y[rows], "x": grid.x[columns]},
    )
    alarms = prescreen(view, area, radius, density=_ALL_MAXIMA)
    return alarms[area.contains(alarms["x"], alarms["y"])].reset_index(drop=True)


def counts(x: ArrayLike, y: ArrayLike, lane: Lane, count: Count) -> BoolArray:
    """Mark the positions (x, y in the lane frame, m) that the density rule counts."""
    inside = np.asarray(lane.contains(x, y), np.bool_)
    return inside if count == "lane" else np.ones_like(inside)


def view_threshold(
    maxima: pd.DataFrame,
    lane: Lane,
    area_seen: float,
    radius: float,
    density: float,
    count: Count,
) -> float:
    """Return the threshold of the density rule for all local maxima of a run-view.

    Parameters
    ----------
    maxima : DataFrame
        x, y (m), magnitude.
    lane, radius, density, count
        As for :func:`prescreen`.
    area_seen : float
        Area of the run-view that a scan sees, m².

    Returns
    -------
    float
        Least magnitude of an alarm, see :func:`density_threshold`.
    """
    counted = counts(maxima["x"], maxima["y"], lane, count)
    area = area_seen if count == "view" else lane.area
    magnitude = maxima["magnitude"].to_numpy()[counted]
    return density_threshold(magnitude, area, radius, density)


def density_threshold(magnitude: FloatArray, area: float, radius: float, density: float) -> float:
    """Return the magnitude from which on local maxima are alarms (Wang et al. 2007, Sec. II-B).

    Parameters
    ----------
    magnitude : (maximum,) ndarray
        Magnitudes of the local maxima.
    area : float
        Area on which they were found, m².
    radius : float
        Alarm radius, m.
    density : float
        ρ, mean number of alarms per area π·radius².

    Returns
    -------
    float
        Least magnitude of an alarm; -inf if all are alarms, inf if none is.

    Raises
    ------
    ValueError
        If radius or density is not positive.

    Examples
    --------
    >>> density_threshold(np.array([5.0, 1.0, 3.0, 2.0]), area=4.0, radius=0.75, density=0.9)
    3.0
    """
    if not (radius > 0 and density > 0):
        raise ValueError(f"radius and density must be positive, got {radius} and {density}")
    allowed = math.floor(density * area / (math.pi * radius**2))
    if len(magnitude) <= allowed:
        return -math.inf
    if allowed == 0:
        return math.inf
    return float(np.partition(magnitude, -allowed)[-allowed])


def local_maxima(view: xr.DataArray, radius: float) -> pd.DataFrame:
    """Return the local maxima of a run-view before the density rule.

    Parameters
    ----------
    view : (y, x) xarray.DataArray
        Run-view.
    radius : float
        A maximum is the largest pixel within this distance, m.

    Returns
    -------
    DataFrame
        x, y (m), magnitude, from strong to weak; none on the border of the area seen.

    Raises
    ------
    ValueError
        If the view has other dimensions.
    """
    if view.dims != ("y", "x"):
        raise ValueError(f"view must have the dimensions (y, x), got {view.dims}")
    rows, columns = _maxima(view, radius)
    values = floats(view.values)
    return pd.DataFrame(
        {
            "x": view["x"].values[columns],
            "y": view["y"].values[rows],
            "magnitude": values[rows, columns],
        }
    )


def _maxima(view: xr.DataArray, radius: float) -> tuple[IndexArray, IndexArray]:
    """Return rows and columns of the local maxima, strongest first.

    Of equal pixels within the radius the first by row and column is taken.
    """
    values = floats(view.values)
    grid = grid_of(view)
    dy = grid.dy
    dx = grid.dx
    known = np.isfinite(values)
    filled = np.where(known, values, -np.inf)
    rows, columns = _candidates(filled, known, (dy, dx), radius)
    rows, columns = _largest_in_disc(filled, rows, columns, (dy, dx), radius)
    order = np.argsort(-values[rows, columns], kind="stable")
    rows = rows[order]
    columns = columns[order]

    # Equal pixels do not exceed each other: only the first of those within the radius is an alarm.
    selected: list[int] = []
    with_value: dict[float, list[int]] = {}
    for i in range(rows.size):
        equal = with_value.setdefault(float(values[rows[i], columns[i]]), [])
        down = (rows[equal] - rows[i]) * dy
        across = (columns[equal] - columns[i]) * dx
        if all(math.hypot(v, u) > radius for v, u in zip(down, across, strict=True)):
            selected.append(i)
            equal.append(i)
    return rows[selected], columns[selected]


def _candidates(
    filled: FloatArray,
    known: BoolArray,
    spacing: tuple[float, float],
    radius: float,
) -> tuple[IndexArray, IndexArray]:
    """Return the inner pixels that may be maxima.

    A maximum within the radius is one among its direct neighbours too, and those are quick to find.
    With neighbours beyond the radius all inner pixels may be maxima.
    """
    dy, dx = spacing
    inner = binary_erosion(known, np.ones((3, 3), bool), border_value=0)
    if min(dy, dx) > radius / math.sqrt(2):
        rows, columns = np.nonzero(inner)
        return rows, columns
    rows_compared = 3 if math.floor(radius / dy + 1e-9) else 1
    columns_compared = 3 if math.floor(radius / dx + 1e-9) else 1
    size = (rows_compared, columns_compared)
    largest = maximum_filter(filled, size=size, mode="constant", cval=-np.inf)
    rows, columns = np.nonzero((filled == largest) & inner)
    return rows, columns


def _largest_in_disc(
    filled: FloatArray,
    rows: IndexArray,
    columns: IndexArray,
    spacing: tuple[float, float],
    radius: float,
) -> tuple[IndexArray, IndexArray]:
    """Return the candidates that no pixel within the radius exceeds."""
    dy, dx = spacing
    ny = math.floor(radius / dy + 1e-9)
    nx = math.floor(radius / dx + 1e-9)
    padded = np.pad(filled, ((ny, ny), (nx, nx)), constant_values=-np.inf)
    v, u = np.mgrid[-ny : ny + 1, -nx : nx + 1].reshape(2, -1)
    disc = (v * dy) ** 2 + (u * dx) ** 2 <= radius**2 * (1 + 1e-9)
    # Far neighbours first, and as many at once as memory allows: they leave few candidates.
    order = np.argsort(-(v**2 + u**2)[disc], kind="stable")
    v = v[disc][order]
    u = u[disc][order]
    begin = 0
    while begin < v.size:
        count = min(max(_NEIGHBOURS_AT_ONCE // max(rows.size, 1), 1), -(-v.size // 8))
        step = slice(begin, begin + count)
        begin = step.stop
        neighbour_rows = rows[:, None] + (ny + v[step])
        neighbour_columns = columns[:, None] + (nx + u[step])
        neighbours = padded[neighbour_rows, neighbour_columns]
        largest = (filled[rows, columns, None] >= neighbours).all(axis=1)
        rows = rows[largest]
        columns = columns[largest]
    return rows, columns
