"""All channels of a recording as one run, and a recording as a run that is only viewed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from flgpr.formats.section import GprSection
from flgpr.store.store_layout import MAX_MEMORY
from flgpr_exchange.gpr.files import read_gpr
from flgpr_exchange.gpr.line_run import ReasonedBand, antennas_band, frequency_words, gpr_run

_NYQUIST_SHARE = 0.9  # of half the sampling rate, up to which a recording is viewed
_LOWEST = 1e6  # Hz


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
    section, replaced = _placed(section, channel_x)
    if options.get("band") is None:
        options["band"] = common_band(section)
    runs = [gpr_run(section, channel, **options) for channel in range(count)]
    tones = runs[0]["frequency"].values
    for channel, run in enumerate(runs):
        if not np.array_equal(run["frequency"].values, tones):
            raise ValueError(
                f"{section.path}: channels of one run must have one time window, channel {channel} "
                "has another than channel 0: import them apart, with `channel` 0 and "
                f"{channel}"
            )

    notes = [*_notes_of_all(runs), *replaced]
    if count > 1:
        notes.append(_note_of_channels(section))
        if section.offsets is None:
            notes.append(
                f"{count} channels put at one place: "
                "the file does not tell where their antennas are"
            )

    merged = xr.concat(
        runs, dim="pair", data_vars="minimal", coords="minimal", compat="equals", join="exact"
    )
    attrs = {name: value for name, value in runs[0].attrs.items() if name != "antenna_frequency_hz"}
    if len(set(section.frequencies)) == 1 and section.frequencies[0] is not None:
        attrs["antenna_frequency_hz"] = section.frequencies[0]
    return merged.assign_attrs(attrs | {"import_notes": notes})


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
    step = None if section.distance is not None else 1.0
    band = ReasonedBand(*_widest_band(section), "all that is recorded")
    options: dict[str, Any] = {"step": step, "band": band}
    notes = []
    if step is not None:
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


def _placed(section: GprSection, channel_x: Sequence[float] | None) -> tuple[GprSection, list[str]]:
    """Return a line with the x of each channel's antennas, m, that was given, and what it replaces.

    Others than one finite number for each channel are a ValueError.
    """
    if channel_x is None:
        return section, []
    count = section.traces.shape[1]
    offsets = [float(x) for x in channel_x]
    if len(offsets) != count or not np.isfinite(offsets).all():
        raise ValueError(
            f"channel_x must give a finite x, m, for each of {count} channels, got {offsets}"
        )
    notes = []
    if section.offsets is not None:
        stated = ", ".join(f"{x:g}" for x in section.offsets[:, 0])
        notes.append(f"channel-x is given in place of the file's, {stated} m")
    return replace(section, offsets=np.column_stack([offsets, np.zeros(count)])), notes


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
    delays = [section.delay_of(channel) for channel in range(section.traces.shape[1])]
    intervals = [float(delay[1] - delay[0]) for delay in delays]
    shortest = min(interval * delay.size for interval, delay in zip(intervals, delays, strict=True))
    return max(_LOWEST, 1 / shortest), _NYQUIST_SHARE * 0.5 / max(intervals)


def _notes_of_all(runs: Sequence[xr.Dataset]) -> list[str]:
    """Return every note once, in the order in which they come.

    Those of single channels are left out: one of all channels stands for them.
    """
    notes: dict[str, None] = {}
    for run in runs:
        for note in run.attrs["import_notes"]:
            is_of_one_channel = note.startswith("channel ") and " of " in note
            if not is_of_one_channel:
                notes[note] = None
    return list(notes)


def _note_of_channels(section: GprSection) -> str:
    """Return the note of all channels and their antennas."""
    antennas = frequency_words(section.frequencies)
    count = len(section.frequencies)
    return f"all {count} channels in one run, a pair each; antennas {antennas}"
