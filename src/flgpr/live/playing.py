"""A recorded run as a source of live scans: one after the other, in the order of their times."""

from __future__ import annotations

import math
import time

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flgpr.live.source import Arrival, Inbox, Source
from flgpr.store import describe_for_live, encode_scan
from flgpr.store.scan_file import scan_name, stored_scan

RECORDING = "recording"
"""Name of arrivals of a recording that are no scans."""


def in_time_order(run: xr.Dataset) -> xr.Dataset:
    """Return a run whose scans follow one another in time.

    Parameters
    ----------
    run : Dataset
        A run. Scans of the same time keep their order, as do all where a time is not known.

    Returns
    -------
    Dataset
        The same scans.
    """
    moments = run["time"].values
    if not np.isfinite(moments).all():
        return run
    return run.isel(scan=np.argsort(moments, kind="stable"))


def due_times(run: xr.Dataset, rate: float | None) -> NDArray[np.float64]:
    """Return when each scan of a run is due, s after the first.

    Parameters
    ----------
    run : Dataset
        A run in the order of its times.
    rate : float or None
        Scans per second, infinity for all at once; None takes the run's own times.

    Returns
    -------
    (scan,) ndarray
        Times, ascending.

    Raises
    ------
    ValueError
        If the rate is not positive, or there is none and the run has no times.
    """
    count = run.sizes["scan"]
    if rate is None:
        moments = np.asarray(run["time"].values, np.float64)
        if not np.isfinite(moments).all():
            raise ValueError("rate must be given for a recording without times of its scans")
        return moments - moments[0]
    if not rate > 0:
        raise ValueError(f"rate must be positive, got {rate}")
    if math.isinf(rate):
        return np.zeros(count)
    return np.arange(count) / rate


class RunPlayer(Source):
    """Plays a run into the inbox of a live run, without the scans that are ``known``.

    Parameters
    ----------
    run : Dataset
        The run, see :func:`in_time_order`.
    inbox : Inbox
        Takes the scans.
    rate : float, optional
        As for :func:`due_times`.
    known : set of str, optional
        Names of scans that an earlier process took: the drive begins behind them.

    Raises
    ------
    ValueError
        If the rate is not valid.
    """

    def __init__(
        self,
        run: xr.Dataset,
        inbox: Inbox,
        rate: float | None = None,
        known: set[str] | None = None,
    ) -> None:
        super().__init__(RECORDING, inbox)
        self._run = in_time_order(run)
        self._due = due_times(self._run, rate)
        names = [scan_name(number) for number in range(self._run.sizes["scan"])]
        self._numbers = [number for number, name in enumerate(names) if name not in (known or ())]

    def bring(self) -> None:
        """Hand over the description, then every scan when it is due, then the end."""
        description = describe_for_live(self._run)
        self.inbox.put(Arrival("run", RECORDING, time.time(), value=description.as_json()))
        start = time.monotonic()
        for number in self._numbers:
            due = start + self._due[number] - self._due[self._numbers[0]]
            # Every wait ends at once where the live run stops.
            if self.inbox.stop.wait(max(due - time.monotonic(), 0.0)):
                return
            scan = stored_scan(self._run, number)
            frame = encode_scan(number, scan.signal, scan.pose, scan.time, description.run_id)
            self.inbox.put(Arrival("frame", scan_name(number), time.time(), frame))
        self.inbox.put(Arrival("end", RECORDING, time.time()))
