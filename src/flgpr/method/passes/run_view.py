"""The run-view: what the scans that see a place of the lane show there (Wang et al., Sec. II-B).

That is the second largest look at every place, or the mean look, or one look for each of several
ranges, as the recipe has it. ``Steps.view_sums`` (``method/steps.py``) chooses among the looks that
``screen/views.py`` takes; the recipe's names for them stand in ``recipe/tables.py``.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from flgpr.engine import bundle_groups, group_of
from flgpr.method.cache_key import view_key
from flgpr.method.imaged_run import ImagedRun
from flgpr.method.imaged_scan import ImagedScan
from flgpr.method.passes.traversal import Pass
from flgpr.screen import RunViewSums
from flgpr.types import AnyArray, Arrays

_AS_LEARNT = "as_learnt"


class RunView(Pass):
    """The recipe's look at every place of the lane, of cleaned images or their map.

    The result holds ``view`` (polarization, subband, y, x) in units of the background, and
    ``looks`` (y, x), the number of scans that saw a place. Where the lane's own clutter
    stands in for what the map has learnt, it also holds ``as_learnt`` (1, 1, y, x): the run-view of
    the learnt map.
    """

    name = "view"
    title = "run-view"
    needs = ("gain",)
    cache_key = staticmethod(view_key)

    def __init__(self, lane: ImagedRun, block: range | None) -> None:
        super().__init__(lane, block)
        self._grid = lane.near
        self._sums = lane.steps.view_sums(lane.grid, lane.rows_of(block))
        self._as_learnt = None
        if lane.replaces_map:
            self._as_learnt = lane.steps.view_sums(lane.grid, lane.rows_of(block))

    def add(self, scan: ImagedScan) -> None:
        """Lay a scan's image on the lane."""
        self._sums.add(scan.magnitude(), self._grid, scan.pose)
        if self._as_learnt is not None:
            self._as_learnt.add(scan.map_as_learnt(), self._grid, scan.pose)

    def state(self, exact: bool) -> Arrays:  # noqa: ARG002
        """Return the looks of the rows that the block reaches."""
        if self._as_learnt is None:
            return self._sums.state()
        return self._sums.state() | bundle_groups({_AS_LEARNT: self._as_learnt.state()})

    def merge(self, state: Mapping[str, AnyArray]) -> None:
        """Merge the looks of the block that follows."""
        as_learnt = group_of(state, _AS_LEARNT)
        self._sums.merge({name: state[name] for name in state if "|" not in name})
        if self._as_learnt is not None:
            self._as_learnt.merge(as_learnt)

    def result(self) -> Arrays:
        """Return the run-view; ranges stand beside the sub-bands."""
        arrays: Arrays = {}
        values, looks = self._sums.result()
        polarizations = len(values)
        arrays["view"] = values.reshape(polarizations, -1, *values.shape[-2:])
        arrays["looks"] = looks
        if self._as_learnt is not None:
            values, _ = self._as_learnt.result()
            arrays[_AS_LEARNT] = values.reshape(len(values), -1, *values.shape[-2:])
        return arrays


class PlainRunView(Pass):
    """The second largest look before the background is removed, for the viewer."""

    name = "before"
    title = "run-view before clutter suppression"
    explains = True
    needs = ("gain",)
    cache_key = staticmethod(view_key)

    def __init__(self, lane: ImagedRun, block: range | None) -> None:
        super().__init__(lane, block)
        self._grid = lane.near
        self._sums = RunViewSums(lane.grid, lane.recipe.run_view.y_max, lane.rows_of(block))

    def add(self, scan: ImagedScan) -> None:
        """Lay the magnitude of a scan's image on the lane."""
        self._sums.add(np.abs(scan.near_image.values), self._grid, scan.pose)

    def state(self, exact: bool) -> Arrays:  # noqa: ARG002
        """Return the looks of the rows that the block reaches."""
        return self._sums.state()

    def merge(self, state: Mapping[str, AnyArray]) -> None:
        """Merge the looks of the block that follows."""
        self._sums.merge(dict(state))

    def result(self) -> Arrays:
        """Return ``view`` and ``looks``, as of :class:`RunView`."""
        values, looks = self._sums.result()
        return {"view": values, "looks": looks}
