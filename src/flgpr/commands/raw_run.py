"""Raw data of a run for a screen: range profiles of a channel after steps of ``flgpr prepare``, spectra, health."""

from __future__ import annotations

import base64
import json
import math
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from flgpr.calibrate import channel_health, disturbed_tones, health_summary
from flgpr.commands.picture import picture_of
from flgpr.commands.preparing import Background, Step, Subtract, check_steps
from flgpr.commands.run_report import geometry_doubts
from flgpr.door import parse_json
from flgpr.formats import is_gpr, preview_run
from flgpr.imaging.view_axes import View
from flgpr.model import complete_scans
from flgpr.model.faults import first_fault
from flgpr.store import MAX_MEMORY, open_run

MOST_SCANS = 1200
MOST_BINS = 800
_MOST_STEPS = 16
_COPIES = 5  # of what is read, while a step and the transform are at work
_MOST_SUMMED = 1.2e10  # scans x tones x delays of one picture: some seconds
# scans x pairs x pixels of one image, where its pixels are ours to choose: some seconds
_UPDATES = 4e9
_PIXELS = 20_000, 200_000  # of an image, least and most
_MOST_RUNNING = 5e8  # samples that medians over a window of scans sort


class _Query(BaseModel):
    """What a page may ask for; numbers come as text."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    polarization: str
    pair: int = Field(ge=0)
    scale: Literal["db", "signed"] = "db"
    to_ns: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    scan: int = Field(default=0, ge=0)
    whole: bool = False
    permittivity: float | None = Field(default=None, ge=1, le=100)
    steps: str = Field(default="[]", max_length=4000)


class RawRun:
    """The raw data of a stored run or of a recording, asked channel by channel; one answer is worked out at a time.

    Of a run of more than 1,200 scans, or of more than ``max_memory`` bytes, every so many are taken, and a
    background is estimated from these. Every query is a mapping of texts, as an address has them: ``polarization``,
    ``pair``, ``steps`` (JSON, a list of what stands in ``[[step]]`` of a file of steps) and, for a B-scan, ``scale``
    ("db" or "signed") and ``to_ns``, for a spectrum ``scan``, for an image that and ``whole``, for the aperture of all
    scans, and ``permittivity``. One that breaks a rule is a ValueError, a store that has
    changed a RunStoreError.
    """

    def __init__(self, path: str | Path, max_memory: int = MAX_MEMORY) -> None:
        recording = Path(path).is_file() and is_gpr(Path(path))
        self._run = preview_run(path, max_memory) if recording else open_run(path, max_memory)
        self._max_memory = max_memory
        self._lock = threading.Lock()
        self._read: tuple[str, xr.Dataset] | None = None
        self._made: tuple[tuple[str, int, str], xr.Dataset] | None = None
        self._complete = complete_scans(self._run)

    def answer(self, what: str, query: Mapping[str, str]) -> dict[str, Any]:
        """Answer a query for a ``bscan``, a ``spectrum``, an ``image`` or the ``health``; see the methods' words."""
        with self._lock:
            if what == "health":
                return self.health()
            try:
                asked = _Query.model_validate(dict(query))
            except ValidationError as error:
                raise ValueError(first_fault(error, _Query)) from None
            return {"bscan": self.bscan, "spectrum": self.spectrum, "image": self.image}[what](
                asked
            )

    def bscan(self, asked: _Query) -> dict[str, Any]:
        """Work out range profiles: sums of the tones under a Hann window, which need not be even.

        ``halves`` are ``count`` delays of each scan, scan by scan: dB (the greatest amplitude in a bin), or the real
        part over ``unit``. NaN is a sweep that is missing.
        """
        made = self._channel(asked)
        signal = made["signal"].values[:, 0, 0]
        tones = made["frequency"].values
        start = min(
            float(self._run.attrs.get("first_sample_s", 0.0)), 0.0
        )  # recordings begin before their time zero
        stop, count, fold = _delays(asked, len(signal), tones, start)
        delay = start + (stop - start) * (np.arange(count * fold) + 0.5) / (count * fold)
        weight = np.hanning(tones.size + 2)[1:-1] * np.gradient(
            tones
        )  # times the share of the band of each tone
        weighted = (signal * (weight / weight.sum())).astype(np.complex64)
        values = np.empty((len(signal), count), np.float32)
        block = max(2**22 // (tones.size * fold), 1)
        for first in range(0, count, block):
            here = delay[first * fold : (first + block) * fold]
            turns = np.outer(tones, here) % 1.0
            profile = weighted @ np.exp(2j * np.pi * turns).astype(np.complex64)
            part = (
                np.abs(profile).reshape(len(signal), -1, fold).max(axis=2)
                if asked.scale == "db"
                else profile.real
            )
            values[:, first : first + block] = part
        missing = ~made["known"].values
        values[missing] = np.nan
        known = np.abs(values[~missing])
        top = float(np.percentile(known, 99.8)) if known.size else 0.0
        unit = top if top > 0 and asked.scale == "signed" else 1.0
        if asked.scale == "db":
            with np.errstate(divide="ignore"):
                values = np.maximum(20 * np.log10(values), -999.0)
        steps = self._steps(asked.steps)
        return {
            "scans": made["number"].values.tolist(),
            "delays_ns": {"start": start * 1e9, "stop": stop * 1e9, "count": count},
            "scale": asked.scale,
            "unit": unit,
            "top_db": 20 * math.log10(top) if top > 0 else None,
            "missing": np.flatnonzero(missing).tolist(),
            "incomplete": np.flatnonzero(~made["valid"].values[:, 0, 0]).tolist(),
            "halves": _halves(np.clip(values / unit, -6e4, 6e4)),
            "toml": _toml(steps),
        }

    def spectrum(self, asked: _Query) -> dict[str, Any]:
        """Tell the tones of a scan after the steps, dB, beside the median over all scans that are shown.

        ``disturbed_ghz`` are the tones that :func:`flgpr.calibrate.disturbed_tones` finds in those, before the steps.
        """
        made = self._channel(asked)
        place = self._place(asked)
        known = made["known"].values
        if "median_db" not in made:  # once for all scans of a channel: a page asks scan by scan
            level = _levels(made["signal"].values[known, 0, 0])
            recorded = self._polarization(asked.polarization)
            made["median_db"] = (
                "frequency",
                np.median(level, axis=0) if known.any() else np.full(level.shape[1], np.nan),
            )
            hit = disturbed_tones(recorded["signal"].values[known, 0, asked.pair])
            made.attrs["disturbed_ghz"] = (recorded["frequency"].values[hit] * 1e-9).tolist()
        own = _levels(made["signal"].values[place, 0, 0])
        return {
            "frequency_ghz": (made["frequency"].values * 1e-9).tolist(),
            "level_db": _numbers(own if known[place] else np.full(own.size, np.nan)),
            "median_db": _numbers(made["median_db"].values),
            "disturbed_ghz": made.attrs["disturbed_ghz"],
        }

    def image(self, asked: _Query) -> dict[str, Any]:
        """Focus a scan, or all that are shown, after the steps, as :func:`flgpr.commands.picture.make_picture` does.

        ``halves`` are dB, row by row along the axis ``up``; each axis has a name, its first and last pixel's place (m)
        and how many there are.
        """
        made = self._stepped(asked, {} if asked.whole else {"scan": [self._place(asked)]})
        if not complete_scans(made).any():
            raise ValueError(f"scan must be one without missing sweeps, got {asked.scan}")
        if not asked.whole and made.attrs.get("sounding") == "ground-coupled":
            raise ValueError(
                "whole must be true for antennas on the ground: one scan has no section, all of them do"
            )
        pixels = int(np.clip(_UPDATES / (made.sizes["scan"] * made.sizes["pair"]), *_PIXELS))
        picture = picture_of(made, View(permittivity=asked.permittivity), pixels=pixels)
        flat = picture.image[0].squeeze()
        level = 20 * np.log10(np.maximum(np.abs(flat.values), 1e-30))
        up, across = (
            [str(name), float(flat[name][0]), float(flat[name][-1]), flat.sizes[name]]
            for name in flat.dims
        )
        return {
            "across": across,
            "up": up,
            "fixed": {
                name: float(picture.image[name][0])
                for name in "xyz"
                if name not in (up[0], across[0])
            },
            "scans": picture.scans,
            "top_db": float(level.max()),
            "halves": _halves(np.clip(level, -6e4, 6e4)),
            "peaks": picture.peaks[["x", "y", "z", "level"]].to_dict("records"),
            "toml": _toml(self._steps(asked.steps)),
        }

    def health(self) -> dict[str, Any]:
        """Tell of every channel what ``flgpr info`` looks at, of as many scans as fit, and what it would warn of."""
        every = self._stride(self._run["signal"].nbytes)
        table = channel_health(self._run.isel(scan=slice(None, None, every)).compute())
        table["missing"] = (~self._run["valid"].values).sum(axis=0).ravel()
        columns = {
            name: table[name].tolist() for name in ("polarization", "pair", "missing", "dead")
        }
        measured = ("level_db", "coherence", "gain_drift_db", "phase_drift_rad")
        return {
            "summary": health_summary(table) + geometry_doubts(self._run),
            "every": every,
            "channels": columns
            | {name: _numbers(table[name].to_numpy(float)) for name in measured},
        }

    def _stride(self, size: int) -> int:
        """Tell every how many scans to take of those that hold so many bytes."""
        scans = self._run.sizes["scan"]
        room = max(int(self._max_memory * scans / (_COPIES * size)), 1)
        return math.ceil(scans / min(room, MOST_SCANS))

    def _steps(self, text: str) -> list[Step]:
        try:
            entries = parse_json(text)
        except ValueError:
            entries = None
        if not isinstance(entries, list) or not all(isinstance(one, dict) for one in entries):
            raise ValueError("steps must be a JSON list of steps")
        if len(entries) > _MOST_STEPS:
            raise ValueError(f"steps must be at most {_MOST_STEPS}, got {len(entries)}")
        steps = check_steps(entries)
        if any(isinstance(step, Subtract) for step in steps):
            raise ValueError("steps may not subtract another run: a page may name no files")
        return steps

    def _place(self, asked: _Query) -> int:
        [places] = np.nonzero(self._polarization(asked.polarization)["number"].values == asked.scan)
        if not places.size:
            raise ValueError(
                f"scan must be one of those shown, of {self._run.sizes['scan']}, got {asked.scan}"
            )
        return int(places[0])

    def _channel(self, asked: _Query) -> xr.Dataset:
        """Take a channel through the steps; the last one is kept.

        A background is fitted to all pairs of a polarization, so that then they all go through the steps. ``valid``
        tells complete scans, as the steps take them; ``known`` which sweeps of the channel are there.
        """
        key = (asked.polarization, asked.pair, asked.steps)
        if self._made is not None and self._made[0] == key:
            return self._made[1]
        if asked.pair >= self._run.sizes["pair"]:
            raise ValueError(f"pair must be less than {self._run.sizes['pair']}, got {asked.pair}")
        made = self._stepped(asked, {"pair": [asked.pair]})
        made["known"] = ("scan", self._known(asked))
        self._made = key, made
        return made

    def _stepped(self, asked: _Query, part: dict[str, list[int]]) -> xr.Dataset:
        """Take a polarization through the steps and give a part of it: that alone, but where a background needs all."""
        steps = self._steps(asked.steps)
        made = self._polarization(asked.polarization)
        together = any(isinstance(step, Background) for step in steps)
        if not together:
            made = made.isel(part)
        for number, step in enumerate(steps, 1):
            if (
                isinstance(step, Background)
                and step.scans
                and step.scans * made["signal"].size > _MOST_RUNNING
            ):
                raise ValueError(
                    f"step {number}, background: {step.scans} scans take too long here, use flgpr prepare"
                )
            try:
                made = step.apply(made)
            except ValueError as error:
                raise ValueError(f"step {number}, {step.do}: {error}") from None
        return made.isel(part) if together else made

    def _known(self, asked: _Query) -> NDArray[np.bool_]:
        here = self._run["valid"].sel(polarization=asked.polarization).values[:, asked.pair]
        return np.asarray(here[self._polarization(asked.polarization)["number"].values])

    def _polarization(self, label: str) -> xr.Dataset:
        """Read the scans that are shown of a polarization, all pairs; the last one is kept."""
        labels = [str(one) for one in self._run["polarization"].values]
        if label not in labels:
            raise ValueError(f"polarization must be one of {', '.join(labels)}, got {label!r}")
        if self._read is None or self._read[0] != label:
            self._read = self._made = None  # before others are read
            every = self._stride(self._run["signal"].nbytes // self._run.sizes["polarization"])
            number = np.arange(0, self._run.sizes["scan"], every)
            where = labels.index(label)
            run = self._run.isel(scan=slice(None, None, every), polarization=[where]).compute()
            valid = np.broadcast_to(self._complete[number][:, None, None], run["valid"].shape)
            run = run.assign(valid=(run["valid"].dims, valid), number=("scan", number))
            self._read = label, run
        return self._read[1]


def _delays(
    asked: _Query, scans: int, tones: NDArray[np.float64], start: float
) -> tuple[float, int, int]:
    """Tell the last delay (s), how many bins there are from ``start`` (s), and how many delays are summed for each."""
    width = float(np.ptp(tones))
    if not width > 0:
        raise ValueError("a B-scan needs at least two tones")
    rate = 4 * width if asked.scale == "db" else 4 * float(tones[-1])
    most = (
        MOST_BINS / rate if asked.scale == "signed" else _MOST_SUMMED / (scans * tones.size * rate)
    )
    unambiguous = 1 / float(np.median(np.diff(tones)))
    last = start + min(unambiguous, most)
    stop = last if asked.to_ns is None else asked.to_ns * 1e-9
    span = stop - start
    if stop > last + 1e-9 * span:
        why = (
            "the tones' unambiguous delay"
            if unambiguous < most
            else f"what {asked.scale} pictures of this run hold"
        )
        raise ValueError(f"to_ns must be at most {last * 1e9:.4g}, {why}, got {asked.to_ns:g}")
    if span * width < 1:
        raise ValueError(
            f"to_ns must be at least {(start + 1 / width) * 1e9:.3g}, what the band resolves, got {stop * 1e9:g}"
        )
    if asked.scale == "signed":
        return stop, MOST_BINS, 1
    return stop, MOST_BINS, max(math.ceil(span * rate / MOST_BINS), 1)


def _levels(signal: NDArray[np.complexfloating]) -> NDArray[np.float64]:
    """Levels, dB, not below -999."""
    with np.errstate(divide="ignore"):
        return np.maximum(20 * np.log10(np.abs(signal).astype(np.float64)), -999.0)


def _halves(values: NDArray[np.floating]) -> str:
    return base64.b64encode(np.ascontiguousarray(values, "<f2").tobytes()).decode()


def _numbers(values: NDArray[np.float64]) -> list[float | None]:
    return [round(float(one), 4) if np.isfinite(one) else None for one in values]


def _toml(steps: list[Step]) -> str:
    """Write steps as ``flgpr prepare --steps`` reads them."""
    tables = [
        step.model_dump(exclude_none=True, exclude_defaults=True) | {"do": step.do}
        for step in steps
    ]
    lines = [
        [f"{name} = {json.dumps(value)}" for name, value in sorted(one.items())] for one in tables
    ]
    return "\n".join("\n".join(["[[step]]", *one]) + "\n" for one in lines)
