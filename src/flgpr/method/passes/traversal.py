"""What a pass is, and how several go through the scans of a lane together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, ClassVar

from flgpr.engine import Accumulator, PlannedPass, bundle_groups, group_of
from flgpr.method.imaged_run import ImagedRun
from flgpr.method.imaged_scan import ImagedScan
from flgpr.types import AnyArray, Arrays


class Pass:
    """One pass over the scans of a lane, or over one block of them.

    A subclass overrides what it does; by default a pass reads no scan and has no state.

    Parameters
    ----------
    lane : ImagedRun
        The lane, with the results of earlier passes.
    block : range or None
        The block whose scans are added; None where the states of all blocks are merged.
    """

    name: ClassVar[str]  #: the name of its result among those of the lane
    title: ClassVar[str]  #: what it is called where progress is shown
    needs: ClassVar[tuple[str, ...]] = ()  #: earlier passes whose results it reads
    #: goes through all scans even where a section of the lane is wanted
    all_scans: ClassVar[bool] = False
    needs_no_scans: ClassVar[bool] = False  #: works on the results of earlier passes alone
    #: gathers what the viewer shows beside the alarms; left out where nothing is to be explained
    explains: ClassVar[bool] = False

    def __init__(self, lane: ImagedRun, block: range | None) -> None:  # noqa: ARG002
        self.lane = lane

    def add(self, scan: ImagedScan) -> None:
        """Add one scan's images, gains and pose."""

    def state(self, exact: bool) -> Arrays:  # noqa: ARG002
        """Return everything gathered so far as plain arrays, which checkpoints and workers write.

        With ``exact`` a pass that merges the state continues with the same bits. Without it the
        precision of the result suffices, and the state may be smaller.
        """
        return {}

    def merge(self, state: Mapping[str, AnyArray]) -> None:
        """Merge the state of the block that follows."""

    def result(self) -> Arrays:
        """Return what later passes read."""
        raise NotImplementedError

    @staticmethod
    def cache_key(lane: ImagedRun) -> dict[str, Any] | None:  # noqa: ARG004
        """Return what the result depends on, by which other recipes share it.

        None if no other recipe can use the result.
        """
        return None


def traversal(lane: ImagedRun, kinds: Sequence[type[Pass]], block: range | None) -> Accumulator:
    """Begin passes that go through the same scans together and share each scan's images.

    States and results are those of the only pass, or those of all as groups.

    Parameters
    ----------
    lane : ImagedRun
        The lane.
    kinds : sequence of type
        The classes of the passes.
    block : range or None
        As of :class:`Pass`.
    """
    passes = {kind.name: kind(lane, block) for kind in kinds}

    def add(index: int) -> None:
        scan = ImagedScan(lane, index)
        for member in passes.values():
            member.add(scan)

    def state(exact: bool) -> Arrays:
        return _joined({name: member.state(exact) for name, member in passes.items()})

    def merge(state: Mapping[str, AnyArray]) -> None:
        for name, member in passes.items():
            member.merge(state if len(passes) == 1 else group_of(state, name))

    def result() -> Arrays:
        return _joined({name: member.result() for name, member in passes.items()})

    return Accumulator(add, state, merge, result)


def _joined(groups: Mapping[str, Arrays]) -> Arrays:
    """Return the arrays of the only group, or those of all in one mapping."""
    if len(groups) > 1:
        return bundle_groups(groups)
    (only,) = groups.values()
    return only


def plan(lane: ImagedRun, *kinds: type[Pass]) -> PlannedPass:
    """Plan passes that go through the scans of a lane together, under the name of the first.

    Those that only explain alarms are left out where the lane is not to be explained.

    Parameters
    ----------
    lane : ImagedRun
        The lane.
    *kinds : type
        Classes of passes.

    Returns
    -------
    PlannedPass
        What the engine runs.
    """
    chosen = [kind for kind in kinds if lane.explains or not kind.explains]
    first = chosen[0]
    needs: list[str] = []
    for kind in chosen:
        for name in kind.needs:
            if name not in needs:
                needs.append(name)
    return PlannedPass(
        first.name,
        first.title,
        partial(traversal, lane, chosen),
        tuple(needs),
        all_scans=first.all_scans,
        needs_no_scans=first.needs_no_scans,
        cache_key=partial(first.cache_key, lane),
    )
