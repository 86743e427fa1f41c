"""The clutter of a lane as the learnt map sees it, to be compared with that of the training lanes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from flgpr.method.imaged_run import ImagedRun
from flgpr.method.imaged_scan import ImagedScan
from flgpr.method.passes.traversal import Pass
from flgpr.method.unlike import MEASURED, SIZES, chosen_scans, size_number
from flgpr.types import AnyArray, Arrays


class LaneClutter(Pass):
    """Sums of the clutter of some scans of a lane.

    The result holds the arrays of the map's ``clutter_of`` with a first axis: its sums up to a
    number are those of the first ``SIZES`` scans that are looked at. ``scans`` is their number.
    """

    name = MEASURED
    title = "clutter compared with the training"
    needs = ("gain",)
    all_scans = True

    def __init__(self, lane: ImagedRun, block: range | None) -> None:
        super().__init__(lane, block)
        chosen = chosen_scans(len(lane)).tolist()
        self._places = {index: place for place, index in enumerate(chosen)}
        self._sums: Arrays = {}

    def add(self, scan: ImagedScan) -> None:
        """Add the clutter of a scan, if it is one of those that are looked at."""
        place = self._places.get(scan.index)
        if place is None:
            return
        lane = self.lane
        image = scan.near_image
        coherent = lane.background.own_coherent(image.values, scan.gain)
        of_scan = lane.mapper.clutter_of(image.copy(data=coherent))
        arrays = {}
        for name, array in of_scan.items():
            arrays[name] = np.zeros((len(SIZES), *array.shape), array.dtype)
            arrays[name][size_number(place)] = array
        self._merge(arrays)

    def state(self, exact: bool) -> Arrays:  # noqa: ARG002
        """Return the sums; none where no scan of the block is looked at."""
        return dict(self._sums)

    def merge(self, state: Mapping[str, AnyArray]) -> None:
        """Add the sums of the block that follows."""
        self._merge(state)

    def _merge(self, arrays: Mapping[str, AnyArray]) -> None:
        """Add sums to those so far."""
        for name, array in arrays.items():
            self._sums[name] = self._sums[name] + array if name in self._sums else np.array(array)

    def result(self) -> Arrays:
        """Return the sums."""
        return self._sums | {"scans": np.array(len(self._places))}
