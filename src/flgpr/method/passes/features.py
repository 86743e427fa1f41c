"""The features of alarms, from the images of all scans that see them.

Contrast and polarimetric features are those of Wang et al. 2007, Eq. 5 to 17
(``features/alarm_features.py``). The other columns are those of the recipe's feature stages: a new
column is a stage such as ``stages/tracking.py``, and its row in ``stages/__init__.py``.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from flgpr.method.alarm_sums import AlarmSums
from flgpr.method.cache_key import features_key
from flgpr.method.imaged_run import ImagedRun, table_arrays
from flgpr.method.imaged_scan import ImagedScan
from flgpr.method.passes.traversal import Pass
from flgpr.types import AnyArray, Arrays, IndexArray


class Features(Pass):
    """Contrast, polarimetric features and the columns of stages.

    Each is the mean over the scans that see an alarm. The result holds an array (alarm,) for every
    column, ``scans`` among them: how many scans saw the alarm.
    """

    name = "features"
    title = "features"
    needs = ("gain", "alarms")
    cache_key = staticmethod(features_key)

    def __init__(self, lane: ImagedRun, block: range | None) -> None:
        super().__init__(lane, block)
        alarms = lane.alarms()
        rows = np.arange(len(alarms)) if block is None else alarms_near(lane, alarms, block)
        self._sums = AlarmSums(lane.steps, alarms.iloc[rows], rows)

    def add(self, scan: ImagedScan) -> None:
        """Add a scan's values at the alarms that it sees."""
        self._sums.add(scan.cleaned)

    def state(self, exact: bool) -> Arrays:  # noqa: ARG002
        """Return the sums of the alarms that the block may see."""
        return self._sums.state()

    def merge(self, state: Mapping[str, AnyArray]) -> None:
        """Merge the sums of the block that follows."""
        self._sums.merge(state)

    def result(self) -> Arrays:
        """Return the features of all alarms."""
        return table_arrays(self._sums.table())


def alarms_near(lane: ImagedRun, alarms: pd.DataFrame, block: range) -> IndexArray:
    """Return the numbers of the alarms that a scan of the block may see."""
    scans = lane.imager.scans[block.start : block.stop]
    y_of_block = lane.setup.run["pose"].values[scans, 1]
    x_min, x_max, _, y_max = lane.near.extent()
    farthest = np.hypot(max(abs(x_min), abs(x_max)), y_max)
    y = alarms["y"].to_numpy(dtype=np.float64)
    may_see = (y >= y_of_block.min() - farthest) & (y <= y_of_block.max() + farthest)
    return np.flatnonzero(may_see)
