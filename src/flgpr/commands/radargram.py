"""A radargram: the traces of a recording over time, as recorded or after the usual steps.

No import is needed. The steps are in :mod:`flgpr.clutter.radargram_steps`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flgpr.clutter.radargram_steps import (
    assumed_window,
    process_traces,
    samples_until,
    window_samples,
)
from flgpr.commands.picture import files_to_write, noted, write_drawing
from flgpr.formats.reader import recording_reader
from flgpr.formats.section import GprSection
from flgpr.model import SPEED_OF_LIGHT
from flgpr.types import Entries, FloatArray, IntArray, PathLike, floats

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ENDINGS = (".png", ".npz")
_MOST_SAMPLES = 50_000_000  # of a radargram


@dataclass(frozen=True)
class RadargramView:
    """What is drawn of a recording, after which steps, taken in the order of the fields."""

    channel: int = 0  #: from 0
    traces: tuple[int, int] | None = None  #: first and last, default all
    until: float | None = None  #: last two-way time, s; default all
    dewow: bool = False
    background: bool = False
    gain: bool = False
    #: of dewow and gain, s; default two periods of the antenna's nominal frequency, or a tenth of
    #: the record where the header does not state it
    window: float | None = None
    permittivity: float | None = None  #: of the ground, for an axis of depth


@dataclass(frozen=True)
class Radargram:
    """Traces over time, and what was read, assumed and done."""

    title: str
    # : (trace, sample), counts of the recorder; after ``gain`` in units of the line's level
    values: FloatArray
    delay: FloatArray  #: (sample,) two-way time, s, from the recorder's time zero
    number: IntArray  #: (trace,) which of the file's traces, from 0
    distance: FloatArray | None  #: (trace,) along the line, m; None if the header has none
    permittivity: float | None  #: of the ground, for the axis of depth
    unit: str  #: of ``values``, in words
    steps: tuple[str, ...]  #: what was done, in words and in order
    notes: tuple[str, ...]  #: what was found and assumed on reading, in words

    def lines(self) -> Iterator[str]:
        """Yield size and unit, the steps, and what was assumed."""
        traces, samples = self.values.shape
        yield f"{self.title}: {traces} traces x {samples} samples, {self.unit}"
        for step in self.steps:
            yield f"step: {step}"
        yield from noted(self.notes)

    def as_json(self) -> Entries:
        """Return the figures of the radargram."""
        traces, samples = self.values.shape
        return {
            "traces": traces,
            "samples": samples,
            "unit": self.unit,
            "steps": self.steps,
            "notes": self.notes,
        }

    def depth(self) -> FloatArray | None:
        """Return the depth (sample,) below antennas at one point, m; None without a permittivity.

        It is half the two-way time at the speed of waves in the ground.
        """
        if self.permittivity is None:
            return None
        speed = SPEED_OF_LIGHT / math.sqrt(self.permittivity)
        return floats(0.5 * speed * self.delay)


def make_radargram(
    path: PathLike, view: RadargramView = RadargramView(), output: Sequence[PathLike] = ()
) -> Radargram:
    """Read a recording, take the steps, and write the radargram as PNG or NumPy (.npz).

    Parameters
    ----------
    path : path
        Recording.
    view : RadargramView
        What is drawn, after which steps.
    output : sequence of path
        Files to write.

    Returns
    -------
    Radargram
        What was drawn.

    Raises
    ------
    ValueError
        If the recording cannot be read, the view does not fit it, or an output has another ending.
    FileExistsError
        If another file is at an output.
    """
    files = files_to_write(output, ENDINGS, " of a recording")
    drawn = radargram(recording_reader(path).read_section(Path(path)), view)
    for file in files:
        write_drawing(file, lambda: _figure(drawn), lambda: _arrays(drawn))
    return drawn


def radargram(section: GprSection, view: RadargramView) -> Radargram:
    """Take the steps of a view on the traces of a recording.

    A view that does not fit the recording is a ValueError.
    """
    channels = section.traces.shape[1]
    if not 0 <= view.channel < channels:
        raise ValueError(f"channel must be from 0 to {channels - 1}, got {view.channel}")
    if view.permittivity is not None and not 1 <= view.permittivity <= 100:
        raise ValueError(f"permittivity must be from 1 to 100, got {view.permittivity:g}")

    number = _chosen_traces(len(section.traces), view.traces)
    delay = section.delay_of(view.channel)
    samples = samples_until(delay, view.until)
    if number.size * delay.size > _MOST_SAMPLES:
        raise ValueError(
            f"a radargram must have at most {_MOST_SAMPLES:g} samples, "
            f"got {number.size} x {delay.size}: give scans"
        )

    traces = section.traces[number, view.channel].astype(np.float64)
    frequency = section.frequencies[view.channel]
    window = window_samples(delay, frequency, view.window)
    # The steps see the record to its end, also where only its beginning is drawn.
    processed = process_traces(traces, window, view.dewow, view.background, view.gain)

    notes = list(section.history)
    missing = int(np.count_nonzero(~np.isfinite(traces).all(axis=1)))
    if missing:
        notes.append(f"{missing} of {number.size} traces hold no data and are left blank")
    if (view.dewow or view.gain) and view.window is None:
        notes.append(assumed_window(frequency))
    return Radargram(
        title=_title(section, view.channel),
        values=processed.values[:, :samples],
        delay=delay[:samples],
        number=number,
        distance=None if section.distance is None else section.distance[number],
        permittivity=view.permittivity,
        unit=processed.unit,
        steps=processed.steps,
        notes=tuple(notes),
    )


def _title(section: GprSection, channel: int) -> str:
    """Return the file name, with the title of the header if that differs, and the channel.

    The file name comes first in importance: several lines may have the title of one site.
    """
    title = section.path.name
    if section.title not in ("", section.path.stem):
        title = f"{section.title} ({title})"
    is_single = section.traces.shape[1] == 1
    return title if is_single else f"{title}, channel {channel}"


def _chosen_traces(count: int, limits: tuple[int, int] | None) -> IntArray:
    """Return the numbers of the traces that are drawn."""
    first, last = limits or (0, count - 1)
    if not 0 <= first <= last < count:
        raise ValueError(
            f"scans must have 0 <= first <= last < {count}, the recording's traces, "
            f"got {first}, {last}"
        )
    return np.arange(first, last + 1)


def _figure(drawn: Radargram) -> Figure:
    """Draw a radargram."""
    from flgpr.report.images import radargram_figure

    return radargram_figure(
        drawn.values,
        drawn.delay,
        drawn.number,
        drawn.distance,
        drawn.depth(),
        drawn.title,
        drawn.unit,
        drawn.steps,
    )


def _arrays(drawn: Radargram) -> Entries:
    """Return the arrays of a radargram; without distances they are an empty array."""
    return {
        "values": drawn.values,
        "delay_s": drawn.delay,
        "trace": drawn.number,
        "distance_m": np.empty(0) if drawn.distance is None else drawn.distance,
        "steps": np.array(drawn.steps, dtype=str),
        "notes": np.array(drawn.notes, dtype=str),
        "unit": np.array(drawn.unit),
    }
