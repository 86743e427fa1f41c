"""The density rule while scans come in: maxima and area of the ground seen so far."""

from __future__ import annotations

import bisect
import math
from array import array

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.model import Lane
from flgpr.recipe.tables import PrescreenTable
from flgpr.screen import counts, density_threshold


class SeenDensity:
    """The density rule of Wang et al. 2007, Sec. II-B, applied to the ground seen so far.

    Maxima and area of final ground are stored. Those of open ground change with every scan and are
    counted anew.

    Parameters
    ----------
    screen : PrescreenTable
        Radius and density of the rule, and where it counts.
    spacing : float
        Pixel of the run-view, m.
    """

    def __init__(self, screen: PrescreenTable, spacing: float) -> None:
        self._screen = screen
        self._spacing = spacing
        self.magnitudes = array("d")  # of all final maxima that count, ascending
        self.final_area = 0.0  # m²

    def threshold(
        self, maxima: pd.DataFrame, view: xr.DataArray, closed: float, lane: Lane
    ) -> float:
        """Return the magnitude that the rule asks for.

        Parameters
        ----------
        maxima : DataFrame
            Maxima of the open ground: ``x``, ``y``, ``magnitude``.
        view : (y, x) DataArray
            The run-view; NaN where no scan has seen the ground.
        closed : float
            Ground up to this lane y is final, m.
        lane : Lane
            Ground that is searched.
        """
        counted = self._counts(maxima["x"], maxima["y"], lane)
        final = np.frombuffer(self.magnitudes)
        magnitudes = np.append(final, maxima["magnitude"].to_numpy()[counted])
        area = self.final_area + self._area(view, closed, math.inf, lane)
        return density_threshold(magnitudes, area, self._screen.radius, self._screen.density)

    def close(
        self, maxima: pd.DataFrame, view: xr.DataArray, closed: float, limit: float, lane: Lane
    ) -> None:
        """Count the maxima and the area between the final ground and lane y ``limit`` for good.

        Parameters
        ----------
        maxima, view, closed, lane
            As of :meth:`threshold`.
        limit : float
            Ground up to this lane y becomes final, m.
        """
        passed = (maxima["y"] <= limit).to_numpy()
        counted = maxima[self._counts(maxima["x"], maxima["y"], lane) & passed]
        for magnitude in counted["magnitude"]:
            bisect.insort(self.magnitudes, float(magnitude))
        self.final_area += self._area(view, closed, limit, lane)

    def _counts(
        self, x: pd.Series | NDArray[np.float64], y: pd.Series | NDArray[np.float64], lane: Lane
    ) -> NDArray[np.bool_]:
        """Return which positions the rule counts."""
        return counts(x, y, lane, self._screen.count)

    def _area(self, view: xr.DataArray, low: float, high: float, lane: Lane) -> float:
        """Return the area between two lane y that was seen and that the rule counts, m²."""
        x, y = np.meshgrid(view["x"].values, view["y"].values)
        counted = np.isfinite(view.values) & (y > low) & (y <= high) & self._counts(x, y, lane)
        return float(counted.sum()) * self._spacing**2
