"""Alarms: the local maxima of the run-view, of which the density rule leaves the strongest."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.engine import bundle_groups
from flgpr.method.imaged_run import table_arrays
from flgpr.method.passes.traversal import Pass
from flgpr.screen import select
from flgpr.types import Arrays


class Maxima(Pass):
    """Candidate alarms of the section's own rows (Wang et al. 2007, Sec. II-B).

    They are the local maxima of the prescreener's channel, or what the recipe's screen stage
    raises. No scan is read.

    The result holds a row per maximum: ``x``, ``y`` (m, lane frame), ``magnitude``, and the columns
    that feature stages read of the run-view. It also holds ``seen``, the number of pixels of the
    prescreener's channel that were seen: the density rule counts on their area
    (:func:`flgpr.method.sections.lane_threshold`).
    """

    name = "alarms"
    title = "alarms"
    needs = ("view",)
    needs_no_scans = True

    def result(self) -> Arrays:
        """Find the maxima of the run-view."""
        lane = self.lane
        screen = lane.recipe.prescreen
        view = lane.view(all_rows=True)
        channel = select(view, screen.polarization, screen.subband)

        maxima = self._in_section(self._candidates(view, channel))
        places = maxima[["x", "y"]].to_numpy(dtype=np.float64)
        columns: dict[str, Any] = {name: maxima[name] for name in maxima.columns}
        for stage in lane.columns:
            columns.update(stage.of_view(view, places))
        # Of all columns at once: there may be thousands.
        maxima = pd.DataFrame(columns, index=maxima.index)

        pixels_seen = np.count_nonzero(np.isfinite(channel.values[lane.own_rows]))
        groups = {"maximum": table_arrays(maxima)}
        return bundle_groups(groups) | {"seen": np.array(pixels_seen)}

    def _candidates(self, view: xr.DataArray, channel: xr.DataArray) -> pd.DataFrame:
        """Return the maxima of a channel, or what the recipe's screen stage raises on the view."""
        lane = self.lane
        if lane.screener is None:
            return lane.steps.maxima(channel)
        return lane.screener.alarms(view).select_dtypes("number")

    def _in_section(self, maxima: pd.DataFrame) -> pd.DataFrame:
        """Leave out the maxima of other sections; one between two rows belongs to the nearer."""
        grid = self.lane.grid
        y = grid.y[self.lane.section.rows]
        half = grid.dy / 2
        inside = (maxima["y"] >= y[0] - half) & (maxima["y"] < y[-1] + half)
        return maxima[inside].reset_index(drop=True)
