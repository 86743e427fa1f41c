"""What explains the alarms to the viewer: patches, cuts and A-scans of the nearest looks."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from flgpr.method.cache_key import features_key
from flgpr.method.imaged_run import ImagedRun
from flgpr.method.imaged_scan import ImagedScan
from flgpr.method.passes.traversal import Pass
from flgpr.types import AnyArray, Arrays, FloatArray


class Explain(Pass):
    """The nearest looks at the strongest alarms, see :class:`flgpr.method.evidence.EvidenceSums`."""

    name = "explain"
    title = "what explains the alarms"
    needs = ("gain", "alarms")
    explains = True
    cache_key = staticmethod(features_key)

    def __init__(self, lane: ImagedRun, block: range | None) -> None:
        super().__init__(lane, block)
        poses = None if block is None else poses_near(lane, block)
        self._sums = lane.evidence_sums(poses)

    def add(self, scan: ImagedScan) -> None:
        """Cut patches about the alarms that the scan sees from near out of its images."""
        self._sums.add(self.lane.steps.labelled(scan.cleaned), scan.data)

    def state(self, exact: bool) -> Arrays:  # noqa: ARG002
        """Return the looks so far."""
        return self._sums.state()

    def merge(self, state: Mapping[str, AnyArray]) -> None:
        """Merge the looks of the block that follows."""
        self._sums.merge(dict(state))

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
