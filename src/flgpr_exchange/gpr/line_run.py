"""A line of traces of a commercial ground-penetrating radar as a run, and described in words."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

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
from flgpr_exchange.gpr.places import doubts_of_fixes, options_that_place, trace_poses

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

    delay = _delay(section.delay_of(channel), time_zero, window)
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
    notes += _replaced(section, channel, step, time_zero, window, separation)
    nominal = section.frequencies[channel]
    chosen_band = _band(band, nominal, delay, notes)
    traces, pose = trace_poses(section, step, height, anchor, topography, notes)
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
        store = f"{shlex.quote(path.stem)}.zarr"
        lines.append(f"to import it: flgpr import gpr {shlex.quote(str(path))} -o {store}")
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


def _replaced(
    section: GprSection,
    channel: int,
    step: float | None,
    time_zero: float | None,
    window: float | None,
    separation: float | None,
) -> list[str]:
    """Return in lines what was given in place of what the file states."""
    delay = section.delay_of(channel)
    values: dict[str, tuple[float | None, float | None, str]] = {
        "separation": (separation, section.separation, "m"),
        "time window": (window, (delay[1] - delay[0]) * delay.size, "s"),
        "time zero": (time_zero, -float(delay[0]), "s"),
    }
    lines = []
    for name, (replacement, stated, unit) in values.items():
        if replacement is None or stated is None:
            continue
        if not math.isclose(replacement, stated, rel_tol=1e-9, abs_tol=1e-15):
            lines.append(
                f"{name} {replacement:.6g} {unit} is given in place of the file's, "
                f"{stated:.6g} {unit}"
            )
    if step is not None and section.distance is not None:
        lines.append(
            f"equal steps of {step:.6g} m are given in place of the file's "
            f"{section.distance.size} places"
        )
    return lines


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
