"""Detection scan by scan: scans go in and alarms come out; this module reads and writes no files.

The chain is that of Wang et al. 2007 with causal estimates. The background comes from the scans
before, the run-view from the scans that still see the ground ahead, and the density rule counts
maxima on the ground seen so far. Where a scan goes whose pose is bad is told at the top of
``live/session.py``.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numba
import numpy as np
import pandas as pd
import xarray as xr

from flgpr.clutter import CausalBackground
from flgpr.clutter.causal import LEAST_SPAN, LEAST_WARM_UP
from flgpr.imaging import ImagingOperator
from flgpr.live.alarm_book import AlarmBook, SeenDensity
from flgpr.live.causal_steps import WITHOUT_END, causal_steps, check_causal, run_to_come
from flgpr.live.earlier_drives import EarlierDrives
from flgpr.live.event_types import ViewGrid
from flgpr.live.ground import RunningGround
from flgpr.live.updates import LiveAlarm, LiveUpdate, last_states
from flgpr.method.alarm_sums import AlarmSums
from flgpr.method.imaged_run import ImagedRun
from flgpr.method.model import Detector, Model
from flgpr.method.steps import CleanedImages
from flgpr.method.unlike import Trust
from flgpr.model import Grid, Lane, lane_to_scan, vehicle_to_scan
from flgpr.model.plausible import PoseGate, Sighting, Verdict
from flgpr.recipe.fit import alias_faults, check_channels, check_reached
from flgpr.recipe.schema import Recipe, course_lane
from flgpr.screen import (
    look_weight,
    seen_along,
    view_array,
)
from flgpr.screen.views import pixels_at
from flgpr.stages import MapStage
from flgpr.store import RunDescription, Scan
from flgpr.types import Arrays, ComplexArray, Entries, FloatArray, floats

# m; ground farther back than this before a scan is closed without another look
_FARTHEST_GAP = 50.0
_MOST_SCANS = 64


@dataclass(frozen=True)
class LiveSettings:
    """How the live chain trades time for certainty."""

    looks: int = 3  #: scans that must have seen a place before an alarm is raised there
    #: the first scan that is cleaned, counted from 1; those before it only teach the background. At
    #: least 3
    warm_up: int = 5
    span: int | None = None  #: scans that the background remembers; None remembers all
    #: a scan nearer than this to the last one taken is left out, m: a vehicle that stands shows
    #: nothing new, and its scans would teach the background what stands before it
    least_step: float = 0.25

    def __post_init__(self) -> None:
        least = {"looks": 1, "warm_up": LEAST_WARM_UP, "span": LEAST_SPAN}
        for name, lowest in least.items():
            value = getattr(self, name)
            if value is not None and value < lowest:
                raise ValueError(f"{name} must be at least {lowest}, got {value}")
        if not self.least_step >= 0.05:
            raise ValueError(f"least_step must be at least 0.05 m, got {self.least_step}")


class LiveDetector:
    """Raise alarms while scans come in; only the sub-bands that decide on alarms are imaged.

    Parameters
    ----------
    description : RunDescription
        The radar of the run: tones, antenna positions and polarizations.
    recipe : Recipe
        What is computed.
    lane : Lane, optional
        Ground that is searched. Without one, here or in the recipe, the lane is 3 m about the first
        pose and has no end.
    model : Model or Detector, optional
        What the recipe's stages have learnt. Without a detector the local contrast is the
        confidence.
    settings : LiveSettings, optional
        Scans before an alarm, warm-up and least step.
    others : mapping of str to xarray.Dataset, optional
        Earlier runs of the road, "before", "before-2" and so on, for the stage "earlier".

    Raises
    ------
    ValueError
        If the recipe cannot run live, or needs channels that the radar lacks, a model that is not
        given, or earlier runs that are not given or of another radar.
    """

    def __init__(
        self,
        description: RunDescription,
        recipe: Recipe,
        lane: Lane | None = None,
        model: Model | Detector | None = None,
        settings: LiveSettings | None = None,
        others: Mapping[str, xr.Dataset] | None = None,
    ) -> None:
        self.description = description
        self.recipe = recipe
        self.settings = settings or LiveSettings()
        self.lane = lane
        if self.lane is None and recipe.lane is not None:
            self.lane = recipe.lane.lane()
        check_causal(recipe)
        if self.lane is not None:
            check_reached(recipe, self.lane)
        check_channels(recipe, description.polarization, description.frequency)
        chain = ImagedRun(
            run_to_come(description),
            recipe,
            self.lane or course_lane(recipe, np.zeros((1, 6)), WITHOUT_END),
            model,
            others=others,
            explains=False,
            trust=Trust("keep"),  # what stands in for what was learnt needs the whole run
        )
        self.model = chain.model
        self.mapper: MapStage | None = chain.mapper
        self.steps = causal_steps(chain)
        self.grid = self.steps.grid
        # rows that the background of the rows that count depends on
        self._rows = chain.background_rows
        # All are imaged to tell how far drives are moved onto each other.
        image = recipe.image
        self._subbands = list(self.steps.subbands if chain.earlier is None else image.subbands)
        #: what subtracts what earlier drives predict; None without them
        self.earlier: EarlierDrives | None = None
        if chain.earlier is not None:
            wanted = [self._subbands.index(name) for name in self.steps.subbands]
            self.earlier = EarlierDrives(chain.earlier, wanted, self._rows, self.settings.span)
        self._imager = chain.imager
        self._pixels = image.grid().points()
        self._imaged = chain.setup.imaged
        self._operator: tuple[tuple[float, ...], ImagingOperator] | None = None

        self.gate = PoseGate(recipe.motion)
        # scans held back until others agree with their poses, by number
        self.held: dict[int, Scan] = {}
        # scans whose pose was not plausible in the end: the count "implausible" of the intake
        self.left_out = 0
        self._aliases_reported = False
        self._begin()

    def _begin(self) -> None:
        """Begin with nothing learnt and nothing seen."""
        settings = self.settings
        self.background = CausalBackground(
            *self.recipe.smoothing, settings.span, settings.warm_up, self._rows
        )
        if self.earlier is not None:
            self.earlier.begin()
        self.alarms = AlarmBook(self.recipe.prescreen.radius)
        self.density = SeenDensity(self.recipe.prescreen, self.recipe.run_view.spacing)
        self.ground = self._running_ground()
        self.saw_lane = self.lane is None  # whether a scan could see some of a given lane
        self._begin_view()

    def _begin_view(self) -> None:
        """Begin with no ground seen."""
        self.first_pose: FloatArray | None = None
        self.history: list[CleanedImages] = []  # of scans that still see ground ahead
        # features of the latest alarms, from all of these scans
        self._sums: AlarmSums | None = None
        # sums of the run-view, with "row", counted from the lane's first
        self.view: Arrays = {}
        self.closed = -math.inf  # ground up to here (lane y) is final
        self.newest: tuple[int, FloatArray] | None = None
        self.previous_pose: FloatArray | None = None  # of the scan that was the newest before

    def _running_ground(self) -> RunningGround | None:
        """Return what compares the ground with that of training; None where the model cannot."""
        ground = self.model.ground
        if ground is None or not ground.judges:
            return None
        mapper = self.mapper
        if mapper is not None and not mapper.measures_clutter:
            mapper = None
        lane = self.lane
        columns = (-1.5, 1.5) if lane is None else (lane.x_min, lane.x_max)
        return RunningGround(ground, mapper, self.grid, columns, self.settings.least_step)

    @property
    def newest_number(self) -> int | None:
        """Number of the newest scan taken."""
        return None if self.newest is None else self.newest[0]

    @property
    def newest_pose(self) -> FloatArray | None:
        """Pose of the newest scan taken."""
        return None if self.newest is None else self.newest[1]

    def add(self, scan: Scan) -> LiveUpdate:
        """Judge a scan's pose, and take the scan in, hold it back or leave it out.

        Scans held back that it releases are taken in, too. The gate that judges poses stands in
        ``model/plausible.py``.

        Parameters
        ----------
        scan : Scan
            With a pose and without missing sweeps. Scans may come in any order.

        Returns
        -------
        LiveUpdate
            What the scan changed.

        Raises
        ------
        ValueError
            If the scan has no pose or its image cannot be used.
        """
        if scan.pose is None:
            raise ValueError(f"scan {scan.number} must have a pose, got none")
        twin = self.held.get(scan.number)
        if twin is not None and twin.pose is not None and np.array_equal(twin.pose, scan.pose):
            return LiveUpdate("duplicate", [])
        verdict = self.gate.judge(Sighting(scan.number, scan.time, scan.pose))
        for number in verdict.dropped:
            self.left_out += self.held.pop(number, None) is not None
        update = self._apply_verdict(scan, verdict)
        return replace(update, step=verdict.step, clock=verdict.clock)

    def _apply_verdict(self, scan: Scan, verdict: Verdict) -> LiveUpdate:
        """Take a scan in, hold it back or leave it out, as its pose was judged."""
        if verdict.anew:
            return self._start_anew(scan, verdict)
        if verdict.trusted:
            return self._take(scan)
        if verdict.held:
            self.held[scan.number] = scan
            return LiveUpdate("held", [])
        self.left_out += 1
        return LiveUpdate("implausible", [])

    def _start_anew(self, scan: Scan, verdict: Verdict) -> LiveUpdate:
        """Begin where positions agree now, with the scans held back.

        Alarms that were open are final. Where too few poses agreed before, everything learnt and
        seen before is forgotten.
        """
        alarms: list[LiveAlarm] = []
        if verdict.forgotten:
            self._begin()
            self.left_out += len(verdict.forgotten)
        else:
            alarms = self.finish()
            self._begin_view()

        released = []
        for number in verdict.trusted[:-1]:
            earlier = self.held.pop(number, None)
            if earlier is None:
                continue
            update = self._try(earlier)
            self.learn()
            released.append((earlier, update))
            alarms += update.alarms
        update = self._try(scan)
        return replace(
            update,
            alarms=last_states(alarms + update.alarms),
            anew=True,
            forgotten=bool(verdict.forgotten),
            released=released,
        )

    def _try(self, scan: Scan) -> LiveUpdate:
        """Take in one of several scans; a fault of one is reported and does not stop the others."""
        try:
            return self._take(scan)
        except ValueError as error:
            return LiveUpdate("refused", [], words=str(error))

    def _take(self, scan: Scan) -> LiveUpdate:
        """Take in a scan whose pose is trusted."""
        pose = floats(scan.pose)
        low, high = self._reach(pose)
        if high < self.closed:
            return LiveUpdate("late", [])
        if self.lane is not None and low <= self.lane.y_max and high >= self.lane.y_min:
            self.saw_lane = True
        if self.newest is not None:
            moved = np.hypot(*(pose[:2] - self.newest[1][:2]))
            if moved < self.settings.least_step:
                return LiveUpdate("still", [])
        image = self._image(scan)
        background = None
        if self.earlier is None or self.earlier.is_ready:
            gain, background = self.background.add(image)  # refuses an image that cannot be used
        if self.earlier is not None:
            self.earlier.learn(scan.signal[self._imaged], pose)
        if self.first_pose is None:
            self.first_pose = pose
            self._report_aliases(pose)
        if self.newest is None or scan.number > self.newest[0]:
            self.previous_pose = self.newest_pose
            self.newest = (scan.number, pose)
        newest_pose = self.newest[1]
        if background is None:
            return LiveUpdate("warm-up", [])
        cleaned = self.steps.clean(
            scan.number,
            pose,
            image,
            gain,
            background,
            needs_own_phase=self.mapper is not None,
        )
        history = sorted([*self.history, cleaned], key=lambda scan: scan.number)[-_MOST_SCANS:]
        earlier_sums = self._sums
        # No sums until this scan has entered them, which may fail.
        self._sums = None
        is_last = history[-1] is cleaned
        if not is_last or len(history) <= len(self.history):
            # A late scan belongs before others, and what a forgotten scan added cannot be
            # subtracted.
            earlier_sums = None
        self.history = history
        # After a gap between scans the ground far back is closed: the window of the run-view would
        # grow without bounds.
        left_behind: list[LiveAlarm] = []
        limit = self._reach(newest_pose)[0] - _FARTHEST_GAP
        if math.isfinite(self.closed) and limit > self.closed:
            left_behind = self._close_ground(limit)
        row, view = self._add_look(cleaned, newest_pose)
        changed = left_behind + self._raise(view, newest_pose, earlier_sums)
        ground = None
        if self.ground is not None and cleaned.own is not None:
            ground = self.ground.add(self.steps.labelled(cleaned), pose, background)
        values = np.asarray(view.values, np.float32)
        return LiveUpdate("taken", changed, row, values, ground=ground)

    def learn(self) -> None:
        """Do the work that the next scan needs and no alarm of this scan waits for.

        If it is not called, the next :meth:`add` does that work first.
        """
        self.background.learn()

    def finish(self) -> list[LiveAlarm]:
        """Close the run.

        No further scan comes, and the alarms that were open are returned as final.
        """
        return self.alarms.finish()

    def table(self) -> pd.DataFrame:
        """Return all alarms that stand, passed and open, the most confident first."""
        return self.alarms.table()

    def mean_of_looks(self, alarm: LiveAlarm) -> tuple[float, float]:
        """Return the weighted mean of the looks at an alarm, and the sum of their weights.

        The alarm's ground must not be final. The mean is NaN where no look has a weight.
        """
        pixel = pixels_at(self._view_grid(int(self.view["row"])), alarm.x, alarm.y)
        weight = float(self.view["weight"][pixel])
        if not weight:
            return math.nan, weight
        return float(self.view["sum"][pixel]) / weight, weight

    def expected_looks(self, alarm: LiveAlarm) -> list[tuple[float, float]]:
        """List the looks to come at an alarm: the distance driven until each, m, and its weight.

        The vehicle is taken to drive straight on in its median step so far. The list is empty where
        that step is not known or not forward.
        """
        if self.newest_pose is None or len(self.history) < 2:
            return []
        positions = np.array([[*scan.pose[:2], 0.0] for scan in self.history])
        step = float(np.median(np.diff(lane_to_scan(positions, self.newest_pose)[:, 1])))
        x, y = lane_to_scan([alarm.x, alarm.y, 0.0], self.newest_pose)[:2]
        left, right, near, _ = self.grid.extent()
        if step < self.settings.least_step or not left <= x <= right:
            return []
        ahead = np.arange(y - step, near, -step)
        ahead = ahead[ahead <= self.recipe.run_view.y_max]
        weights = look_weight(np.hypot(x, ahead), self.recipe.run_view.falloff)
        return list(zip((y - ahead).tolist(), weights.tolist(), strict=True))

    def _report_aliases(self, pose: FloatArray) -> None:
        """Warn once of echoes that the steps of the tones repeat in the image.

        This needs the antennas' height, which the first pose gives.
        """
        if self._aliases_reported:
            return
        self._aliases_reported = True
        radar = self.description
        tx = vehicle_to_scan(radar.tx_position, pose)
        rx = vehicle_to_scan(radar.rx_position, pose)
        for fault in alias_faults(self.recipe, radar.frequency, tx, rx):
            if fault:
                warnings.warn(fault, stacklevel=3)

    def view_grid(self) -> ViewGrid | None:
        """Return the lattice of the run-view; None before a pose came.

        ``x`` and ``y`` are the centre of its first pixel, ``dx`` and ``dy`` the spacings, m, and
        ``nx`` the columns.
        """
        if self.first_pose is None:
            return None
        grid = self._view_grid()
        return {"x": grid.x_min, "y": grid.y_min, "nx": grid.nx, "dx": grid.dx, "dy": grid.dy}

    def _view_grid(self, first: int = 0, rows: int = 1) -> Grid:
        """Return the lattice of rows of the run-view, counted from the lane's first."""
        table = self.recipe.run_view
        across = Grid.spanning(table.x, (0.0, table.spacing), table.spacing)
        begin = table.y[0] if table.y else self._ground.y_min
        y = begin + first * table.spacing
        return Grid(across.x_min, y, across.nx, rows, table.spacing, table.spacing)

    @property
    def _ground(self) -> Lane:
        """The lane that is searched; without a given one it has no end."""
        if self.lane is not None:
            return self.lane
        if self.first_pose is None:
            raise ValueError("lane needs a pose, got none")
        return course_lane(self.recipe, self.first_pose[None], WITHOUT_END)

    def _image(self, scan: Scan) -> ComplexArray:
        """Image a scan; the operator is used again while height and attitude stay the same.

        What earlier drives predict is subtracted.
        """
        pose = floats(scan.pose)
        key = tuple(pose[[2, 4, 5]])
        if self._operator is None or self._operator[0] != key:
            imager = self._imager
            subbands = {name: imager.subbands[name] for name in self._subbands}
            operator = imager.operator_at(pose, self._pixels, subbands, imager.window)
            self._operator = (key, operator)
        data = scan.signal[self._imaged]
        if self.earlier is not None:
            data = self.earlier.clean(data)
        image = np.asarray(self._operator[1].adjoint(data), np.complex64)
        return image if self.earlier is None else self.earlier.of_image(image, pose)

    def _reach(self, pose: FloatArray) -> tuple[float, float]:
        """Return the first and the last lane y that a scan can see."""
        return seen_along(self.grid, pose, self.recipe.run_view.y_max)

    def _passed(self, pose: FloatArray) -> float:
        """Return the lane y up to which ground is passed by the newest scan and the one before it.

        One scan is not enough: a pose too far ahead by less than the gate can detect would close
        ground unseen.
        """
        passed = self._reach(pose)[0]
        if self.previous_pose is not None:
            passed = min(passed, self._reach(self.previous_pose)[0])
        return passed

    def _add_look(self, scan: CleanedImages, pose: FloatArray) -> tuple[int, xr.DataArray]:
        """Add a scan to the run-view; return the view and its first row.

        The view holds the ground that is not final, and a margin of the final ground before it.
        """
        first, rows = self._window(pose)
        grid = self._view_grid(first, rows)
        sums = self.steps.view_sums(grid)
        if self.view:
            sums.merge(self.view | {"row": self.view["row"] - first})
        if self.mapper is not None:
            values = self.mapper.map(self.steps.labelled(scan))
        else:
            values = scan.magnitude[self.steps.channel(self.recipe.prescreen)]
        sums.add(values, self.grid, scan.pose)
        self.view = sums.state() | {"row": np.array(first)}
        return first, view_array(*sums.result(), grid, {})

    def _window(self, pose: FloatArray) -> tuple[int, int]:
        """Return the first row of the ground that scans still see, and the number of rows."""
        table = self.recipe.run_view
        origin = self._view_grid().y_min
        low, high = self._reach(pose)
        begin = self.closed if math.isfinite(self.closed) else low
        start = begin - self._margin()
        high = max(high, *(self._reach(scan.pose)[1] for scan in self.history))
        first = math.floor((start - origin) / table.spacing)
        last = math.ceil((high - origin) / table.spacing)
        if self.lane is not None or table.y is not None:
            end = table.y[1] if table.y else self._ground.y_max
            first = max(first, 0)
            last = min(last, round((end - origin) / table.spacing))
        return first, max(last - first + 1, 3)

    def _raise(
        self, view: xr.DataArray, pose: FloatArray, earlier_sums: AlarmSums | None
    ) -> list[LiveAlarm]:
        """Update the open alarms from the run-view, and close the ground that is passed."""
        maxima = self.steps.maxima(view)
        pixel = pixels_at(self._view_grid(int(self.view["row"])), maxima["x"], maxima["y"])
        seen = view["looks"].values[pixel] >= self.settings.looks
        is_open = (maxima["y"] > self.closed).to_numpy()
        maxima = maxima[seen & is_open].reset_index(drop=True)

        threshold = self.density.threshold(maxima, view, self.closed, self._ground)
        strong = maxima[maxima["magnitude"] >= threshold].reset_index(drop=True)
        rated = strong.assign(**self._confidence(strong, earlier_sums))
        rated = rated[~np.isnan(rated["confidence"].to_numpy())]
        changed = self.alarms.match(rated, pose)

        limit = self._passed(pose) - self.recipe.prescreen.radius
        if limit > self.closed:
            # Their maxima and their area enter the density rule for good.
            self.density.close(maxima, view, self.closed, limit, self._ground)
            final = self._close_ground(limit)
            final_ids = {alarm.alarm_id for alarm in final}
            changed = [alarm for alarm in changed if alarm.alarm_id not in final_ids] + final
        return changed

    def _confidence(self, alarms: pd.DataFrame, earlier_sums: AlarmSums | None) -> Entries:
        """Compute the confidence of alarms and the number of scans that entered it.

        Alarms at pixels where the scan before had alarms continue its sums and take in the newest
        scan alone.
        """
        grid = self._view_grid()
        row, column = pixels_at(grid, alarms["x"], alarms["y"])
        pixel = row * grid.nx + column
        order = np.argsort(pixel)
        # y from the row: the same to the last bit, whichever window of the run-view it came from.
        positions = pd.DataFrame({"x": alarms["x"], "y": grid.y_min + row * grid.dy})
        positions = positions.iloc[order].reset_index(drop=True)
        pixel = pixel[order]

        sums = AlarmSums(self.steps, positions, pixel)
        new = np.ones(len(pixel), bool)
        with _one_thread():
            if earlier_sums is not None:
                sums.merge(earlier_sums.state())
                new = ~np.isin(pixel, earlier_sums.rows)
            if new.any() and len(self.history) > 1:
                earlier = AlarmSums(self.steps, positions[new], pixel[new])
                earlier.add(*self.history[:-1])
                sums.merge(earlier.state())
            sums.add(self.history[-1])
        features = sums.table().iloc[np.argsort(order)].reset_index(drop=True)
        confidence = self.steps.confidence(features, alarms["magnitude"])
        self._sums = sums
        return {"confidence": confidence, "scans": features["scans"]}

    def _close_ground(self, limit: float) -> list[LiveAlarm]:
        """Make the ground up to lane y ``limit`` final, and drop scans that see none beyond it."""
        final = self.alarms.finish(limit)
        self.closed = limit
        begin = limit - self._margin()
        self.history = [scan for scan in self.history if self._reach(scan.pose)[1] >= begin]
        return final

    def _margin(self) -> float:
        """Return how far before open ground the view must reach for complete maxima, m."""
        return self.recipe.prescreen.radius + 2 * self.recipe.run_view.spacing


@contextmanager
def _one_thread() -> Iterator[None]:
    """Let kernels run in this thread alone.

    For a few alarms, waking others takes longer than the work.
    """
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        yield
    finally:
        numba.set_num_threads(before)
