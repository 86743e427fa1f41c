"""The alarms of a drive: those that a later scan may change, and those that are passed.

The density rule while scans come in: maxima and area of the ground seen so far.
"""

from __future__ import annotations

import bisect
import math
from array import array
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.live.updates import LiveAlarm, State
from flgpr.model import Lane, lane_to_scan
from flgpr.recipe.tables import PrescreenTable
from flgpr.screen import counts, density_threshold
from flgpr.types import BoolArray, FloatArray

# An alarm is reported again when one of these changed.
_REPORTED = ("x", "y", "confidence", "scans")
# What is stored of a passed alarm, after the number in its name.
_PASSED_COLUMNS = ("x", "y", "confidence", "magnitude", "scans")
_ALARM_PREFIX = "alarm-"


class AlarmBook:
    """Keeps every alarm of a drive under one name from its first scan to its last.

    Parameters
    ----------
    radius : float
        A maximum of the run-view is an alarm of the scan before if it lies as near to it, m.
    """

    def __init__(self, radius: float) -> None:
        self._radius = radius
        self.open: dict[str, LiveAlarm] = {}  # a later scan may see them
        # A day's drive passes 100,000 alarms and more: bare numbers keep memory and snapshots
        # small. Per final alarm: the number in its name, then _PASSED_COLUMNS.
        self.passed = array("d")
        self.count = 0  # alarms raised, from which they are named

    def match(self, maxima: pd.DataFrame, pose: FloatArray) -> list[LiveAlarm]:
        """Match every maximum, strongest first, to the open alarm next to it or a new one.

        Parameters
        ----------
        maxima : DataFrame
            Position, m, confidence, magnitude and number of scans of the maxima that are alarms
            now.
        pose : ndarray (6)
            Of the newest scan.

        Returns
        -------
        list of LiveAlarm
            What changed. An open alarm without a maximum is withdrawn.
        """
        unmatched = dict(self.open)
        changed = []
        rows = maxima[list(_PASSED_COLUMNS)].itertuples(index=False)
        for x, y, confidence, magnitude, scans in rows:
            known = self._nearest(unmatched, x, y)
            state: State
            if known is not None:
                del unmatched[known.alarm_id]
                alarm_id = known.alarm_id
                state = "update"
                first_left = known.first_left
            else:
                self.count += 1
                alarm_id = f"{_ALARM_PREFIX}{self.count}"
                state = "new"
                first_left = float(lane_to_scan([x, y, 0.0], pose)[1])
            alarm = LiveAlarm(
                alarm_id,
                float(x),
                float(y),
                float(confidence),
                float(magnitude),
                int(scans),
                state,
                first_left,
            )
            if known is None or any(
                getattr(alarm, name) != getattr(known, name) for name in _REPORTED
            ):
                changed.append(alarm)
            self.open[alarm_id] = alarm
        for alarm_id in unmatched:
            changed.append(replace(self.open.pop(alarm_id), state="withdrawn"))
        return changed

    def _nearest(self, alarms: Mapping[str, LiveAlarm], x: float, y: float) -> LiveAlarm | None:
        """Return the alarm nearest to a position; None where none lies within the radius."""

        def distance(alarm: LiveAlarm) -> float:
            return math.hypot(alarm.x - x, alarm.y - y)

        nearest = min(alarms.values(), key=distance, default=None)
        if nearest is None or distance(nearest) > self._radius:
            return None
        return nearest

    def finish(self, limit: float = math.inf) -> list[LiveAlarm]:
        """Pass the open alarms up to lane y ``limit``, m; return them as final."""
        final = []
        for alarm in list(self.open.values()):
            if alarm.y <= limit:
                del self.open[alarm.alarm_id]
                self.passed.extend(_alarm_numbers(alarm))
                final.append(replace(alarm, state="final"))
        return final

    def table(self) -> pd.DataFrame:
        """Return all alarms that stand, passed and open, the most confident first."""
        rows = array("d", self.passed)
        for alarm in self.open.values():
            rows.extend(_alarm_numbers(alarm))
        columns = ["alarm_id", *_PASSED_COLUMNS]
        table = pd.DataFrame(np.reshape(rows, (-1, len(columns))), columns=columns)
        names = [f"{_ALARM_PREFIX}{number:.0f}" for number in table["alarm_id"]]
        table = table.assign(alarm_id=names, scans=table["scans"].astype(int))
        return table.sort_values("confidence", ascending=False, kind="stable", ignore_index=True)


def _alarm_numbers(alarm: LiveAlarm) -> list[float]:
    """Return an alarm as bare numbers: the one in its name, then ``_PASSED_COLUMNS``."""
    number = float(alarm.alarm_id.removeprefix(_ALARM_PREFIX))
    values = [float(getattr(alarm, name)) for name in _PASSED_COLUMNS]
    return [number, *values]


class SeenDensity:
    """The density rule of Wang et al. 2007, Sec. II-B, applied to the ground seen so far.

    Maxima and area of final ground are stored. Those of open ground change with every scan and are
    counted anew.

    Parameters
    ----------
    screen : PrescreenTable
        Radius and density of the rule, and where it counts.
    spacing : float
        Pixel of the run-view, m.
    """

    def __init__(self, screen: PrescreenTable, spacing: float) -> None:
        self._screen = screen
        self._spacing = spacing
        self.magnitudes = array("d")  # of all final maxima that count, ascending
        self.final_area = 0.0  # m²

    def threshold(
        self, maxima: pd.DataFrame, view: xr.DataArray, closed: float, lane: Lane
    ) -> float:
        """Return the magnitude that the rule asks for.

        Parameters
        ----------
        maxima : DataFrame
            Maxima of the open ground: ``x``, ``y``, ``magnitude``.
        view : (y, x) DataArray
            The run-view; NaN where no scan has seen the ground.
        closed : float
            Ground up to this lane y is final, m.
        lane : Lane
            Ground that is searched.
        """
        counted = self._counts(maxima["x"], maxima["y"], lane)
        final = np.frombuffer(self.magnitudes)
        magnitudes = np.append(final, maxima["magnitude"].to_numpy()[counted])
        area = self.final_area + self._area(view, closed, math.inf, lane)
        return density_threshold(magnitudes, area, self._screen.radius, self._screen.density)

    def close(
        self, maxima: pd.DataFrame, view: xr.DataArray, closed: float, limit: float, lane: Lane
    ) -> None:
        """Count the maxima and the area between the final ground and lane y ``limit`` for good.

        Parameters
        ----------
        maxima, view, closed, lane
            As of :meth:`threshold`.
        limit : float
            Ground up to this lane y becomes final, m.
        """
        passed = (maxima["y"] <= limit).to_numpy()
        counted = maxima[self._counts(maxima["x"], maxima["y"], lane) & passed]
        for magnitude in counted["magnitude"]:
            bisect.insort(self.magnitudes, float(magnitude))
        self.final_area += self._area(view, closed, limit, lane)

    def _counts(
        self, x: pd.Series | FloatArray, y: pd.Series | FloatArray, lane: Lane
    ) -> BoolArray:
        """Return which positions the rule counts."""
        return counts(x, y, lane, self._screen.count)

    def _area(self, view: xr.DataArray, low: float, high: float, lane: Lane) -> float:
        """Return the area between two lane y that was seen and that the rule counts, m²."""
        x, y = np.meshgrid(view["x"].values, view["y"].values)
        counted = np.isfinite(view.values) & (y > low) & (y <= high) & self._counts(x, y, lane)
        return float(counted.sum()) * self._spacing**2
