"""What a live run is asked for.

How a live run went: counts, alarms, and the time from a scan to its alarms.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from flgpr.live.detector import LiveSettings
from flgpr.live.event_types import Latencies
from flgpr.live.sockets import check_unix_sockets
from flgpr.model.vehicle import Vehicle
from flgpr.types import PathLike

_MOST_LATENCIES = 10_000  # latest ones, of which percentiles are reported


@dataclass(frozen=True)
class LiveOptions:
    """Options of a live run.

    Raises
    ------
    ValueError
        If there is nothing to take scans from, this system has no Unix sockets, or an option has
        no sense or needs another one.
    """

    recipe: PathLike | None  #: packaged recipe or TOML file; None makes one for the run
    output: PathLike  #: folder for events, snapshot and alarms
    incoming: PathLike | None = None
    socket: PathLike | None = None  #: unix socket to listen on
    model: PathLike | None = None  #: what the recipe's stages have learnt
    #: earlier runs of the road: what they predict is subtracted, and alarms are what has changed
    before: Sequence[PathLike] = ()
    lane: PathLike | None = None  #: TOML of the lane
    anchor: PathLike | None = None  #: TOML that ties the lane to the Earth
    settings: LiveSettings = field(default_factory=LiveSettings)
    vehicle: Vehicle | None = None  #: what decides what the driver is told; None is the recipe's
    snapshot: int = 20  #: a snapshot is written after that many scans; 0 writes only the last
    idle: float | None = None  #: end after so many seconds without a scan
    fresh: bool = False  #: begin anew, whatever the output folder holds of an earlier live run
    #: an alarm advises to wait for the next look if that changes the decision with at least this
    #: probability
    worth: float = 0.1
    #: TCP address to listen on: port, or address and port, see ``live.sockets.parse_tcp``
    tcp: str | None = None
    #: file of the secret that TCP senders must know, see ``live.secret``; None is that of the
    #: environment, if there is one
    secret_file: PathLike | None = None
    played: xr.Dataset | None = None  #: run that is played, see ``live.playing``
    rate: float | None = None  #: scans per second of that run; None plays it as it was recorded

    def __post_init__(self) -> None:
        sources = (self.incoming, self.socket, self.tcp, self.played)
        if all(source is None for source in sources):
            raise ValueError(
                "live needs a folder, a socket, a TCP address or a recording to take scans from, "
                "got none"
            )
        if self.secret_file is not None and self.tcp is None:
            raise ValueError(f"secret-file goes with a TCP address, got {self.secret_file}")
        if self.socket is not None:
            check_unix_sockets(Path(self.socket))
        if self.rate is not None and self.played is None:
            raise ValueError(f"rate goes with a recording that is played, got {self.rate:g}")
        if not 0 <= self.worth <= 1:
            raise ValueError(f"worth must be a probability, 0 to 1, got {self.worth}")
        if self.idle is not None and not self.idle >= 0:
            raise ValueError(f"idle must be 0 s or more, got {self.idle:g}")
        if self.snapshot < 0:
            raise ValueError(f"snapshot must be a number of scans from 0, got {self.snapshot}")
        if self.recipe is None and self.model is not None:
            raise ValueError("recipe must be given with a model: it names the model's stages")


@dataclass(frozen=True)
class LiveReport:
    """Outcome of a live run."""

    counts: dict[str, int]  #: see ``COUNTS`` in ``live.intake``
    #: ``median``, ``p95`` and ``largest`` time from the arrival of a scan to its alarms, and the
    #: number of ``scans``
    latency_ms: Latencies
    alarms: int  #: alarms that stand at the end
    #: frames processed per second between the first and the last one of this process; NaN with
    #: fewer than two
    rate: float


class Pace:
    """Counts the frames that a process took, and keeps the latest latencies."""

    def __init__(self) -> None:
        self.frames = 0
        self._first = self._last = math.nan  # when they were taken, s since 1970
        self._latency: deque[float] = deque(maxlen=_MOST_LATENCIES)

    def take_frame(self) -> None:
        """Count a frame that was taken now."""
        self._last = time.time()
        if not self.frames:
            self._first = self._last
        self.frames += 1

    def took(self, latency: float) -> None:
        """Keep the time from the arrival of a scan to its alarms, s."""
        self._latency.append(latency)

    def report(self, counts: dict[str, int], alarms: int) -> LiveReport:
        """Return how the run went, with its counts and the number of its alarms."""
        rate = math.nan
        if self.frames >= 2:
            rate = (self.frames - 1) / (self._last - self._first)
        return LiveReport(counts, latency_percentiles(list(self._latency)), alarms, rate)


def latency_percentiles(latency: list[float]) -> Latencies:
    """Return median, 95th percentile and largest of latencies, and their number.

    Parameters
    ----------
    latency : list of float
        Latencies, s.

    Returns
    -------
    dict
        ``median``, ``p95`` and ``largest`` in ms, and the number ``scans``; without any, that
        alone.
    """
    if not latency:
        return {"scans": 0}
    return {
        "median": _milliseconds(np.median(latency)),
        "p95": _milliseconds(np.percentile(latency, 95)),
        "largest": _milliseconds(np.max(latency)),
        "scans": len(latency),
    }


def _milliseconds(seconds: Any) -> float:
    """Return a duration in ms with one decimal."""
    return round(1e3 * float(seconds), 1)
