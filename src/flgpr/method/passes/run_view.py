"""The run-view: what the scans that see a place of the lane show there (Wang et al., Sec. II-B).

That is the second largest look at every place, or the mean look, or one look for each of several
ranges, as the recipe has it. ``Steps.view_sums`` (``method/steps.py``) chooses among the looks that
``screen/views.py`` takes; the recipe's names for them stand in ``recipe/tables.py``.

Alarms on every scan's image, for recipes that score by frames (Fuse et al. 2018, Sec. 4).

Alarms: the local maxima of the run-view, of which the density rule leaves the strongest.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
import pandas as pd

from flgpr.engine import bundle_groups, concatenate, group_of
from flgpr.method.imaged_run import ImagedRun, table_arrays
from flgpr.method.passes.traversal import ImagedScan, Pass, view_key
from flgpr.screen import RunViewSums, frame_alarms, select
from flgpr.types import AnyArray, Arrays, Entries, FloatArray

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
        super().__init__(lane, block, lane.steps.view_sums(lane.grid, lane.rows_of(block)))
        self._as_learnt = None
        if lane.replaces_map:
            self._as_learnt = lane.steps.view_sums(lane.grid, lane.rows_of(block))

    def add(self, scan: ImagedScan) -> None:
        """Lay a scan's image on the lane."""
        self._sums.add(scan.magnitude(), self.lane.near, scan.pose)
        if self._as_learnt is not None:
            self._as_learnt.add(scan.map_as_learnt(), self.lane.near, scan.pose)

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
        values, looks = self._sums.result()
        arrays = {"view": values.reshape(len(values), -1, *values.shape[-2:]), "looks": looks}
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
    day: ClassVar[str] = "today"

    def __init__(self, lane: ImagedRun, block: range | None) -> None:
        sums = RunViewSums(lane.grid, lane.recipe.run_view.y_max, lane.rows_of(block))
        super().__init__(lane, block, sums)

    def add(self, scan: ImagedScan) -> None:
        """Lay the magnitude of a scan's image on the lane."""
        self._sums.add(scan.of_day(self.day), self.lane.near, scan.pose)

    def result(self) -> Arrays:
        """Return ``view`` and ``looks``, as of :class:`RunView`."""
        values, looks = self._sums.result()
        return {"view": values, "looks": looks}


class EarlierRunView(PlainRunView):
    """The second largest look of the earlier drive nearest to each scan, for the viewer."""

    name = "earlier"
    title = "run-view of the earlier drive"
    day = "earlier"


class FrameAlarms(Pass):
    """The local maxima of every scan's image, once it sums as many scans as the recipe wants.

    The result holds ``frame``, ``pose`` and ``count`` (the number of its alarms) for every frame,
    and ``x``, ``y`` (m, scan frame) and ``magnitude`` for every alarm, frame after frame.
    """

    name = "frames"
    title = "alarms of every frame"
    needs = ("gain",)
    all_scans = True

    def __init__(self, lane: ImagedRun, block: range | None) -> None:
        super().__init__(lane, block)
        screen = lane.recipe.prescreen
        labels = lane.labels()
        polarization = labels["polarization"].index(screen.polarization)
        subband = labels["subband"].index(screen.subband)
        self._channel = (polarization, subband)
        self._frames: list[Arrays] = []

    def add(self, scan: ImagedScan) -> None:
        """Add the alarms of a scan's image."""
        if scan.index + 1 < self.lane.setup.summed:
            return
        recipe = self.lane.recipe
        magnitude = scan.magnitude()[self._channel]
        grid = self.lane.near
        alarms = frame_alarms(magnitude, grid, recipe.frame_area(), recipe.prescreen.radius)
        frame: Arrays = {
            "frame": np.array([scan.index]),
            "pose": scan.pose[None],
            "count": np.array([len(alarms)]),
        }
        self._frames.append(frame | table_arrays(alarms[["x", "y", "magnitude"]]))

    def state(self, exact: bool) -> Arrays:  # noqa: ARG002
        """Return the alarms so far, by frame."""
        return concatenate(self._frames)

    def merge(self, state: Mapping[str, AnyArray]) -> None:
        """Append the alarms of the block that follows."""
        if state:
            self._frames.append(dict(state))

    def result(self) -> Arrays:
        """Return the alarms of all frames."""
        return concatenate(self._frames)


def alarms_by_frame(lane: ImagedRun) -> tuple[pd.DataFrame, dict[int, FloatArray]]:
    """Return the alarms of all frames, and the pose of each frame by its number.

    Needs the result of the pass "frames".

    Returns
    -------
    alarms : DataFrame
        ``frame``, ``across`` and ``ahead`` (m, scan frame), ``confidence``.
    poses : dict
        Pose (6,) by frame.
    """
    arrays = lane.results["frames"]
    alarms = pd.DataFrame(
        {
            "frame": np.repeat(arrays["frame"], arrays["count"]),
            "across": arrays["x"],
            "ahead": arrays["y"],
            "confidence": arrays["magnitude"],
        }
    )
    poses = dict(zip(arrays["frame"].tolist(), arrays["pose"], strict=True))
    return alarms, poses


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

        if lane.screener is None:
            maxima = self._in_section(lane.steps.maxima(channel))
        else:
            maxima = self._in_section(lane.screener.alarms(view).select_dtypes("number"))
        places = maxima[["x", "y"]].to_numpy(dtype=np.float64)
        columns: Entries = {name: maxima[name] for name in maxima.columns}
        for stage in lane.columns:
            columns.update(stage.of_view(view, places))
        # Of all columns at once: there may be thousands.
        maxima = pd.DataFrame(columns, index=maxima.index)

        pixels_seen = np.count_nonzero(np.isfinite(channel.values[lane.own_rows]))
        groups = {"maximum": table_arrays(maxima)}
        return bundle_groups(groups) | {"seen": np.array(pixels_seen)}

    def _in_section(self, maxima: pd.DataFrame) -> pd.DataFrame:
        """Leave out the maxima of other sections; one between two rows belongs to the nearer."""
        grid = self.lane.grid
        y = grid.y[self.lane.section.rows]
        half = grid.dy / 2
        inside = (maxima["y"] >= y[0] - half) & (maxima["y"] < y[-1] + half)
        return maxima[inside].reset_index(drop=True)
