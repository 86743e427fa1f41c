"""How a live run went: counts, alarms, and the time from a scan to its alarms."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from flgpr.live.event_types import Latencies


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
