"""A plain radargram: the traces of a recording over time, as recorded or after the usual steps, without an import."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flgpr.clutter import dewow_traces, level_traces, remove_mean_trace
from flgpr.formats import GprSection, is_gpr, read_gpr
from flgpr.model import SPEED_OF_LIGHT
from flgpr.store import MAX_MEMORY
from flgpr.store.outputs import whole_output

PathLike = str | Path
FloatArray = NDArray[np.float64]
ENDINGS = (".png", ".npz")
_PERIODS = 2.0  # of the antenna's frequency, in a window that nobody gives
_SHARE = 0.1  # of the record, where the antenna's frequency is unknown, too
_MOST = 50_000_000  # samples of a radargram


@dataclass(frozen=True)
class RadargramView:
    """What to draw of a recording, and the steps before, which are taken in the order in which they stand here.

    ``channel`` counts from 0; ``traces`` are the first and the last, default all; ``until`` is the last two-way time,
    s. ``window``, s, is that of ``dewow`` and ``gain``: by default two periods of the antenna's nominal frequency, or
    a tenth of the record where the header does not tell it. ``permittivity`` of the ground gives an axis of depth.
    """

    channel: int = 0
    traces: tuple[int, int] | None = None
    until: float | None = None
    dewow: bool = False
    background: bool = False
    gain: bool = False
    window: float | None = None
    permittivity: float | None = None


@dataclass(frozen=True)
class Radargram:
    """Traces over time, and what was read, assumed and done."""

    title: str
    # : (trace, sample), counts of the recorder; after ``gain`` in units of the line's level
    values: FloatArray
    delay: FloatArray  #: (sample,) two-way time, s, from the recorder's time zero
    number: NDArray[np.int64]  #: (trace,) which of the file's traces, from 0
    distance: FloatArray | None  #: (trace,) along the line, m; None if the header does not tell
    permittivity: float | None  #: of the ground, for the axis of depth
    unit: str  #: of ``values``, in words
    steps: tuple[str, ...]  #: what was done, in words and in order
    notes: tuple[str, ...]  #: what was found and assumed on reading, in words

    def depth(self) -> FloatArray | None:
        """Return the depth (sample,) below antennas at one place, m: half the two-way time at the ground's speed.

        None without a permittivity.
        """
        if self.permittivity is None:
            return None
        speed = SPEED_OF_LIGHT / math.sqrt(self.permittivity)
        return np.asarray(0.5 * speed * self.delay, dtype=np.float64)


def is_recording(path: PathLike) -> bool:
    """Tell by its ending whether a path is a file that a radargram can be drawn of."""
    return Path(path).is_file() and is_gpr(Path(path))


def make_radargram(
    path: PathLike,
    view: RadargramView = RadargramView(),
    output: Sequence[PathLike] = (),
    max_memory: int = MAX_MEMORY,
) -> Radargram:
    """Read a recording, take the steps, and write the radargram as PNG or NumPy (.npz).

    Raises
    ------
    ValueError
        If the recording cannot be read, the view does not fit it, or an output has another ending.
    FileExistsError
        If another file is at an output's place.
    """
    files = [Path(one) for one in output]
    for file in files:
        if file.suffix.lower() not in ENDINGS:
            raise ValueError(
                f"output of a recording must end in {', '.join(ENDINGS)}, got {file.name!r}"
            )
    made = radargram(read_gpr(path, max_memory), view)
    for file in files:
        _write(made, file)
    return made


def radargram(section: GprSection, view: RadargramView = RadargramView()) -> Radargram:
    """Take the steps of a view on the traces of a recording; a view that does not fit it is a ValueError."""
    channels = section.traces.shape[1]
    if not 0 <= view.channel < channels:
        raise ValueError(f"channel must be from 0 to {channels - 1}, got {view.channel}")
    if view.permittivity is not None and not 1 <= view.permittivity <= 100:
        raise ValueError(f"permittivity must be from 1 to 100, got {view.permittivity:g}")
    number = _chosen_traces(len(section.traces), view.traces)
    delay = section.delay_of(view.channel)
    samples = _samples_until(delay, view.until)
    if number.size * delay.size > _MOST:
        raise ValueError(
            f"a radargram must have at most {_MOST:g} samples, got {number.size} x {delay.size}: give scans"
        )
    values = section.traces[number, view.channel].astype(np.float64)
    notes = list(section.history)
    missing = int(np.count_nonzero(~np.isfinite(values).all(axis=1)))
    if missing:
        notes.append(f"{missing} of {number.size} traces hold no data and are left blank")
    steps = _Steps(values, _window_samples(section, view))
    if view.dewow:
        steps.dewow()
    if view.background:
        steps.background()
    if view.gain:
        steps.gain()
    if (view.dewow or view.gain) and view.window is None:
        notes.append(_assumed_window(section, view))
    distance = None if section.distance is None else section.distance[number]
    title = _title(section, view.channel)
    return Radargram(
        title, steps.values[:, :samples], delay[:samples], number, distance, view.permittivity, steps.unit,
        tuple(steps.done), tuple(notes),
    )  # fmt: skip


def _title(section: GprSection, channel: int) -> str:
    """Name a line by its file, for several may have one site, and by what its header calls it."""
    title = section.path.name
    if section.title not in ("", section.path.stem):
        title = f"{section.title} ({title})"
    return title if section.traces.shape[1] == 1 else f"{title}, channel {channel}"


@dataclass
class _Steps:
    """Traces on their way through the steps, and what was done to them."""

    values: FloatArray
    window: int  #: samples

    def __post_init__(self) -> None:
        self.unit = "counts of the recorder"
        self.done: list[str] = []

    def dewow(self) -> None:
        self.values = dewow_traces(self.values, self.window)
        self.done.append(f"dewow over {self.window} samples")

    def background(self) -> None:
        self.values = remove_mean_trace(self.values)
        self.done.append("mean trace removed")

    def gain(self) -> None:
        self.values = level_traces(self.values, self.window)
        self.unit = "amplitude over the line's level at that time"
        self.done.append(f"gain: divided by the line's level over {self.window} samples")


def _chosen_traces(count: int, limits: tuple[int, int] | None) -> NDArray[np.int64]:
    first, last = limits or (0, count - 1)
    if not 0 <= first <= last < count:
        raise ValueError(
            f"scans must have 0 <= first <= last < {count}, the recording's traces, got {first}, {last}"
        )
    return np.arange(first, last + 1)


def _samples_until(delay: FloatArray, until: float | None) -> int:
    """Count the samples up to a time, s."""
    if until is None:
        return delay.size
    half_sample = 0.5 * float(
        delay[1] - delay[0]
    )  # a header's rounding shall not cost the last one
    count = int(np.searchsorted(delay, until + half_sample, side="right"))
    if count < 2:
        raise ValueError(
            f"until must be a time after the first two samples, {delay[1] * 1e9:g} ns, got {until * 1e9:g} ns"
        )
    return count


def _window_samples(section: GprSection, view: RadargramView) -> int:
    """Tell how many samples, an odd number of at least 3, the window of dewow and gain takes."""
    delay = section.delay_of(view.channel)
    interval = float(delay[1] - delay[0])
    record = interval * delay.size
    nominal = section.frequencies[view.channel]
    if view.window is not None:
        if not 0 < view.window <= record:
            raise ValueError(
                f"window must be from 0 to the record's {record * 1e9:g} ns, got {view.window * 1e9:g} ns"
            )
        length = view.window
    elif nominal is not None:
        length = min(_PERIODS / nominal, record)
    else:
        length = _SHARE * record
    return max(2 * round(length / interval / 2) + 1, 3)


def _assumed_window(section: GprSection, view: RadargramView) -> str:
    nominal = section.frequencies[view.channel]
    if nominal is None:
        return f"window of dewow and gain assumed: {100 * _SHARE:g} % of the record, no antenna's frequency is known"
    return f"window of dewow and gain assumed: {_PERIODS:g} periods of the antenna's {nominal / 1e6:g} MHz"


def _write(made: Radargram, path: Path) -> None:
    with whole_output(path) as partial:
        if path.suffix.lower() == ".png":
            from flgpr.report import figure_png  # loads what draws
            from flgpr.report.radargram import radargram_figure

            figure = radargram_figure(
                made.values,
                made.delay,
                made.number,
                made.distance,
                made.depth(),
                made.title,
                made.unit,
                made.steps,
            )
            partial.write_bytes(figure_png(figure))
        else:
            distance = np.empty(0) if made.distance is None else made.distance
            np.savez(
                partial, values=made.values, delay_s=made.delay, trace=made.number, distance_m=distance,
                steps=np.array(made.steps, dtype=str), notes=np.array(made.notes, dtype=str), unit=np.array(made.unit),
            )  # fmt: skip
