"""Detection scan by scan: a scan in, alarms out, nothing read from or written to anywhere.

The chain is that of Wang et al. 2007 with causal estimates: the background comes from the scans so far, the run-view
from the scans that still see the ground ahead, and the density rule counts on the ground seen so far.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Literal

import numba
import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.chain.classifier import Classifier
from flgpr.chain.fitting import check_channels
from flgpr.chain.recipe import FeaturesTable, Recipe
from flgpr.clutter import CausalBackground
from flgpr.features import FEATURES, ContrastSums, FeatureSettings, FeatureSums
from flgpr.imaging import ScanImager
from flgpr.io import RunDescription, Scan, as_run
from flgpr.model import Grid, Lane, lane_to_scan, scan_to_lane
from flgpr.screen import RunViewSums, local_maxima, view_array

FloatArray = NDArray[np.float64]
State = Literal["new", "update", "withdrawn", "final"]
_FARTHEST_GAP = 50.0  # m; ground farther back than this before a scan is closed without another look
_MOST_SCANS = 64


@dataclass(frozen=True)
class LiveSettings:
    """How the live chain trades time for certainty."""

    looks: int = 3  #: scans that must have seen a place before an alarm is raised there
    #: the first scan that is cleaned, counted from 1; those before it only teach the background. At least 2
    warm_up: int = 5
    span: int | None = None  #: scans that the background remembers; None remembers all
    #: a scan nearer than this to the last one taken is left out, m: a standing vehicle tells nothing new, and its scans
    #: would teach the background what stands before it
    least_step: float = 0.25

    def __post_init__(self) -> None:
        if self.looks < 1:
            raise ValueError(f"looks must be at least 1, got {self.looks}")
        if not self.least_step >= 0.05:
            raise ValueError(f"least_step must be at least 0.05 m, got {self.least_step}")


@dataclass(frozen=True)
class LiveAlarm:
    """An alarm as it stands after a scan, at ``x``, ``y`` in m of the lane frame.

    ``scans`` entered its confidence. "withdrawn" is what is no longer a maximum, or too weak for the density rule, and
    "final" what no scan will see again. ``first_left`` is the distance along the heading from the array to the alarm
    when it was raised, m.
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
    """What a scan changed.

    ``outcome`` is "taken", "warm-up", "still" (the vehicle has not moved) or "late" (its ground is passed). ``view`` is
    the run-view of the prescreener's channel, (y, x), where it may have changed, from ``row`` of the lane on; NaN is
    unseen.
    """

    outcome: str
    alarms: list[LiveAlarm]
    row: int = 0
    view: NDArray[np.float32] | None = None


@dataclass(frozen=True)
class CleanedScan:
    """A cleaned scan that still sees ground ahead.

    Magnitudes and images are (polarization, subband, y, x). In ``coherent`` all polarizations share one gain; it is
    None where no feature needs it.
    """

    number: int
    pose: FloatArray
    magnitude: NDArray[np.float32]
    coherent: NDArray[np.complex64] | None


class LiveDetector:
    """Raise alarms while scans come in.

    Only the sub-bands that decide on alarms are imaged. Without a lane, here or in the recipe, it is 3 m about the
    first pose and as long as the vehicle drives; without a classifier the local contrast is the confidence. A recipe
    that cannot be run live is a ValueError.
    """

    def __init__(
        self,
        description: RunDescription,
        recipe: Recipe,
        lane: Lane | None = None,
        classifier: Classifier | None = None,
        settings: LiveSettings | None = None,
    ) -> None:
        self.description, self.recipe, self.classifier = description, recipe, classifier
        self.settings = settings or LiveSettings()
        self.lane = lane or (recipe.lane.lane() if recipe.lane is not None else None)
        self.origin: tuple[float, float] | None = None  # x of the middle, y of the first row
        self.subbands = _needed_subbands(recipe, classifier)
        _check(description, recipe)
        table = recipe.image
        self._whole = table.grid()
        reach = recipe.run_view.y_max + recipe.contrast.size * recipe.contrast.spacing / 2 + table.steps[1]
        rows = min(self._whole.ny, math.ceil((reach - self._whole.y_min) / self._whole.dy) + 1)
        self.grid = Grid(self._whole.x_min, self._whole.y_min, self._whole.nx, rows, self._whole.dx, self._whole.dy)
        median, mean = recipe.background.windows(*table.steps)
        self.background = CausalBackground(
            median, mean, recipe.background.median_step, self.settings.span, self.settings.warm_up
        )
        self.history: list[CleanedScan] = []
        self.alarms: dict[str, LiveAlarm] = {}  # open: some scan may still see them
        self.passed: list[LiveAlarm] = []
        self.magnitudes: list[float] = []  # of all passed maxima that the density rule counts, ascending
        self.seen_area = 0.0  # passed, m²
        self.closed = -math.inf  # ground up to here (lane y) is final
        self.newest: tuple[int, FloatArray] | None = None
        self.named = 0

    @property
    def where(self) -> FloatArray | None:
        """Pose of the newest scan taken."""
        return None if self.newest is None else self.newest[1]

    def add(self, scan: Scan) -> LiveUpdate:
        """Take in a scan with a pose and without missing sweeps, in any order of scans."""
        if scan.pose is None:
            raise ValueError(f"scan {scan.number} must have a pose, got none")
        pose = scan.pose
        if self.origin is None:
            near = self.lane.y_min if self.lane is not None else float(pose[1]) + self.recipe.image.y[0]
            self.origin = float(pose[0]), self.recipe.run_view.y[0] if self.recipe.run_view.y else near
        ahead = self._reach(pose)
        if ahead[1] < self.closed:
            return LiveUpdate("late", [])
        if self.newest is not None and np.hypot(*(pose[:2] - self.newest[1][:2])) < self.settings.least_step:
            return LiveUpdate("still", [])
        if self.newest is None or scan.number > self.newest[0]:
            self.newest = scan.number, pose
        image = self._image(scan)
        gain, background = self.background.add(image)
        if background is None:
            return LiveUpdate("warm-up", [])
        rows = self.grid.ny
        near_image = np.ascontiguousarray(image[..., :rows, :])
        own = background.cropped(rows)
        coherent = own.coherent(near_image, gain) if self.classifier is not None else None
        self._keep(CleanedScan(scan.number, pose, own.magnitude(near_image, gain), coherent))
        left_behind = self._jump()
        row, view = self._window()
        return LiveUpdate("taken", left_behind + self._raise(view), row, np.asarray(view.values, np.float32))

    def finish(self) -> list[LiveAlarm]:
        """Close the run: nothing will be seen any more, and what was open is final, which is returned."""
        closed = [replace(alarm, state="final") for alarm in self.alarms.values()]
        self.passed += closed
        self.alarms.clear()
        return closed

    def table(self) -> pd.DataFrame:
        """All alarms that stand, passed and open, as an alarm table: the most mine-like first."""
        rows = [*self.passed, *self.alarms.values()]
        columns = ["alarm_id", "x", "y", "confidence", "magnitude", "scans"]
        table = pd.DataFrame([[getattr(row, name) for name in columns] for row in rows], columns=columns)
        return table.sort_values("confidence", ascending=False, kind="stable", ignore_index=True)

    def view_grid(self) -> dict[str, float] | None:
        """Lattice of the run-view: ``x``, ``y`` of its first pixel, ``nx``, ``dx``, ``dy``; None before a pose came."""
        if self.origin is None:
            return None
        across = self._across()
        return {"x": across.x_min, "y": self.origin[1], "nx": across.nx, "dx": across.dx, "dy": across.dy}

    def _image(self, scan: Scan) -> NDArray[np.complex64]:
        table = self.recipe.image
        bands = {name: table.subbands[name] for name in self.subbands}
        imager = ScanImager(as_run(self.description, scan), self._whole, bands, table.window, table.tolerance)
        return np.asarray(imager.image(0).values)

    def _reach(self, pose: FloatArray) -> tuple[float, float]:
        """First and last lane y that a scan can see."""
        x_min, x_max, y_min, y_max = self.grid.extent()
        corners = np.zeros((4, 3))
        corners[:, :2] = [(x, y) for x in (x_min, x_max) for y in (y_min, min(y_max, self.recipe.run_view.y_max))]
        along = scan_to_lane(corners, pose)[:, 1]
        return float(along.min()), float(along.max())

    def _keep(self, one: CleanedScan) -> None:
        self.history = sorted([*self.history, one], key=lambda scan: scan.number)[-_MOST_SCANS:]

    def _across(self) -> Grid:
        x, spacing = self.recipe.run_view.x, self.recipe.run_view.spacing
        return Grid.spanning(x, (0.0, spacing), spacing)

    def _window(self) -> tuple[int, xr.DataArray]:
        """Run-view of the ground that is not final, and a margin of the final ground before it."""
        if self.origin is None or self.newest is None:
            raise ValueError("window needs a scan, got none")
        across, spacing = self._across(), self.recipe.run_view.spacing
        low, high = self._reach(self.newest[1])
        high = max(high, *(self._reach(one.pose)[1] for one in self.history))
        start = (self.closed if math.isfinite(self.closed) else low) - self._margin()
        first = math.floor((start - self.origin[1]) / spacing)
        last = math.ceil((high - self.origin[1]) / spacing)
        if self.lane is not None or self.recipe.run_view.y is not None:
            end = self.recipe.run_view.y[1] if self.recipe.run_view.y else self.lane.y_max if self.lane else math.inf
            first, last = max(first, 0), min(last, round((end - self.origin[1]) / spacing))
        rows = max(last - first + 1, 3)
        grid = Grid(across.x_min, self.origin[1] + first * spacing, across.nx, rows, spacing, spacing)
        sums = RunViewSums(grid, self.recipe.run_view.y_max)
        p, s = self._channel(self.recipe.prescreen.polarization, self.recipe.prescreen.subband)
        for one in self.history:
            sums.add(one.magnitude[p, s], self.grid, one.pose)
        return first, view_array(*sums.result(), grid, {})

    def _channel(self, polarization: str, subband: str) -> tuple[int, int]:
        return self.description.polarization.index(polarization), self.subbands.index(subband)

    def _raise(self, view: xr.DataArray) -> list[LiveAlarm]:
        """Bring the open alarms up to date with the run-view, and close the ground that is passed."""
        if self.newest is None:
            raise ValueError("alarms need a scan, got none")
        pose = self.newest[1]
        found = local_maxima(view, self.recipe.prescreen.radius)
        found = found[found["y"] > self.closed]
        column = np.rint((found["x"] - view["x"].values[0]) / self.recipe.run_view.spacing).astype(int)
        row = np.rint((found["y"] - view["y"].values[0]) / self.recipe.run_view.spacing).astype(int)
        found = found[view["looks"].values[row, column] >= self.settings.looks].reset_index(drop=True)
        strong = found[found["magnitude"] >= self._threshold(found, view)]
        confidence = self._confidence(strong)
        known = strong.assign(confidence=confidence["confidence"], scans=confidence["scans"])
        changed = self._match(known[known["confidence"].notna()], pose)
        limit = self._reach(pose)[0] - self.recipe.prescreen.radius
        if limit > self.closed:
            final = self._close(found, view, limit)
            names = {one.alarm_id for one in final}
            changed = [one for one in changed if one.alarm_id not in names] + final
        return changed

    def _threshold(self, found: pd.DataFrame, view: xr.DataArray) -> float:
        """Magnitude that the density rule asks for, on the ground seen so far (Wang et al. 2007, Sec. II-B)."""
        screen = self.recipe.prescreen
        here = found[self._counts(found)]["magnitude"].to_numpy()
        area = self.seen_area + self._area(view, self.closed, math.inf)
        keep = math.floor(screen.density * area / (math.pi * screen.radius**2))
        if keep == 0:
            return math.inf
        total = len(self.magnitudes) + here.size
        if total <= keep:
            return -math.inf
        return float(np.partition(np.append(self.magnitudes, here), total - keep)[total - keep])

    def _counts(self, found: pd.DataFrame) -> NDArray[np.bool_]:
        lane = self._lane()
        if self.recipe.prescreen.count == "view" or lane is None:
            return np.ones(len(found), np.bool_)
        return np.asarray(lane.contains(found["x"].to_numpy(), found["y"].to_numpy()), np.bool_)

    def _lane(self) -> Lane | None:
        if self.lane is not None or self.origin is None:
            return self.lane
        return Lane(self.origin[0] - 1.5, self.origin[0] + 1.5, self.origin[1], 1e9)

    def _area(self, view: xr.DataArray, low: float, high: float) -> float:
        """Area between two lane y that was seen and that the density rule counts, m²."""
        y, x, spacing = view["y"].values, view["x"].values, self.recipe.run_view.spacing
        counts = np.isfinite(view.values) & ((y > low) & (y <= high))[:, None]
        lane = self._lane()
        if self.recipe.prescreen.count == "lane" and lane is not None:
            counts &= lane.contains(*np.meshgrid(x, y))
        return float(counts.sum()) * spacing**2

    def _confidence(self, alarms: pd.DataFrame) -> pd.DataFrame:
        with _one_thread():
            return self._features(alarms)

    def _features(self, alarms: pd.DataFrame) -> pd.DataFrame:
        contrast = self.recipe.contrast
        if self.classifier is None:
            p, s = self._channel(contrast.polarization, contrast.subband)
            single = ContrastSums(alarms, self.grid, self.recipe.run_view.y_max, contrast.patch())
            for one in self.history:
                single.add(one.magnitude[p, s], one.pose)
            return single.table().rename(columns={"contrast": "confidence"})
        table = self.recipe.features or FeaturesTable()
        settings = FeatureSettings(contrast.patch(), table.inner, self.recipe.run_view.y_max, table.psi)
        sums = FeatureSums(alarms, self.description.polarization, self.subbands, self.grid, settings)
        for one in self.history:
            if one.coherent is not None:
                sums.add(one.magnitude, one.coherent, one.pose)
        features = sums.table()
        confidence = self.classifier.confidence(features)
        return pd.DataFrame({"confidence": confidence, "scans": features["scans"]}, index=alarms.index)

    def _match(self, found: pd.DataFrame, pose: FloatArray) -> list[LiveAlarm]:
        """Give every maximum the name of the open alarm next to it, the strongest first, or a new one."""
        free, changed = dict(self.alarms), []
        names = ["x", "y", "confidence", "magnitude", "scans"]
        for x, y, confidence, magnitude, scans in found[names].itertuples(index=False):
            near = min(free.values(), key=lambda one: math.hypot(one.x - x, one.y - y), default=None)
            if near is not None and math.hypot(near.x - x, near.y - y) <= self.recipe.prescreen.radius:
                del free[near.alarm_id]
                name, state, left = near.alarm_id, "update", near.first_left
            else:
                left = float(lane_to_scan([x, y, 0.0], pose)[1])
                self.named += 1
                name, state = f"alarm-{self.named}", "new"
            one = LiveAlarm(name, float(x), float(y), float(confidence), float(magnitude), int(scans), state, left)  # type: ignore[arg-type]
            if state == "new" or _differ(one, self.alarms[name]):
                changed.append(one)
            self.alarms[name] = one
        for gone in free:
            changed.append(replace(self.alarms.pop(gone), state="withdrawn"))
        return changed

    def _jump(self) -> list[LiveAlarm]:
        """Close what lies so far back that the window would grow without bounds, after a gap between scans."""
        if self.newest is None:
            return []
        limit = self._reach(self.newest[1])[0] - _FARTHEST_GAP
        return self._finals(limit) if math.isfinite(self.closed) and limit > self.closed else []

    def _finals(self, limit: float) -> list[LiveAlarm]:
        final = [replace(one, state="final") for one in self.alarms.values() if one.y <= limit]
        for one in final:
            del self.alarms[one.alarm_id]
        self.passed += final
        self.closed = limit
        self.history = [one for one in self.history if self._reach(one.pose)[1] >= limit - self._margin()]
        return final

    def _close(self, found: pd.DataFrame, view: xr.DataArray, limit: float) -> list[LiveAlarm]:
        """Make the ground up to ``limit`` final."""
        counted = found[self._counts(found) & (found["y"] <= limit).to_numpy()]
        for magnitude in counted["magnitude"]:
            bisect.insort(self.magnitudes, float(magnitude))
        self.seen_area += self._area(view, self.closed, limit)
        return self._finals(limit)

    def _margin(self) -> float:
        return self.recipe.prescreen.radius + 2 * self.recipe.run_view.spacing


@contextmanager
def _one_thread() -> Iterator[None]:
    """Let kernels run in this thread alone: for a few alarms, waking others takes longer than the work."""
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        yield
    finally:
        numba.set_num_threads(before)


def _needed_subbands(recipe: Recipe, classifier: Classifier | None) -> list[str]:
    """Sub-bands that decide on alarms, in the recipe's order."""
    needed = {recipe.prescreen.subband}
    if classifier is None:
        needed.add(recipe.contrast.subband)
    for name in classifier.features if classifier is not None else ():
        bands = [b for b in recipe.image.subbands for feature in FEATURES if name == f"{feature}_{b}"]
        if not bands:
            raise ValueError(f"model must read features of the recipe's sub-bands when live, got {name}")
        needed.update(bands)
    return [name for name in recipe.image.subbands if name in needed]


def check_causal(recipe: Recipe) -> None:
    """Refuse a recipe that needs more than the scans so far; say why."""
    if recipe.waits():
        raise ValueError(f"recipe {recipe.name!r} cannot run live: {'; '.join(recipe.waits())}")


def _check(description: RunDescription, recipe: Recipe) -> None:
    check_causal(recipe)
    check_channels(recipe, description.polarization, description.frequency)


def _differ(one: LiveAlarm, other: LiveAlarm) -> bool:
    return any(getattr(one, name) != getattr(other, name) for name in ("x", "y", "confidence", "scans"))
