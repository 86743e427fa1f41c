"""Alarms: the local maxima of the run-view, of which the density rule leaves the strongest."""

from __future__ import annotations

import numpy as np
import pandas as pd

from flgpr.chain.engine import Arrays, bundle_groups
from flgpr.chain.lane_setup import table_arrays
from flgpr.chain.passes.traversal import Pass
from flgpr.screen import select


class Maxima(Pass):
    """What may become an alarm in the section's own rows, by local maxima or by the recipe's screen stage.

    No scan is read. The result holds a row per maximum: ``x``, ``y`` (m, lane frame),
    ``magnitude``, and the columns that feature stages read of the run-view; and ``seen``, the
    number of pixels of the prescreener's channel that were seen, on which the density rule counts
    (:func:`flgpr.chain.sections.lane_threshold`).
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
        if lane.screener is None:
            maxima = lane.steps.maxima(channel)
        else:
            maxima = lane.screener.alarms(view).select_dtypes("number")
        maxima = self._in_section(maxima)
        for stage in lane.columns:
            places = maxima[["x", "y"]].to_numpy(dtype=np.float64)
            maxima = maxima.assign(**stage.of_view(view, places))
        seen = np.count_nonzero(np.isfinite(channel.values[lane.own_rows]))
        return bundle_groups({"maximum": table_arrays(maxima)}) | {"seen": np.array(seen)}

    def _in_section(self, maxima: pd.DataFrame) -> pd.DataFrame:
        """Leave out what belongs to other sections; what lies between two rows belongs to the nearer."""
        grid = self.lane.grid
        y = grid.y[self.lane.section.rows]
        half = grid.dy / 2
        inside = (maxima["y"] >= y[0] - half) & (maxima["y"] < y[-1] + half)
        return maxima[inside].reset_index(drop=True)
