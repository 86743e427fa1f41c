"""The lane: the rectangle that is scored."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date, time
from typing import TYPE_CHECKING, Any

import numpy as np

from flgpr.model.bounds import shown_number

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Lane:
    """The rectangle that is scored; a point on its border is inside."""

    #: x_min, x_max, y_min, y_max: its borders in the lane frame, m
    x_min: float
    x_max: float
    y_min: float
    y_max: float

    def __post_init__(self) -> None:
        borders = (self.x_min, self.x_max, self.y_min, self.y_max)
        if not all(math.isfinite(border) for border in borders):
            raise ValueError(f"lane borders must be finite, got {borders}")
        if not (self.x_max > self.x_min and self.y_max > self.y_min):
            raise ValueError(
                "lane must have x_max > x_min and y_max > y_min, got an empty lane "
                f"x {self.x_min:g}..{self.x_max:g} m, y {self.y_min:g}..{self.y_max:g} m"
            )

    @property
    def area(self) -> float:
        """Area, m²."""
        return (self.x_max - self.x_min) * (self.y_max - self.y_min)

    def distance(self, x: Any, y: Any) -> Any:
        """Return the distance of points from the lane, m; zero in it and on its border."""
        x = np.asarray(x, dtype=float)
        y = np.asarray(y, dtype=float)
        beyond_x = np.maximum(np.maximum(self.x_min - x, x - self.x_max), 0)
        beyond_y = np.maximum(np.maximum(self.y_min - y, y - self.y_max), 0)
        return np.hypot(beyond_x, beyond_y)

    def contains(self, x: Any, y: Any) -> Any:
        """Mark the points that lie in the lane or on its border."""
        x = np.asarray(x, dtype=float)
        y = np.asarray(y, dtype=float)
        return (x >= self.x_min) & (x <= self.x_max) & (y >= self.y_min) & (y <= self.y_max)


def as_lane(lane: Lane | Mapping[str, float] | pd.DataFrame | pd.Series[Any]) -> Lane:
    """Return a lane, or make one of what holds x_min, x_max, y_min and y_max (m) once.

    A border that is missing or wrong is a ValueError.
    """
    if isinstance(lane, Lane):
        return lane
    row: Any = lane
    if getattr(row, "ndim", 1) == 2:  # a table; pandas is not imported to ask, which takes long
        if len(row) != 1:
            raise ValueError(f"lane must be one row, got a table of {len(row)} rows")
        row = row.iloc[0]
    names = ("x_min", "x_max", "y_min", "y_max")
    missing = [name for name in names if name not in row]
    if missing:
        raise ValueError(f"lane must hold {', '.join(names)}; missing: {', '.join(missing)}")
    return Lane(*(_border(row[name], name) for name in names))


def _border(value: Any, name: str) -> float:
    """Return a border of a lane, m; what is no number is a ValueError."""
    try:
        if not isinstance(value, bool | np.bool_):
            return float(value)
    except (ValueError, TypeError, OverflowError):
        pass
    shown = (
        str(value)
        if isinstance(value, str | date | time | bool | np.bool_)
        else shown_number(value)
    )
    raise ValueError(f"lane.{name} must be a number (m), got {shown[:40]}")
