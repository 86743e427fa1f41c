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
from flgpr.types import Entries
from flgpr_exchange.gpr.files import read_gpr
from flgpr_exchange.gpr.line_run import (
    ReasonedBand,
    antennas_band,
    frequency_words,
    gpr_run,
    recorded_band,
)


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
    tones = runs[0]["frequency"].values
    for channel, run in enumerate(runs):
        if not np.array_equal(run["frequency"].values, tones):
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
