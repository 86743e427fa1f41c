"""Detection scan by scan: a scan in, alarms out, nothing read from or written to anywhere.

The chain is that of Wang et al. 2007 with causal estimates: the background comes from the scans before, the run-view
from the scans that still see the ground ahead, and the density rule counts on the ground seen so far.
"""

from __future__ import annotations

import bisect
import math
import warnings
from array import array
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numba
import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.chain.fitting import alias_faults, check_channels
from flgpr.chain.gathering import AlarmFeatures, AlarmSums, CleanedScan, check_confidence, look_sums
from flgpr.chain.images import imager_of
from flgpr.chain.model import Detector, Model, as_model, unlearnt
from flgpr.chain.passes import Arrays
from flgpr.chain.recipe import RANKS, Recipe, course_lane
from flgpr.chain.stages import FeatureStage, MapStage, Setup, Stage, make_stage
from flgpr.clutter import CausalBackground
from flgpr.clutter.streaming import LEAST_SPAN, LEAST_WARM_UP
from flgpr.features import FEATURES, POLARIMETRIC
from flgpr.imaging import ImagingOperator
from flgpr.io import RunDescription, Scan, as_run
from flgpr.model import Grid, Lane, lane_to_scan, vehicle_to_scan
from flgpr.model.plausible import PoseGate, Sighting, Step, Verdict
from flgpr.screen import (
    counts,
    density_threshold,
    local_maxima,
    look_weight,
    seen_along,
    view_array,
)

FloatArray = NDArray[np.float64]
State = Literal["new", "update", "withdrawn", "final"]
_FARTHEST_GAP = (
    50.0  # m; ground farther back than this before a scan is closed without another look
)
_MOST_SCANS = 64
_SHOWN = ("x", "y", "confidence", "scans")  # an alarm in which one of these changed is told anew
_KEPT = (
    "x",
    "y",
    "confidence",
    "magnitude",
    "scans",
)  # of a passed alarm, after the number in its name
_NAME = "alarm-"
_WITHOUT_END = 1e9  # m


@dataclass(frozen=True)
class LiveSettings:
    """How the live chain trades time for certainty."""

    looks: int = 3  #: scans that must have seen a place before an alarm is raised there
    #: the first scan that is cleaned, counted from 1; those before it only teach the background. At least 3
    warm_up: int = 5
    span: int | None = None  #: scans that the background remembers; None remembers all
    #: a scan nearer than this to the last one taken is left out, m: a standing vehicle tells nothing new, and its scans
    #: would teach the background what stands before it
    least_step: float = 0.25

    def __post_init__(self) -> None:
        least = {"looks": 1, "warm_up": LEAST_WARM_UP, "span": LEAST_SPAN}
        for name, value in least.items():
            given = getattr(self, name)
            if given is not None and given < value:
                raise ValueError(f"{name} must be at least {value}, got {given}")
        if not self.least_step >= 0.05:
            raise ValueError(f"least_step must be at least 0.05 m, got {self.least_step}")


@dataclass(frozen=True)
class LiveAlarm:
    """An alarm as it stands after a scan, at ``x``, ``y`` in m of the lane frame; ``scans`` entered its confidence.

    "withdrawn" is no longer a maximum, or too weak for the density rule; "final" will not be seen again. ``first_left``
    is the distance along the heading from the array to the alarm when it was raised, m.
    """

    alarm_id: str
    x: float
    y: float
    confidence: float
    magnitude: float
    scans: int
    state: State
    first_left: float


@dataclass(frozen=True)
class LiveUpdate:
    """What a scan changed: it was "taken", "warm-up", "still" (not moved) or "late" (its ground is passed).

    A scan whose pose is not plausible, see ``PoseGate``, is "held" back or, when others
    tell against it, "implausible": left out. ``alarms`` are all that changed, those of ``released`` included. ``view``
    is the prescreener's run-view, (y, x), where it may have changed, from ``row`` of the lane on; NaN is unseen.
    """

    outcome: str
    alarms: list[LiveAlarm]
    row: int = 0
    view: NDArray[np.float32] | None = None
    step: Step | None = None  #: why the pose is not plausible
    clock: Step | None = None  #: why the time is not, which is no fault of the pose
    anew: bool = False  #: whether detection started anew, at the first of ``released``
    forgotten: bool = (
        False  #: whether all before was forgotten then: too few poses had agreed on it
    )
    #: scans that were held back and what became of them now, in their order
    released: list[tuple[Scan, LiveUpdate]] = field(default_factory=list)
    words: str = ""  #: why a scan that was held back before, or with others, is "refused"


class LiveDetector:
    """Raise alarms while scans come in; only the sub-bands that decide on alarms are imaged.

    Without a lane, here or in the recipe, it is 3 m about the first pose and as long as the vehicle drives; without a
    detector in the model the local contrast is the confidence. A recipe that cannot be run live is a ValueError.
    """

    def __init__(
        self,
        description: RunDescription,
        recipe: Recipe,
        lane: Lane | None = None,
        model: Model | Detector | None = None,
        settings: LiveSettings | None = None,
    ) -> None:
        self.description = description
        self.recipe = recipe
        self.model = as_model(model)
        self.settings = settings or LiveSettings()
        self.lane = lane or (recipe.lane.lane() if recipe.lane is not None else None)
        check_causal(recipe)
        check_channels(recipe, description.polarization, description.frequency)
        unlearnt(recipe, self.model)
        made = (
            _made(description, recipe, self.lane, self.model)
            if recipe.columns or recipe.map is not None
            else {}
        )
        self.mapper = next((one for one in made.values() if isinstance(one, MapStage)), None)
        self.reads = _reads(description, recipe, self.model, made)
        self.grid = self.reads.grid
        image, (median, _), (mean, _) = recipe.image, *recipe.smoothing[:2]
        reach = (
            self.grid.ny + median // 2 + mean // 2
        )  # rows that the background of those that count hangs on
        self._rows = min(reach, image.grid().ny)
        self._pixels = image.grid().points()
        self._taper = image.weights(description.frequency)
        labels = list(description.polarization)
        self._imaged = [labels.index(one) for one in image.polarizations or labels]
        self._operator: tuple[tuple[float, ...], ImagingOperator] | None = None
        self.gate = PoseGate(recipe.motion)
        self.held: dict[
            int, Scan
        ] = {}  # scans held back until others agree with their poses, by number
        self.left_out = 0  # scans whose pose was not plausible in the end
        self._aliases_told = False
        self._begin()

    def _begin(self) -> None:
        """Begin with nothing learnt and nothing seen."""
        settings = self.settings
        self.background = CausalBackground(
            *self.recipe.smoothing, settings.span, settings.warm_up, self._rows
        )
        self.first_pose: FloatArray | None = None
        self.history: list[CleanedScan] = []  # of scans that still see ground ahead
        self._sums: AlarmSums | None = (
            None  # features of the latest alarms, from all of these scans
        )
        # what the run-view has gathered, "row" counted from the lane's first
        self.view: Arrays = {}
        self.alarms: dict[str, LiveAlarm] = {}  # open: some scan may still see them
        # A day's drive passes 100,000 of them and more: bare numbers, so that memory and snapshots
        # stay small.
        self.passed = array(
            "d"
        )  # of final alarms the number in the name and ``_KEPT``, one after the other
        self.magnitudes = array("d")  # of all passed maxima that the density rule counts, ascending
        self.seen_area = 0.0  # passed, m²
        self.closed = -math.inf  # ground up to here (lane y) is final
        self.newest: tuple[int, FloatArray] | None = None
        self.before: FloatArray | None = None  # pose of the scan that was the newest before it
        self.named = 0

    @property
    def where(self) -> FloatArray | None:
        """Pose of the newest scan taken."""
        return None if self.newest is None else self.newest[1]

    def add(self, scan: Scan) -> LiveUpdate:
        """Take in a scan with a pose and without missing sweeps, in any order of scans; and those it lets go on."""
        if scan.pose is None:
            raise ValueError(f"scan {scan.number} must have a pose, got none")
        twin = self.held.get(scan.number)
        if twin is not None and twin.pose is not None and np.array_equal(twin.pose, scan.pose):
            return LiveUpdate("duplicate", [])
        verdict = self.gate.judge(Sighting(scan.number, scan.time, scan.pose))
        for number in verdict.dropped:
            self.left_out += self.held.pop(number, None) is not None
        return replace(self._settle(scan, verdict), step=verdict.step, clock=verdict.clock)

    def _settle(self, scan: Scan, verdict: Verdict) -> LiveUpdate:
        """Do with a scan what was judged of its pose."""
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
        """Begin where positions agree now, with the scans held back: alarms that were open are final.

        Where too few poses agreed before, nothing of that is kept at all.
        """
        alarms: list[LiveAlarm] = []
        if verdict.forgotten:
            self._begin()
            self.left_out += len(verdict.forgotten)
        else:
            alarms = self.finish()
            self.history = []
            self._sums = None
            self.view = {}
            self.first_pose = self.newest = self.before = None
            self.closed = -math.inf
        released = []
        for earlier in (self.held.pop(number, None) for number in verdict.trusted[:-1]):
            if earlier is not None:
                update = self._try(earlier)
                self.learn()
                released.append((earlier, update))
                alarms += update.alarms
        own = self._try(scan)
        forgotten = bool(verdict.forgotten)
        alarms = _last_states(alarms + own.alarms)
        return replace(own, alarms=alarms, anew=True, forgotten=forgotten, released=released)

    def _try(self, scan: Scan) -> LiveUpdate:
        """Take in one of several scans: what is wrong with it is told beside what became of the others."""
        try:
            return self._take(scan)
        except ValueError as error:
            return LiveUpdate("refused", [], words=str(error))

    def _take(self, scan: Scan) -> LiveUpdate:
        """Take in a scan whose pose is trusted."""
        pose = np.asarray(scan.pose, np.float64)
        ahead = self._reach(pose)
        if ahead[1] < self.closed:
            return LiveUpdate("late", [])
        if (
            self.newest is not None
            and np.hypot(*(pose[:2] - self.newest[1][:2])) < self.settings.least_step
        ):
            return LiveUpdate("still", [])
        image = self._image(scan)
        gain, background = self.background.add(image)  # refuses an image that cannot be used
        if self.first_pose is None:
            self.first_pose = pose
            self._tell_aliases(pose)
        if self.newest is None or scan.number > self.newest[0]:
            self.before = self.where
            self.newest = (scan.number, pose)
        where = self.newest[1]
        if background is None:
            return LiveUpdate("warm-up", [])
        cleaned = self.reads.clean(
            scan.number, pose, image, gain, background, own=self.mapper is not None
        )
        history = sorted([*self.history, cleaned], key=lambda one: one.number)[-_MOST_SCANS:]
        # until this scan is in them, which may fail
        before = self._sums
        self._sums = None
        if history[-1] is not cleaned or len(history) <= len(self.history):
            # a late scan belongs before others, and what a forgotten one gave cannot be taken away
            before = None
        self.history = history
        left_behind = self._jump(where)
        row, view = self._look(cleaned, where)
        return LiveUpdate(
            "taken",
            left_behind + self._raise(view, where, before),
            row,
            np.asarray(view.values, np.float32),
        )

    def learn(self) -> None:
        """Do what the next scan needs and no alarm of this one waits for; else the next :meth:`add` does it."""
        self.background.learn()

    def finish(self) -> list[LiveAlarm]:
        """Close the run: nothing will be seen any more, and what was open is final, which is returned."""
        return self._pass(list(self.alarms.values()))

    def table(self) -> pd.DataFrame:
        """All alarms that stand, passed and open, as an alarm table: the most mine-like first."""
        rows = self.passed + array(
            "d", [value for one in self.alarms.values() for value in _numbers(one)]
        )
        table = pd.DataFrame(np.reshape(rows, (-1, 1 + len(_KEPT))), columns=["alarm_id", *_KEPT])
        names = [f"{_NAME}{number:.0f}" for number in table["alarm_id"]]
        table = table.assign(alarm_id=names, scans=table["scans"].astype(int))
        return table.sort_values("confidence", ascending=False, kind="stable", ignore_index=True)

    def looked(self, alarm: LiveAlarm) -> tuple[float, float]:
        """Give the mean of the looks at an alarm's place, ground that is not final, and the sum of their weights."""
        grid = self._view_grid(int(self.view["row"]))
        table = self.recipe.run_view
        at = (
            round((alarm.y - grid.y_min) / table.spacing),
            round((alarm.x - grid.x_min) / table.spacing),
        )
        weight = float(self.view["weight"][at])
        return float(self.view["sum"][at]) / weight if weight else math.nan, weight

    def coming(self, alarm: LiveAlarm) -> list[tuple[float, float]]:
        """List the looks to come at an alarm: the way until each, m, and its weight.

        The vehicle is taken to drive straight on in its median step so far; none comes where that is not known, or not
        forward.
        """
        if self.where is None or len(self.history) < 2:
            return []
        places = np.array([[*one.pose[:2], 0.0] for one in self.history])
        step = float(np.median(np.diff(lane_to_scan(places, self.where)[:, 1])))
        x, y = lane_to_scan([alarm.x, alarm.y, 0.0], self.where)[:2]
        left, right, near, _ = self.grid.extent()
        if step < self.settings.least_step or not left <= x <= right:
            return []
        ahead = np.arange(y - step, near, -step)
        ahead = ahead[ahead <= self.recipe.run_view.y_max]
        weights = look_weight(np.hypot(x, ahead), self.recipe.run_view.falloff)
        return list(zip((y - ahead).tolist(), weights.tolist(), strict=True))

    def _tell_aliases(self, pose: FloatArray) -> None:
        """Warn once, when the antennas' height is known, of echoes that the steps of the tones repeat in the image."""
        if self._aliases_told:
            return
        self._aliases_told = True
        radar = self.description
        tx = vehicle_to_scan(radar.tx_position, pose)
        rx = vehicle_to_scan(radar.rx_position, pose)
        for doubt in filter(None, alias_faults(self.recipe, radar.frequency, tx, rx)):
            warnings.warn(doubt, stacklevel=3)

    def view_grid(self) -> dict[str, float] | None:
        """Lattice of the run-view: ``x``, ``y`` of its first pixel, ``nx``, ``dx``, ``dy``; None before a pose came."""
        if self.first_pose is None:
            return None
        grid = self._view_grid()
        return {"x": grid.x_min, "y": grid.y_min, "nx": grid.nx, "dx": grid.dx, "dy": grid.dy}

    def _view_grid(self, first: int = 0, rows: int = 1) -> Grid:
        """Lattice of rows of the run-view, counted from the lane's first."""
        table = self.recipe.run_view
        across = Grid.spanning(table.x, (0.0, table.spacing), table.spacing)
        y = (table.y[0] if table.y else self._ground.y_min) + first * table.spacing
        return Grid(across.x_min, y, across.nx, rows, table.spacing, table.spacing)

    @property
    def _ground(self) -> Lane:
        """The lane; without one it goes on with the vehicle."""
        if self.lane is not None:
            return self.lane
        if self.first_pose is None:
            raise ValueError("lane needs a pose, got none")
        return course_lane(self.recipe, self.first_pose[None], _WITHOUT_END)

    def _image(self, scan: Scan) -> NDArray[np.complex64]:
        """Image a scan; while height and attitude stay the same, so does the operator."""
        pose = np.asarray(scan.pose, np.float64)
        one = self.description
        table = self.recipe.image
        key = tuple(pose[[2, 4, 5]])
        if self._operator is None or self._operator[0] != key:
            tx = vehicle_to_scan(one.tx_position, pose)
            rx = vehicle_to_scan(one.rx_position, pose)
            bands = [table.subbands[name] for name in self.reads.subbands]
            operator = ImagingOperator(
                one.frequency,
                tx,
                rx,
                self._pixels,
                bands,
                table.tolerance,
                window=self._taper,
                device=table.device,
            )
            self._operator = key, operator
        return np.asarray(self._operator[1].adjoint(scan.signal[self._imaged]), np.complex64)

    def _reach(self, pose: FloatArray) -> tuple[float, float]:
        """First and last lane y that a scan can see."""
        return seen_along(self.grid, pose, self.recipe.run_view.y_max)

    def _passed(self, pose: FloatArray) -> float:
        """Lane y up to which ground is passed by the newest scan and the one before it.

        By one alone it is not: a pose that is too far ahead by less than tells it wrong would close ground unseen.
        """
        known = [pose] if self.before is None else [pose, self.before]
        return min(self._reach(one)[0] for one in known)

    def _look(self, scan: CleanedScan, pose: FloatArray) -> tuple[int, xr.DataArray]:
        """Take a scan into the run-view of the ground that is not final, and a margin of the final ground before it."""
        first, rows = self._window(pose)
        grid = self._view_grid(first, rows)
        sums = look_sums(self.recipe.run_view, grid)
        if self.view:
            sums.merge(self.view | {"row": self.view["row"] - first})
        if self.mapper is not None:
            values = self.mapper.map(self.reads.labelled(scan))
        else:
            values = scan.magnitude[self.reads.channel(self.recipe.prescreen)]
        sums.add(values, self.grid, scan.pose)
        self.view = sums.state() | {"row": np.array(first)}
        return first, view_array(*sums.result(), grid, {})

    def _window(self, pose: FloatArray) -> tuple[int, int]:
        """First row of the ground that is looked at, and how many."""
        y = self._view_grid().y_min
        spacing = self.recipe.run_view.spacing
        low, high = self._reach(pose)
        start = (self.closed if math.isfinite(self.closed) else low) - self._margin()
        high = max(high, *(self._reach(one.pose)[1] for one in self.history))
        first = math.floor((start - y) / spacing)
        last = math.ceil((high - y) / spacing)
        if self.lane is not None or self.recipe.run_view.y is not None:
            end = self.recipe.run_view.y[1] if self.recipe.run_view.y else self._ground.y_max
            first = max(first, 0)
            last = min(last, round((end - y) / spacing))
        return first, max(last - first + 1, 3)

    def _raise(
        self, view: xr.DataArray, pose: FloatArray, before: AlarmSums | None
    ) -> list[LiveAlarm]:
        """Bring the open alarms up to date with the run-view, and close the ground that is passed."""
        found = local_maxima(view, self.recipe.prescreen.radius)
        column = np.rint(
            (found["x"] - view["x"].values[0]) / self.recipe.run_view.spacing
        ).to_numpy(int)
        row = np.rint((found["y"] - view["y"].values[0]) / self.recipe.run_view.spacing).to_numpy(
            int
        )
        seen = view["looks"].values[row, column] >= self.settings.looks
        found = found[seen & (found["y"] > self.closed).to_numpy()].reset_index(drop=True)
        strong = found[found["magnitude"] >= self._threshold(found, view)].reset_index(drop=True)
        known = strong.assign(**self._confidence(strong, before))
        changed = self._match(known[~np.isnan(known["confidence"].to_numpy())], pose)
        limit = self._passed(pose) - self.recipe.prescreen.radius
        if limit > self.closed:
            final = self._close(found, view, limit)
            names = {one.alarm_id for one in final}
            changed = [one for one in changed if one.alarm_id not in names] + final
        return changed

    def _threshold(self, found: pd.DataFrame, view: xr.DataArray) -> float:
        """Magnitude that the density rule asks for, on the ground seen so far (Wang et al. 2007, Sec. II-B)."""
        screen = self.recipe.prescreen
        magnitudes = np.append(
            np.frombuffer(self.magnitudes),
            found["magnitude"].to_numpy()[self._counts(found["x"], found["y"])],
        )
        area = self.seen_area + self._area(view, self.closed, math.inf)
        return density_threshold(magnitudes, area, screen.radius, screen.density)

    def _counts(self, x: Any, y: Any) -> NDArray[np.bool_]:
        return counts(x, y, self._ground, self.recipe.prescreen.count)

    def _area(self, view: xr.DataArray, low: float, high: float) -> float:
        """Area between two lane y that was seen and that the density rule counts, m²."""
        x, y = np.meshgrid(view["x"].values, view["y"].values)
        counted = np.isfinite(view.values) & (y > low) & (y <= high) & self._counts(x, y)
        return float(counted.sum()) * self.recipe.run_view.spacing**2

    def _confidence(self, alarms: pd.DataFrame, before: AlarmSums | None) -> dict[str, Any]:
        """Confidence of alarms and the number of scans that entered it.

        Alarms at pixels where there were some after the scan before take in the newest scan alone.
        """
        grid = self._view_grid()
        row, column = (
            np.rint((alarms[n] - low) / grid.dy)
            for n, low in (("y", grid.y_min), ("x", grid.x_min))
        )
        pixel = (row * grid.nx + column).to_numpy(np.int64)
        order = np.argsort(pixel)
        # The same place to the last bit, whichever window of the run-view it was found in.
        places = (
            pd.DataFrame({"x": alarms["x"], "y": grid.y_min + row * grid.dy})
            .iloc[order]
            .reset_index(drop=True)
        )
        pixel = pixel[order]
        sums = AlarmSums(self.reads, places, pixel)
        new = np.ones(len(pixel), bool)
        with _one_thread():
            if before is not None:
                sums.merge(before.state())
                new = ~np.isin(pixel, before.rows)
            if new.any() and len(self.history) > 1:
                earlier = AlarmSums(self.reads, places[new], pixel[new])
                earlier.add(*self.history[:-1])
                sums.merge(earlier.state())
            sums.add(self.history[-1])
        features = sums.table().iloc[np.argsort(order)].reset_index(drop=True)
        confidence = self.reads.confidence(features, alarms["magnitude"], self.model.detector)
        self._sums = sums
        return {"confidence": confidence, "scans": features["scans"]}

    def _match(self, found: pd.DataFrame, pose: FloatArray) -> list[LiveAlarm]:
        """Give every maximum the name of the open alarm next to it, the strongest first, or a new one."""
        free = dict(self.alarms)
        changed = []
        names = ["x", "y", "confidence", "magnitude", "scans"]
        for x, y, confidence, magnitude, scans in found[names].itertuples(index=False):
            near = min(
                free.values(), key=lambda one: math.hypot(one.x - x, one.y - y), default=None
            )
            if (
                near is not None
                and math.hypot(near.x - x, near.y - y) <= self.recipe.prescreen.radius
            ):
                del free[near.alarm_id]
                name = near.alarm_id
                state = "update"
                left = near.first_left
            else:
                left = float(lane_to_scan([x, y, 0.0], pose)[1])
                self.named += 1
                name = f"{_NAME}{self.named}"
                state = "new"
            one = LiveAlarm(
                name,
                float(x),
                float(y),
                float(confidence),
                float(magnitude),
                int(scans),
                state,  # type: ignore[arg-type]
                left,
            )
            if state == "new" or any(
                getattr(one, n) != getattr(self.alarms[name], n) for n in _SHOWN
            ):
                changed.append(one)
            self.alarms[name] = one
        for gone in free:
            changed.append(replace(self.alarms.pop(gone), state="withdrawn"))
        return changed

    def _jump(self, pose: FloatArray) -> list[LiveAlarm]:
        """Close what lies so far back that the window would grow without bounds, after a gap between scans."""
        limit = self._reach(pose)[0] - _FARTHEST_GAP
        return self._finals(limit) if math.isfinite(self.closed) and limit > self.closed else []

    def _finals(self, limit: float) -> list[LiveAlarm]:
        final = self._pass([one for one in self.alarms.values() if one.y <= limit])
        self.closed = limit
        self.history = [
            one for one in self.history if self._reach(one.pose)[1] >= limit - self._margin()
        ]
        return final

    def _pass(self, alarms: list[LiveAlarm]) -> list[LiveAlarm]:
        for one in alarms:
            del self.alarms[one.alarm_id]
            self.passed.extend(_numbers(one))
        return [replace(one, state="final") for one in alarms]

    def _close(self, found: pd.DataFrame, view: xr.DataArray, limit: float) -> list[LiveAlarm]:
        """Make the ground up to ``limit`` final."""
        counted = found[self._counts(found["x"], found["y"]) & (found["y"] <= limit).to_numpy()]
        for magnitude in counted["magnitude"]:
            bisect.insort(self.magnitudes, float(magnitude))
        self.seen_area += self._area(view, self.closed, limit)
        return self._finals(limit)

    def _margin(self) -> float:
        return self.recipe.prescreen.radius + 2 * self.recipe.run_view.spacing


def _last_states(alarms: list[LiveAlarm]) -> list[LiveAlarm]:
    """Tell of what several scans made of alarms the last alone: one that is new stays new, or was never told."""
    last = {one.alarm_id: one for one in alarms}
    new = {one.alarm_id for one in alarms if one.state == "new"}
    changed = []
    for name, one in last.items():
        if name in new and one.state == "update":
            changed.append(replace(one, state="new"))
        elif name not in new or one.state != "withdrawn":
            changed.append(one)
    return changed


def _numbers(alarm: LiveAlarm) -> list[float]:
    return [
        float(alarm.alarm_id.removeprefix(_NAME)),
        *(float(getattr(alarm, name)) for name in _KEPT),
    ]


@contextmanager
def _one_thread() -> Iterator[None]:
    """Let kernels run in this thread alone: for a few alarms, waking others takes longer than the work."""
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        yield
    finally:
        numba.set_num_threads(before)


def _reads(
    description: RunDescription, recipe: Recipe, model: Model, made: Mapping[str, Stage]
) -> AlarmFeatures:
    """Take of a recipe's features what decides on alarms: what the model's detector reads, without one the contrast."""
    single = () if recipe.confidence in RANKS else (recipe.confidence,)
    names = model.detector.features if model.detector is not None else single
    features = (
        recipe.features.model_copy(update={"variants": False})
        if recipe.features and names
        else None
    )
    stages = {
        name: one
        for name, one in made.items()
        if isinstance(one, FeatureStage) and set(one.columns) & set(names)
    }
    needed = {recipe.prescreen.subband}
    known = {"magnitude"}.union(*(one.columns for one in stages.values()))
    if features is None:
        needed.add(recipe.contrast.subband)
        known.add("contrast")
    bands = {
        f"{one}_{band}": band
        for band in recipe.image.subbands
        for one in FEATURES
        if features is not None
    }
    for name in names:
        if name not in known and name not in bands:
            raise ValueError(
                f"model must read features of the recipe's sub-bands when live, got {name}"
            )
        needed |= {bands[name]} if name in bands else set()
    every = bool(stages) or recipe.map is not None  # stages see all of an image
    subbands = [band for band in recipe.image.subbands if every or band in needed]
    labels = list(recipe.image.polarizations) or description.polarization
    polarimetric = tuple(
        band for band in subbands if any(f"{one}_{band}" in names for one in POLARIMETRIC)
    )
    reduced = recipe.model_copy(update={"features": features})
    return AlarmFeatures(reduced, labels, subbands, recipe.near_grid(), stages, polarimetric)


def _made(
    description: RunDescription, recipe: Recipe, lane: Lane | None, model: Model
) -> dict[str, Stage]:
    """Make the stages; the run that they are told of has one scan without an echo, at the lane's origin."""
    run = as_run(
        description, Scan(0, math.nan, np.zeros(6), np.zeros(description.shape, np.complex64))
    )
    table = recipe.image
    pose = np.zeros((1, 6))
    where = lane or course_lane(recipe, pose, _WITHOUT_END)
    imaged = [
        description.polarization.index(one)
        for one in table.polarizations or description.polarization
    ]
    setup = Setup(
        run,
        {},
        where,
        imager_of(run, table),
        recipe.near_grid(),
        recipe.run_view.grid(where),
        imaged,
        1,
        {},
    )
    made = {
        name: make_stage(name, one, setup, model.stages.get(name))
        for name, one in recipe.named().items()
    }
    check_confidence(
        recipe,
        (
            column
            for one in made.values()
            if isinstance(one, FeatureStage)
            for column in one.columns
        ),
    )
    return made


def check_causal(recipe: Recipe) -> None:
    """Refuse a recipe that needs more than the scans so far; say why."""
    if recipe.waits():
        raise ValueError(f"recipe {recipe.name!r} cannot run live: {'; '.join(recipe.waits())}")
