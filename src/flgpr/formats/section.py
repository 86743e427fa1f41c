"""One line of traces that a ground-penetrating radar recorded, whatever the maker's format."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr.store.store_layout import MAX_MEMORY
from flgpr.types import FloatArray


@dataclass(frozen=True)
class GprSection:
    """One line of a ground-penetrating radar: the traces of a file, and what its headers say."""

    path: Path
    format: str  #: what it was read as, in words
    #: (trace, channel, sample) counts of the recorder, float; NaN where the recorder marks a
    #: trace as no data
    traces: NDArray[np.floating[Any]]
    #: (sample,) two-way delay, s; zero where the header puts time zero, else at the first sample
    delay: FloatArray
    #: (trace,) along the line, m; None if the header does not state it
    distance: FloatArray | None = None
    time: FloatArray | None = None  #: (trace,) s, on a clock of the recorder's own; None if unknown
    #: (fix, 4) of a satellite receiver: trace (from 0), longitude, latitude (degrees, WGS 84),
    #: ellipsoidal height (m)
    fixes: FloatArray = field(default_factory=lambda: np.empty((0, 4)))
    marks: tuple[int, ...] = ()  #: traces, from 0, at which the operator set a mark
    #: nominal frequency of each channel's antenna, Hz
    frequencies: tuple[float | None, ...] = (None,)
    separation: float | None = None  #: between transmitter and receiver, m
    title: str = ""  #: what the header calls the line, else the file's name
    history: tuple[str, ...] = ()  #: what was read and assumed, in words
    #: (channel, sample) two-way delay, s, where channels have headers that differ; ``delay`` is
    #: that of the first
    channel_delay: FloatArray | None = None
    #: (fix,) when the receiver was there, s of its first day, NaN where unknown
    fix_time: FloatArray = field(default_factory=lambda: np.empty(0))
    max_memory: int = MAX_MEMORY  #: bytes that a run made of it may take: what it was read with
    #: what the file calls a survey whose antennas move apart, such as "CMP/WARR"; empty for a line
    gather: str = ""
    #: (channel, 2) where each channel's antennas are across and along the line, m; None if the
    #: header does not state it
    offsets: FloatArray | None = None

    def delay_of(self, channel: int) -> FloatArray:
        """Return the two-way delay (sample,) of a channel, s."""
        return self.delay if self.channel_delay is None else self.channel_delay[channel]
