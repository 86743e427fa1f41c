"""Raw data of a run as the viewer's pages ask for them: B-scans, spectra, images and health.

What is computed has its home below (:mod:`flgpr.imaging.range_profiles`,
:mod:`flgpr.health.channels`, :mod:`flgpr.imaging.focus`); here queries are checked and bounded.
"""

from __future__ import annotations

import base64
import math
import threading
from collections.abc import Callable, Iterator, Mapping
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from flgpr.commands.picture import Picture, picture_of
from flgpr.commands.preparing import (
    RemoveBackground,
    Step,
    Subtract,
    TimeZero,
    apply_steps,
    check_steps,
)
from flgpr.commands.run_report import geometry_doubts
from flgpr.formats.reader import is_recording, recording_reader
from flgpr.health.channels import channel_health, disturbed_tones, health_summary
from flgpr.health.of_run import health_of_run
from flgpr.imaging.range_profiles import DelayBins, levels, range_profiles
from flgpr.imaging.view_axes import View
from flgpr.json_text import parse_json
from flgpr.model import SPEED_OF_LIGHT, complete_scans
from flgpr.model.faults import first_fault
from flgpr.store import MAX_MEMORY, open_run
from flgpr.store.journal import read_limits
from flgpr.toml_text import toml_lines
from flgpr.types import Entries, FloatArray

MOST_SCANS = 1200
MOST_BINS = 800
_MOST_STEPS = 16
_COPIES = 5  # of what is read, while a step and the transform are at work
_MOST_SUMMED = 1.2e10  # scans x tones x delays of one picture: some seconds
# scans x pairs x pixels of one image, where the number of pixels is free: some seconds
_UPDATES = 4e9
_PIXELS = 20_000, 200_000  # of an image, least and most
_MOST_RUNNING = 5e8  # samples that medians over a window of scans sort
_TOP_PERCENTILE = 99.8  # of the amplitudes, at which a colour scale ends
_LARGEST_LENGTH = 1e6  # m, of what a store may state of its simulation
_LARGEST_HALF = 6e4  # somewhat less than the largest 16-bit float


_LARGEST = 2**53  # number of a scan or a pair, up to which every reader of JSON holds them exactly


class _Query(BaseModel):
    """What a page may ask for; numbers come as text."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    polarization: str
    pair: int = Field(ge=0, le=_LARGEST)
    scale: Literal["db", "signed"] = "db"
    to_ns: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    scan: int = Field(default=0, ge=0, le=_LARGEST)
    whole: bool = False
    permittivity: float | None = Field(default=None, ge=1, le=100)
    steps: str = Field(default="[]", max_length=4000)


class RawRun:
    """The raw data of a stored run or a recording; one answer is computed at a time.

    Of a run of more than 1,200 scans, or of more than ``max_memory`` bytes, every n-th scan is
    taken, and a background is estimated from these.

    Every query is a mapping of texts, as a web address has them:

    - ``polarization`` and ``pair``;
    - ``steps``: JSON, a list of entries of ``[[step]]`` in a file of steps;
    - for a B-scan ``scale`` ("db" or "signed") and ``to_ns``;
    - for a spectrum ``scan``;
    - for an image ``scan``, or ``whole`` for the aperture of all scans, and ``permittivity``.

    Parameters
    ----------
    path : path
        Run store or recording.
    max_memory : int
        Memory that an answer may take, bytes.

    Raises
    ------
    ValueError
        If a query breaks a rule.
    RunStoreError
        If the store has changed.
    """

    def __init__(self, path: str | Path, max_memory: int = MAX_MEMORY) -> None:
        if is_recording(path):
            self._run = recording_reader(path).preview(Path(path), max_memory)
            self._limits: Mapping[str, Any] = {}
        else:
            self._run = open_run(path, max_memory)
            self._limits = read_limits(path)
        self._max_memory = max_memory
        self._lock = threading.Lock()
        self._last_polarization: tuple[str, xr.Dataset] | None = None
        self._last_channel: tuple[tuple[str, int, str], xr.Dataset] | None = None
        self._complete = complete_scans(self._run)

    def answer(self, what: str, query: Mapping[str, str]) -> Entries:
        """Answer a query for a ``bscan``, a ``spectrum``, an ``image`` or the ``health``."""
        answers: dict[str, Callable[[_Query], Entries]] = {
            "bscan": self.bscan,
            "spectrum": self.spectrum,
            "image": self.image,
        }
        with self._lock:
            if what == "health":
                return self.health()
            try:
                parsed = _Query.model_validate(dict(query))
            except ValidationError as error:
                raise ValueError(first_fault(error, _Query)) from None
            return answers[what](parsed)

    def bscan(self, query: _Query) -> Entries:
        """Compute range profiles of a channel after the steps.

        ``halves`` are ``count`` bins of each scan, scan by scan: dB of the largest amplitude in a
        bin, or the real part over ``unit``. NaN is a sweep that is missing. ``ends`` are the delays
        at which simulated echoes end for this pair, and what ends there.
        """
        channel = self._channel(query)
        signal = channel["signal"].values[:, 0, 0]
        frequency = channel["frequency"].values
        # Recordings begin before their time zero.
        first_sample = float(self._run.attrs.get("first_sample_s", 0.0))
        start = min(first_sample, 0.0)
        bins = _delay_bins(query, len(signal), frequency, start)

        values = range_profiles(signal, frequency, bins, amplitude=query.scale == "db")
        is_missing = ~channel["known"].values
        values[is_missing] = np.nan

        amplitudes = np.abs(values[~is_missing])
        top = 0.0
        if amplitudes.size:
            top = float(np.percentile(amplitudes, _TOP_PERCENTILE))

        unit = 1.0
        if query.scale == "db":
            values = np.asarray(levels(values))
        elif top > 0:
            unit = top
        return {
            "scans": channel["number"].values.tolist(),
            "delays_ns": {
                "start": bins.start * 1e9,
                "stop": bins.stop * 1e9,
                "count": bins.count,
            },
            "scale": query.scale,
            "unit": unit,
            "top_db": 20 * math.log10(top) if top > 0 else None,
            "missing": np.flatnonzero(is_missing).tolist(),
            "incomplete": np.flatnonzero(~channel["valid"].values[:, 0, 0]).tolist(),
            "ends": self._simulated_ends(query, bins),
            "halves": _halves(values / unit),
            "toml": _toml(self._steps(query.steps)),
        }

    def _simulated_ends(self, query: _Query, bins: DelayBins) -> list[Entries]:
        """Return where simulated echoes end in a B-scan: ``delay_ns``, and in ``words`` what ends.

        Beyond the last of them a simulated sweep holds noise alone, so that its level steps down;
        that of a radar fades. A run that does not state its limits, such as a measured one, has
        none.
        """
        shift = 0.0  # s, by which steps put time zero later
        for step in self._steps(query.steps):
            if isinstance(step, TimeZero):
                shift += step.delay_ns * 1e-9
        tx = self._run["tx_position"].values[query.pair]
        rx = self._run["rx_position"].values[query.pair]
        height = float(np.median(self._run["pose"].values[:, 2]))
        ends = []
        for path, reason in _simulated_paths(self._limits, tx, rx, height):
            delay = path / SPEED_OF_LIGHT - shift
            if bins.start < delay < bins.stop:
                ends.append({"delay_ns": round(delay * 1e9, 2), "words": reason})
        return ends

    def spectrum(self, query: _Query) -> Entries:
        """Return the levels of a scan's tones after the steps, dB, and the median over all scans.

        ``disturbed_ghz`` are the tones that :func:`flgpr.calibrate.disturbed_tones` finds before
        the steps.
        """
        channel = self._channel(query)
        index = self._scan_index(query)
        if "median_db" not in channel:  # once for all scans of a channel: pages ask scan by scan
            self._add_median(channel, query)
        signal = channel["signal"].values[index, 0, 0]
        level = _tone_levels(signal)
        if not channel["known"].values[index]:
            level = np.full(level.size, np.nan)
        return {
            "frequency_ghz": (channel["frequency"].values * 1e-9).tolist(),
            "level_db": _numbers(level),
            "median_db": _numbers(channel["median_db"].values),
            "disturbed_ghz": channel.attrs["disturbed_ghz"],
        }

    def _add_median(self, channel: xr.Dataset, query: _Query) -> None:
        """Add the median level of every tone over the scans, and the disturbed tones."""
        is_known = channel["known"].values
        level = _tone_levels(channel["signal"].values[is_known, 0, 0])
        median = np.full(level.shape[1], np.nan)
        if is_known.any():
            median = np.median(level, axis=0)
        channel["median_db"] = ("frequency", median)

        recorded = self._polarization(query.polarization)
        is_disturbed = disturbed_tones(recorded["signal"].values[is_known, 0, query.pair])
        disturbed = recorded["frequency"].values[is_disturbed] * 1e-9
        channel.attrs["disturbed_ghz"] = disturbed.tolist()

    def image(self, query: _Query) -> Entries:
        """Focus a scan, or all that are shown, after the steps, as ``flgpr image`` does.

        ``halves`` are dB, row by row along the axis ``up``; each axis has a name, the positions of
        its first and last pixel (m) and their number.
        """
        chosen = {} if query.whole else {"scan": [self._scan_index(query)]}
        run = self._processed(query, chosen)
        if not complete_scans(run).any():
            raise ValueError(f"scan must be one without missing sweeps, got {query.scan}")
        if not query.whole and run.attrs.get("sounding") == "ground-coupled":
            raise ValueError(
                "whole must be true for antennas on the ground: one scan has no section, "
                "all of them do"
            )

        sweeps = run.sizes["scan"] * run.sizes["pair"]
        pixels = int(np.clip(_UPDATES / sweeps, *_PIXELS))
        view = View(permittivity=query.permittivity)
        picture = picture_of(run, view, pixels=pixels)
        return _image_answer(picture) | {"toml": _toml(self._steps(query.steps))}

    def health(self) -> Entries:
        """Return the health of every channel as ``flgpr info`` judges it, with its warnings."""
        stride = self._stride(self._run["signal"].nbytes)
        every_nth = self._run.isel(scan=slice(None, None, stride))
        table = channel_health(every_nth.compute())
        is_missing = ~self._run["valid"].values  # of all scans: it takes no memory
        table["missing"] = is_missing.sum(axis=0).ravel()

        channels: dict[str, list[Any]] = {}
        for name in ("polarization", "pair", "missing", "dead"):
            channels[name] = table[name].tolist()
        for name in ("level_db", "coherence", "gain_drift_db", "phase_drift_rad"):
            channels[name] = _numbers(table[name].to_numpy(float))
        faults = [finding.sentence for finding in health_of_run(self._run).findings]
        return {
            "summary": health_summary(table) + faults + geometry_doubts(self._run),
            "every": stride,
            "channels": channels,
        }

    def _stride(self, size: int) -> int:
        """Return every how many scans are taken, of a run whose scans hold so many bytes."""
        scans = self._run.sizes["scan"]
        most_by_memory = max(int(self._max_memory * scans / (_COPIES * size)), 1)
        most = min(most_by_memory, MOST_SCANS)
        return math.ceil(scans / most)

    def _steps(self, text: str) -> list[Step]:
        """Parse the steps of a query; one that would read another file is a ValueError."""
        try:
            entries = parse_json(text)
        except ValueError:
            entries = None
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            raise ValueError("steps must be a JSON list of steps")
        if len(entries) > _MOST_STEPS:
            raise ValueError(f"steps must be at most {_MOST_STEPS}, got {len(entries)}")
        steps = check_steps(entries)
        if any(isinstance(step, Subtract) for step in steps):
            raise ValueError("steps may not subtract another run: a page may name no files")
        return steps

    def _scan_index(self, query: _Query) -> int:
        """Return where the scan of a query is among those that are shown."""
        numbers = self._polarization(query.polarization)["number"].values
        indices = np.flatnonzero(numbers == query.scan)
        if not indices.size:
            count = self._run.sizes["scan"]
            raise ValueError(f"scan must be one of those shown, of {count}, got {query.scan}")
        return int(indices[0])

    def _channel(self, query: _Query) -> xr.Dataset:
        """Return a channel after the steps; the last one is cached.

        ``valid`` marks complete scans, as the steps take them; ``known`` marks the sweeps of the
        channel that are there.
        """
        key = (query.polarization, query.pair, query.steps)
        if self._last_channel is not None and self._last_channel[0] == key:
            return self._last_channel[1]
        pairs = self._run.sizes["pair"]
        if query.pair >= pairs:
            raise ValueError(f"pair must be less than {pairs}, got {query.pair}")

        channel = self._processed(query, {"pair": [query.pair]})
        valid = self._run["valid"].sel(polarization=query.polarization).values[:, query.pair]
        shown = self._polarization(query.polarization)["number"].values
        channel["known"] = ("scan", valid[shown])
        self._last_channel = key, channel
        return channel

    def _processed(self, query: _Query, chosen: dict[str, list[int]]) -> xr.Dataset:
        """Return chosen channels or scans of a polarization after the steps.

        A background is fitted to all pairs and scans: then all of them take the steps.
        """
        steps = self._steps(query.steps)
        run = self._polarization(query.polarization)

        needs_all = any(isinstance(step, RemoveBackground) for step in steps)
        if not needs_all:
            run = run.isel(chosen)
        run = apply_steps(run, steps, _check_effort)
        return run.isel(chosen) if needs_all else run

    def _polarization(self, label: str) -> xr.Dataset:
        """Read the scans that are shown of a polarization, all pairs; the last one is cached."""
        labels = [str(value) for value in self._run["polarization"].values]
        if label not in labels:
            raise ValueError(f"polarization must be one of {', '.join(labels)}, got {label!r}")
        if self._last_polarization is not None and self._last_polarization[0] == label:
            return self._last_polarization[1]
        # Memory is freed before other data are read.
        self._last_polarization = None
        self._last_channel = None

        stride = self._stride(self._run["signal"].nbytes // len(labels))
        number = np.arange(0, self._run.sizes["scan"], stride)
        index = labels.index(label)
        shown = slice(None, None, stride)
        run = self._run.isel(scan=shown, polarization=[index]).compute()

        is_complete = self._complete[number][:, None, None]
        valid = np.broadcast_to(is_complete, run["valid"].shape)
        run = run.assign(valid=(run["valid"].dims, valid), number=("scan", number))
        self._last_polarization = label, run
        return run


def _check_effort(step: Step, run: xr.Dataset) -> None:
    """Refuse a step that keeps a page waiting: a background over scans around each."""
    if (
        isinstance(step, RemoveBackground)
        and (step.scans or 0) * run["signal"].size > _MOST_RUNNING
    ):
        raise ValueError(f"{step.scans} scans take too long here, use flgpr prepare")


def _delay_bins(query: _Query, scans: int, frequency: FloatArray, start: float) -> DelayBins:
    """Return the bins of a B-scan from a delay (s) on.

    They end at the tones' unambiguous delay, or where a picture would take too long or its pixels
    would be too coarse for the carrier.
    """
    band = float(np.ptp(frequency))
    if not band > 0:
        raise ValueError("a B-scan needs at least two tones")
    if query.scale == "db":
        rate = 4 * band
        longest = _MOST_SUMMED / (scans * frequency.size * rate)
    else:
        rate = 4 * float(frequency[-1])
        longest = MOST_BINS / rate

    unambiguous = 1 / float(np.median(np.diff(frequency)))
    last = start + min(unambiguous, longest)
    stop = last if query.to_ns is None else query.to_ns * 1e-9

    span = stop - start
    if stop > last + 1e-9 * span:
        reason = f"what {query.scale} pictures of this run hold"
        if unambiguous < longest:
            reason = "the tones' unambiguous delay"
        raise ValueError(f"to_ns must be at most {last * 1e9:.4g}, {reason}, got {query.to_ns:g}")
    if span * band < 1:
        raise ValueError(
            f"to_ns must be at least {(start + 1 / band) * 1e9:.3g}, what the band resolves, "
            f"got {stop * 1e9:g}"
        )

    sums_per_bin = 1
    if query.scale == "db":
        sums_per_bin = max(math.ceil(span * rate / MOST_BINS), 1)
    return DelayBins(start, stop, MOST_BINS, sums_per_bin)


def _simulated_paths(
    limits: Mapping[str, Any], tx: FloatArray, rx: FloatArray, height: float
) -> Iterator[tuple[float, str]]:
    """Yield the paths (m) at which a pair's simulated echoes end, and in words what ends.

    ``limits`` are those of :meth:`flgpr.simulate.Simulator.limits`, from a store that anybody may
    have written; ``height`` is that of the array over the mean ground, m.
    """
    footprint = _numbers_of(limits.get("footprint_m"), 4)
    if footprint:
        x_min, x_max, y_min, y_max = footprint
        sides = product((x_min, x_max), (y_min, y_max))
        corners = np.array([(x, y, -height) for x, y in sides])
        from_tx = np.linalg.norm(corners - tx, axis=1)
        to_rx = np.linalg.norm(corners - rx, axis=1)
        longest = float((from_tx + to_rx).max())
        yield longest, f"the simulated ground ends, {y_max:g} m ahead of the array"
    for own_path in _numbers_of([limits.get("own_echoes_path_m")], 1):
        yield own_path, "the simulated echoes of the vehicle itself end; beyond is noise"


def _numbers_of(values: Any, count: int) -> list[float]:
    """Return a list of so many lengths from a value of JSON; empty where it is none."""
    if not isinstance(values, list) or len(values) != count:
        return []
    numbers = []
    for value in values:
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not (is_number and abs(value) < _LARGEST_LENGTH):
            return []
        numbers.append(float(value))
    return numbers


def _tone_levels(signal: NDArray[np.complexfloating]) -> FloatArray:
    """Return the levels of tones, dB."""
    return np.asarray(levels(np.abs(signal).astype(np.float64)))


def _image_answer(picture: Picture) -> Entries:
    """Return an image, its axes and its brightest points, for a page."""
    flat = picture.image[0].squeeze()
    level = levels(flat.values)
    axes = []
    for name in flat.dims:
        positions = flat[name]
        axes.append([str(name), float(positions[0]), float(positions[-1]), flat.sizes[name]])

    up, across = axes
    fixed = {}
    for name in "xyz":
        if name not in (up[0], across[0]):
            fixed[name] = float(picture.image[name][0])
    return {
        "across": across,
        "up": up,
        "fixed": fixed,
        "scans": picture.scans,
        "top_db": float(level.max()),
        "halves": _halves(level),
        "peaks": picture.peaks[["x", "y", "z", "level"]].to_dict("records"),
    }


def _halves(values: NDArray[np.floating]) -> str:
    """Return values as 16-bit floats in base 64, those that are too large clipped."""
    clipped = np.clip(values, -_LARGEST_HALF, _LARGEST_HALF)
    halves = np.ascontiguousarray(clipped, "<f2")
    return base64.b64encode(halves.tobytes()).decode()


def _numbers(values: FloatArray) -> list[float | None]:
    """Return values for JSON; what is not finite is None."""
    numbers: list[float | None] = []
    for value in values:
        numbers.append(round(float(value), 4) if np.isfinite(value) else None)
    return numbers


def _toml(steps: list[Step]) -> str:
    """Write steps as ``flgpr prepare --steps`` reads them."""
    tables = []
    for step in steps:
        entries = step.model_dump(exclude_none=True, exclude_defaults=True)
        entries["do"] = step.do  # a default, which is left out
        lines = ["[[step]]", *toml_lines(dict(sorted(entries.items())), {})]
        tables.append("\n".join(lines) + "\n")
    return "\n".join(tables)
