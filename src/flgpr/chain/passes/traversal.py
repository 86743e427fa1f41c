"""What a pass is, and how several go through the scans of a lane together."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, ClassVar

from numpy.typing import NDArray

from flgpr.chain.engine import Arrays, PlannedPass, bundle_groups, group_of
from flgpr.chain.lane_scan import LaneScan
from flgpr.chain.lane_setup import LaneSetup


class Pass:
    """One pass over the scans of a lane, or of one block of them.

    A class is made for a lane and a block; ``block`` is None where it merges the states of all
    blocks. What a pass leaves out, it does not do: by default it reads no scan and has no state.
    """

    name: ClassVar[str]  #: the name of its result among those of the lane
    title: ClassVar[str]  #: what it is called where progress is shown
    needs: ClassVar[tuple[str, ...]] = ()  #: earlier passes whose results it reads
    #: goes through all scans even where a section of the lane is wanted
    all_scans: ClassVar[bool] = False
    needs_no_scans: ClassVar[bool] = False  #: works on the results of earlier passes alone

    def __init__(self, lane: LaneSetup, block: range | None) -> None:  # noqa: ARG002
        self.lane = lane

    def add(self, scan: LaneScan) -> None:
        """Add one scan's images, gains and pose."""

    def state(self, exact: bool) -> Arrays:  # noqa: ARG002
        """Return everything gathered so far, as plain arrays: what a checkpoint holds and a worker leaves.

        With ``exact`` another goes on with the same bits; else the precision of the result
        suffices.
        """
        return {}

    def merge(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Merge the state of the block that follows."""

    def result(self) -> Arrays:
        """Return what later passes read."""
        raise NotImplementedError

    @staticmethod
    def cache_key(lane: LaneSetup) -> dict[str, Any] | None:  # noqa: ARG004
        """Return what the result depends on, so that other recipes can share it; None if it is not shared."""
        return None


class Traversal:
    """One or several passes that go through the same scans together, and share each scan's images."""

    def __init__(self, lane: LaneSetup, kinds: tuple[type[Pass], ...], block: range | None) -> None:
        self._lane = lane
        self._passes = {kind.name: kind(lane, block) for kind in kinds}

    def add(self, index: int) -> None:
        """Add the scan at an index among the complete ones to every pass."""
        scan = LaneScan(self._lane, index)
        for each in self._passes.values():
            each.add(scan)

    def state(self, exact: bool) -> Arrays:
        """Return the state of the only pass, or those of all as groups."""
        return _joined({name: each.state(exact) for name, each in self._passes.items()})

    def merge(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Merge what :meth:`state` returned for the block that follows."""
        for name, each in self._passes.items():
            each.merge(state if len(self._passes) == 1 else group_of(state, name))

    def result(self) -> Arrays:
        """Return the result of the only pass, or those of all as groups."""
        return _joined({name: each.result() for name, each in self._passes.items()})


def _joined(groups: Mapping[str, Arrays]) -> Arrays:
    if len(groups) > 1:
        return bundle_groups(groups)
    (only,) = groups.values()
    return only


def plan(lane: LaneSetup, *kinds: type[Pass]) -> PlannedPass:
    """Plan passes that go through the scans of a lane together, under the name of the first."""
    first = kinds[0]
    needs: list[str] = []
    for kind in kinds:
        needs += kind.needs
    return PlannedPass(
        first.name,
        first.title,
        partial(Traversal, lane, kinds),
        tuple(dict.fromkeys(needs)),
        all_scans=first.all_scans,
        needs_no_scans=first.needs_no_scans,
        cache_key=partial(first.cache_key, lane),
    )
