"""A line of traces of a commercial ground-penetrating radar as a run, and described in words.

A run has one of its channels, or all of them; one that is only viewed has all that is recorded.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from flgpr.formats.impulse import impulse_to_frequency
from flgpr.formats.section import GprSection
from flgpr.geo.anchor import Anchor
from flgpr.model import make_run
from flgpr.store.store_layout import MAX_MEMORY
from flgpr.types import ComplexArray, Entries, FloatArray, IntArray, Notes
from flgpr_exchange.gpr.files import NOT_READ, READERS, read_gpr
from flgpr_exchange.gpr.parts import INTERVALS, MissingHeaderError, note_count
from flgpr_exchange.gpr.places import (
    doubts_of_fixes,
    option_that_places,
    options_that_place,
    poses_by_distance,
    poses_by_fixes,
)

_BLOCK = 512  # traces that are transformed at a time
_LOWEST = 1e6  # Hz, below which no run has tones
_NYQUIST_SHARE = 0.9  # of the Nyquist frequency, which recorders' filters leave
OCTAVE = 2.0
"""Ratio of the ends of a band, at least, for the antenna's frequency to be believed."""


class ReasonedBand(NamedTuple):
    """A band to keep, Hz, and what the notes say of why."""

    lowest: float
    highest: float
    reason: str


def gpr_run(
    section: GprSection,
    channel: int = 0,
    *,
    step: float | None = None,
    time_zero: float | None = None,
    window: float | None = None,
    band: tuple[float, float] | ReasonedBand | None = None,
    separation: float | None = None,
    across: bool = False,
    height: float = 0.0,
    polarization: str = "HH",
    anchor: Anchor | None = None,
    topography: bool = False,
) -> xr.Dataset:
    """Make a run of a line: one scan per trace, one pair.

    The line runs along +y of the lane from its start, at x = 0, unless an anchor places it.

    Parameters
    ----------
    section : GprSection
        The line (:func:`flgpr.formats.read_gpr`).
    channel : int
        The channel.
    step : float, optional
        Distance between traces, m, in place of what the headers state.
    time_zero : float, optional
        Time zero after the first sample, s, in place of what the headers state.
    window : float, optional
        Time window, s, in place of what the headers state.
    band : tuple of float or ReasonedBand, optional
        Band to keep, Hz. By default it is a quarter to twice the antenna's nominal frequency; up to
        half of what the sampling holds where that is unknown, and all of it where that is less than
        an octave of the antenna's. The notes give the reason of a ``ReasonedBand``.
    separation : float, optional
        Distance of the antennas, m, in place of what the headers state.
    across : bool
        Whether the antennas lie side by side; by default the receiver is ahead of the transmitter.
    height : float
        Height of the antennas over the ground, m.
    polarization : str
        Label of the polarization.
    anchor : Anchor, optional
        With it the satellite receiver's positions put the traces in the lane; traces before its
        first and after its last are left out.
    topography : bool
        Whether traces are put on the receiver's heights, which else are not used.

    Returns
    -------
    xarray.Dataset
        The run (:func:`flgpr.model.make_run`); ``import_notes`` state what was assumed.

    Raises
    ------
    ValueError
        If something is neither in the headers nor given, or does not fit.
    """
    channels = section.traces.shape[1]
    if not 0 <= channel < channels:
        raise ValueError(f"channel must be from 0 to {channels - 1}, got {channel}")
    notes = list(section.history)
    if channels > 1:
        known = "the header tells" if section.offsets is not None else "the file does not tell"
        notes.append(f"channel {channel} of {channels}: {known} where their antennas are")
    if section.gather:
        raise ValueError(
            f"{section.path}: its antennas move apart ({section.gather}): "
            "it is no line of one offset and makes no run"
        )

    stated = section.delay_of(channel)
    delay = _delay(stated, time_zero, window)
    apart = section.separation if separation is None else separation
    if apart is None:
        apart = 0.0
        notes.append("no antenna separation is told: transmitter and receiver are put at one place")
    if not (0 <= apart <= 100 and math.isfinite(height) and height >= 0):
        raise ValueError(
            "separation and height must not be negative, the first at most 100 m, "
            f"got {apart}, {height}"
        )
    half = np.array([[apart / 2, 0.0, 0.0] if across else [0.0, apart / 2, 0.0]])
    middle = np.zeros((1, 3))
    if section.offsets is not None:
        middle[0, :2] = section.offsets[channel]
    _note_given("separation", separation, section.separation, "m", notes)
    _note_given("time window", window, (stated[1] - stated[0]) * stated.size, "s", notes)
    _note_given("time zero", time_zero, -float(stated[0]), "s", notes)
    if step is not None and section.distance is not None:
        notes.append(
            f"equal steps of {step:.6g} m are given in place of the file's "
            f"{section.distance.size} places"
        )
    nominal = section.frequencies[channel]
    chosen_band = _band(band, nominal, delay, notes)
    if anchor is None:
        if topography:
            raise ValueError(
                "topography needs an anchor and a receiver's heights: "
                "give `anchor` or anchor_from_track"
            )
        traces, pose = poses_by_distance(section, step, height, notes)
    else:
        if step is not None:
            raise ValueError(
                "step tells distances along the line, an anchor puts the traces on the satellite "
                f"receiver's positions: give one, got step {step:g} m and an anchor"
            )
        traces, pose = poses_by_fixes(section, height, anchor, topography, notes)
    note_count(notes, len(section.marks), "marks of the operator are not kept in the run")
    signal, tones = _signal(section, channel, traces, delay, chosen_band)

    attrs: Entries = {
        "title": section.title,
        "source": f"{section.format}, {section.path.name}",
        "import_notes": notes,
        "sounding": "air-launched" if height > 0 else "ground-coupled",
        # What takes the tones back to traces: a record of this length that begins at this delay.
        "time_window_s": float((delay[1] - delay[0]) * delay.size),
        "first_sample_s": float(delay[0]),
        "samples": delay.size,
    }
    if nominal:
        attrs["antenna_frequency_hz"] = nominal
    time = None if section.time is None else section.time[traces]
    tx, rx = middle - half, middle + half
    return make_run(signal[:, None, None], tones, [polarization], tx, rx, pose, time, attrs)


def explain_gpr(path: Path, max_memory: int = MAX_MEMORY) -> tuple[str, list[str]]:
    """Return the format of a recording, and in lines what it holds and the command to import it.

    Parameters
    ----------
    path : Path
        The recording.
    max_memory : int
        Bytes of memory to use.

    Returns
    -------
    format : str
        What it is.
    lines : list of str
        What it holds, or why it cannot be read.

    Raises
    ------
    ValueError
        If it is damaged.
    """
    suffix = path.suffix.lower()
    if suffix in NOT_READ:
        kind, advice = NOT_READ[suffix]
        return f"{kind} file", [f"known by its ending {suffix}; it cannot be read: {advice}"]
    try:
        section = read_gpr(path, max_memory)
    except MissingHeaderError as error:
        return READERS[suffix][0], [str(error).partition(": ")[2]]

    count, channels, samples = section.traces.shape
    window = samples * float(section.delay[1] - section.delay[0])
    zero = -section.delay[0] * 1e9
    side = "after" if zero >= 0 else "before"
    several = f", {channels} channels" if channels > 1 else ""
    place = f"trace spacing unknown: give {options_that_place(section, '--')}"
    if section.distance is not None and count > 1:
        # There and back, where a line turns round.
        length = float(np.abs(np.diff(section.distance)).sum())
        place = f"length {length:.6g} m, trace spacing {length / (count - 1):.4g} m"
    apart = "unknown" if section.separation is None else f"{section.separation:g} m"
    lines = [
        f"{section.title}: {count} traces x {samples} samples{several}",
        f"time window {window * 1e9:.6g} ns, time zero {abs(zero):.6g} ns {side} its start",
        place,
        f"antenna {frequency_words(section.frequencies)}, separation {apart}",
        f"{len(section.fixes)} positions of a satellite receiver, {len(section.marks)} marks",
        *section.history,
        *doubts_of_fixes(section),
    ]
    if section.gather:
        lines.append("flgpr import gpr refuses it, for a run is a line of one offset")
    else:
        words = ["flgpr", "import", "gpr", str(path), "-o", f"{path.stem}.zarr"]
        lines.append(f"to import it: {shlex.join(words)}{option_that_places(section)}")
    return section.format, lines


def frequency_words(frequencies: Sequence[float | None]) -> str:
    """Return nominal frequencies of antennas, Hz, in words."""
    return ", ".join("unknown" if one is None else f"{one / 1e6:g} MHz" for one in frequencies)


def recorded_band(delays: Sequence[FloatArray]) -> tuple[float, float]:
    """Return the band, Hz, that records at all of these delays (sample,), s, hold.

    It ends at what recorders' filters leave of the Nyquist frequency.
    """
    intervals = [float(delay[1] - delay[0]) for delay in delays]
    shortest = min(interval * delay.size for interval, delay in zip(intervals, delays, strict=True))
    return max(_LOWEST, 1 / shortest), _NYQUIST_SHARE * 0.5 / max(intervals)


def _delay(stated: FloatArray, zero: float | None, window: float | None) -> FloatArray:
    """Return the delays (sample,), s, with a time window and a time zero in place of the file's."""
    stated_interval = stated[1] - stated[0]
    interval = stated_interval if window is None else window / stated.size
    if not INTERVALS[0] <= interval <= INTERVALS[1]:
        raise ValueError(
            f"window must make the samples 1e-4 to 1e3 ns apart, got {interval * 1e9:g} ns"
        )
    # Another window stretches the record: its time zero stays at the same sample.
    first = -stated[0] * interval / stated_interval if zero is None else zero
    if not abs(first) <= 100 * interval * stated.size:
        raise ValueError(
            f"time zero must lie near the record of {interval * stated.size:g} s, got {first:g} s"
        )
    return np.arange(stated.size) * interval - first


def _band(
    band: tuple[float, float] | ReasonedBand | None,
    nominal: float | None,
    delay: FloatArray,
    notes: Notes,
) -> tuple[float, float]:
    """Return the band to keep, Hz.

    It is ``band`` if that is given, one about the antenna's ``nominal`` frequency, or one by the
    sampling.
    """
    interval = float(delay[1] - delay[0])
    nyquist = 0.5 / interval
    lowest, highest = recorded_band([delay])
    if nominal and nominal > nyquist:
        notes.append(
            f"an antenna of {nominal / 1e6:g} MHz does not fit samples {interval * 1e9:.4g} ns "
            f"apart, which hold frequencies up to {nyquist / 1e6:g} MHz: "
            "are antenna and time window right?"
        )
    if band is None and nominal:
        band = antennas_band([nominal], lowest, highest)
    elif band is None:
        band = ReasonedBand(lowest, 0.5 * nyquist, "by the sampling")
    low, high = band[:2]
    reason = band.reason if isinstance(band, ReasonedBand) else "given"
    if not lowest * (1 - 1e-9) <= low < high <= nyquist:
        raise ValueError(
            f"band must lie between {lowest / 1e6:g} MHz and half the sampling rate, "
            f"{nyquist / 1e6:g} MHz, got {low / 1e6:g} to {high / 1e6:g} MHz: give the band, "
            "or is the time window right?"
        )
    notes.append(f"impulse data taken to frequency, {low / 1e6:g} to {high / 1e6:g} MHz ({reason})")
    return low, high


def antennas_band(frequencies: Sequence[float], lowest: float, highest: float) -> ReasonedBand:
    """Return the band that is kept of antennas of these nominal frequencies, Hz.

    Parameters
    ----------
    frequencies : sequence of float
        Nominal frequencies, Hz.
    lowest, highest : float
        What records and sampling hold, Hz.

    Returns
    -------
    ReasonedBand
        The band, Hz, and why it is that: all that they hold if that is less than an octave of the
        antennas'.
    """
    whose = "antenna's" if len(frequencies) == 1 else "antennas'"
    low = max(min(frequencies) / 4, lowest)
    high = min(2 * max(frequencies), highest)
    if high < OCTAVE * low:
        reason = f"all that is recorded, which hardly holds any of the {whose}"
        return ReasonedBand(lowest, highest, reason)
    is_cut = low > min(frequencies) / 4 or high < 2 * max(frequencies)
    within = ", within what record and sampling hold" if is_cut else ""
    return ReasonedBand(low, high, f"a quarter to twice the {whose}{within}")


def _note_given(
    name: str, given: float | None, stated: float | None, unit: str, notes: Notes
) -> None:
    """Note what was given in place of what the file states, if it is another value."""
    if given is None or stated is None or math.isclose(given, stated, rel_tol=1e-9, abs_tol=1e-15):
        return
    notes.append(f"{name} {given:.6g} {unit} is given in place of the file's, {stated:.6g} {unit}")


def _signal(
    section: GprSection,
    channel: int,
    traces: IntArray,
    delay: FloatArray,
    band: tuple[float, float],
) -> tuple[ComplexArray, FloatArray]:
    """Return the signal (scan, tone) of some traces, and its tones, Hz.

    A signal that is too large is refused before it is computed.
    """
    samples = section.traces[:, channel]
    tones = impulse_to_frequency(samples[:1], delay, band)[1]
    size = len(traces) * tones.size * 8
    if size > section.max_memory:
        raise ValueError(
            f"the run must fit into {section.max_memory / 1e9:.3g} GB, "
            f"it takes {size / 1e9:.3g} GB: narrow the band"
        )
    # In blocks, for a transform of all at once takes many times their memory.
    signal = np.empty((len(traces), tones.size), np.complex64)
    for begin in range(0, len(traces), _BLOCK):
        block = traces[begin : begin + _BLOCK]
        signal[begin : begin + _BLOCK] = impulse_to_frequency(samples[block], delay, band)[0]
    return signal, tones


def channels_run(
    section: GprSection, channel_x: Sequence[float] | None = None, **options: Any
) -> xr.Dataset:
    """Make one run of all channels of a line, a pair each, on the same tones.

    Parameters
    ----------
    section : GprSection
        The line, of :func:`flgpr.formats.read_gpr`.
    channel_x : (channel,) sequence of float, optional
        Where the antennas of each channel are across the line, m in the vehicle frame, in place of
        what the header states. Where it states nothing all are put at x = 0, which
        ``import_notes`` state.
    **options
        Those of :func:`flgpr.formats.gpr_run` but ``channel``. ``band`` is by default a quarter of
        the lowest to twice the highest nominal frequency of the antennas, or all that is recorded
        where one of these is unknown.

    Returns
    -------
    xarray.Dataset
        The run (:func:`flgpr.model.make_run`).

    Raises
    ------
    ValueError
        If the channels have different time windows, so that they have no common tones, if
        ``channel_x`` is not a number per channel, or for what :func:`flgpr.formats.gpr_run`
        refuses.
    """
    count = section.traces.shape[1]
    replaced = []
    if channel_x is not None:
        offsets = [float(x) for x in channel_x]
        if len(offsets) != count or not np.isfinite(offsets).all():
            raise ValueError(
                f"channel_x must give a finite x, m, for each of {count} channels, got {offsets}"
            )
        if section.offsets is not None:
            stated = ", ".join(f"{x:g}" for x in section.offsets[:, 0])
            replaced.append(f"channel-x is given in place of the file's, {stated} m")
        section = replace(section, offsets=np.column_stack([offsets, np.zeros(count)]))
    if options.get("band") is None:
        options["band"] = common_band(section)
    runs = [gpr_run(section, channel, **options) for channel in range(count)]
    for channel in range(count):
        if not share_tones(runs, channel):
            raise ValueError(
                f"{section.path}: channels of one run must have one time window, channel {channel} "
                "has another than channel 0: import them apart, with `channel` 0 and "
                f"{channel}"
            )

    # Every note once, but those of single channels: one of all channels stands for them.
    notes = dict.fromkeys(note for run in runs for note in run.attrs["import_notes"])
    kept = [note for note in notes if not (note.startswith("channel ") and " of " in note)]
    kept += replaced
    if count > 1:
        antennas = frequency_words(section.frequencies)
        kept.append(f"all {count} channels in one run, a pair each; antennas {antennas}")
        if section.offsets is None:
            kept.append(
                f"{count} channels put at one place: "
                "the file does not tell where their antennas are"
            )

    merged = xr.concat(
        runs, dim="pair", data_vars="minimal", coords="minimal", compat="equals", join="exact"
    )
    return merged.assign_attrs(import_notes=kept)


def share_tones(runs: list[xr.Dataset], number: int) -> bool:
    """Give a run the very tones of the first, if its own are these but for their rounding.

    Returns
    -------
    bool
        Whether they are.
    """
    first, own = runs[0]["frequency"].values, runs[number]["frequency"].values
    if first.shape != own.shape or not np.allclose(own, first, rtol=1e-9, atol=0):
        return False
    runs[number] = runs[number].assign_coords(frequency=first)
    return True


def preview_run(path: str | Path, max_memory: int = MAX_MEMORY) -> xr.Dataset:
    """Return a recording as a run to be viewed, of all channels and all frequencies.

    Where the header states no trace spacing, traces are put 1 m apart. Channels whose time window
    is another one than the first's are left out.

    Parameters
    ----------
    path : path
        The recording.
    max_memory : int
        Bytes of memory to use.

    Returns
    -------
    xarray.Dataset
        The run; ``import_notes`` state what was assumed and left out.

    Raises
    ------
    ValueError
        If the recording cannot be read or makes no run.
    """
    section = read_gpr(path, max_memory)
    band = ReasonedBand(*_widest_band(section), "all that is recorded")
    options: Entries = {"band": band}
    notes = []
    if section.distance is None:
        options["step"] = 1.0
        notes.append("no trace spacing is known: traces are put 1 m apart")
    try:
        run = channels_run(section, **options)
    except ValueError:
        if section.traces.shape[1] == 1:
            raise
        run = gpr_run(section, 0, **options)
        notes.append("channel 0 is shown alone: the others have another time window")
    run.attrs["import_notes"] = [*run.attrs["import_notes"], *notes]
    return run


def common_band(section: GprSection) -> ReasonedBand:
    """Return a band that holds those of all antennas of a line, else all that is recorded.

    Parameters
    ----------
    section : GprSection
        The line.

    Returns
    -------
    ReasonedBand
        The band, Hz, and why it is that.
    """
    known = [frequency for frequency in section.frequencies if frequency is not None]
    lowest, highest = _widest_band(section)
    if len(known) < section.traces.shape[1]:
        reason = "all that is recorded: an antenna's frequency is unknown"
        return ReasonedBand(lowest, highest, reason)
    return antennas_band(known, lowest, highest)


def _widest_band(section: GprSection) -> tuple[float, float]:
    """Return the band, Hz, that the records and the sampling of all channels hold."""
    return recorded_band([section.delay_of(channel) for channel in range(section.traces.shape[1])])
