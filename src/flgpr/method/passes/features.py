"""The features of alarms, from the images of all scans that see them.

Contrast and polarimetric features are those of Wang et al. 2007, Eq. 5 to 17
(``features/alarm_features.py``). The others are those of the recipe's feature stages: a new
feature is a stage such as ``stages/tracking.py``, and its row in ``stages/named.py``.

What explains the alarms to the viewer: patches, cuts and A-scans of the nearest looks.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from flgpr.method.alarm_sums import AlarmSums
from flgpr.method.imaged_run import ImagedRun, table_arrays
from flgpr.method.passes.traversal import ImagedScan, Pass, features_key
from flgpr.types import Arrays, FloatArray, IndexArray


class Features(Pass):
    """Contrast, polarimetric features and the features of stages.

    Each is the mean over the scans that see an alarm. The result holds an array (alarm,) for every
    feature, and ``scans``: how many scans saw the alarm.
    """

    name = "features"
    title = "features"
    needs = ("gain", "alarms")
    cache_key = staticmethod(features_key)

    def __init__(self, lane: ImagedRun, block: range | None) -> None:
        alarms = lane.alarms()
        rows = np.arange(len(alarms)) if block is None else alarms_near(lane, alarms, block)
        super().__init__(lane, block, AlarmSums(lane.steps, alarms.iloc[rows], rows))

    def add(self, scan: ImagedScan) -> None:
        """Add a scan's values at the alarms that it sees."""
        self._sums.add(scan.cleaned)

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


class Explain(Pass):
    """The nearest looks at the strongest alarms, see :class:`flgpr.method.evidence.EvidenceSums`."""

    name = "explain"
    title = "what explains the alarms"
    needs = ("gain", "alarms")
    explains = True
    cache_key = staticmethod(features_key)

    def __init__(self, lane: ImagedRun, block: range | None) -> None:
        poses = None if block is None else poses_near(lane, block)
        super().__init__(lane, block, lane.evidence_sums(poses))

    def add(self, scan: ImagedScan) -> None:
        """Cut patches about the alarms that the scan sees from near out of its images."""
        self._sums.add(self.lane.steps.labelled(scan.cleaned), scan.data)

    def result(self) -> Arrays:
        """Return the nearest looks, for :meth:`flgpr.method.evidence.EvidenceSums.merge`."""
        return self._sums.state()


def poses_near(lane: ImagedRun, block: range) -> dict[int, FloatArray]:
    """Return the poses of all scans that may see what a scan of the block sees, by scan number."""
    scans = lane.imager.scans
    poses = lane.setup.run["pose"].values
    y = poses[scans, 1]
    y_of_block = poses[scans[block.start : block.stop], 1]

    # Two scans can see the same ground where their images, turned by any heading, overlap.
    farthest = float(np.abs(lane.near.extent()).max()) * np.sqrt(2)
    first = y_of_block.min() - 2 * farthest
    last = y_of_block.max() + 2 * farthest
    overlaps = (y >= first) & (y <= last)
    return {int(scan): poses[scan] for scan in scans[overlaps]}
