"""Calibration of stored runs: clock and range bias against the positions, files in, files out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.calibrate import (
    BiasFit,
    ClockFit,
    estimate_clock,
    estimate_joint,
    estimate_range_bias,
    remove_range_bias,
    with_track,
)
from flgpr.clutter import subtract_mean_scan
from flgpr.imaging import ImagingOperator
from flgpr.model import SPEED_OF_LIGHT
from flgpr.model.arrays import FloatArray
from flgpr.store import open_run, save_run
from flgpr.store.files import existing
from flgpr.store.tables import read_text_table
from flgpr.tasks.exchange import track_of

PathLike = str | Path
_LARGEST = 2_000_000  # pixels of the area that is focused for every trial
_MOST_OFFSETS = 10_000


@dataclass(frozen=True)
class ClockSearch:
    """Where a clock offset is looked for."""

    area: tuple[float, float, float, float]  #: ground that is focused, lane frame, m
    offsets: tuple[
        float, float
    ]  #: least and greatest offset of the track's clock from the radar's, s
    step: float = 0.05  #: first step, s; it is halved four times around the best
    height: float = 0.0  #: z of the area, m
    #: of the pixels, m; None takes a quarter of the shortest wavelength
    spacing: float | None = None
    rates: tuple[float, ...] = (1.0,)  #: clock rates to try


def calibrate_clock(
    run: PathLike,
    search: ClockSearch,
    track: PathLike | None = None,
    output: PathLike | None = None,
    anchor: PathLike | None = None,
    keep_standing: bool = False,
) -> ClockFit:
    """Find the clock offset at which a run focuses best, and store the run with the poses that follow.

    ``track`` is a CSV, or an NMEA log with the anchor it needs, of the array's reference point; by default
    ``NAME-track.csv`` beside the run, whose times it must cover. What stands still in the run is left out of the search
    unless ``keep_standing``; what is stored has it still. An answer not to be trusted is a ValueError with the reason.
    """
    held = open_run(run)
    way = _track_of_run(run, track, anchor)
    x_min, x_max, y_min, y_max = search.area
    spacing = search.spacing or SPEED_OF_LIGHT / float(held["frequency"].values[-1]) / 4
    if not (x_max > x_min and y_max > y_min and spacing > 0):
        raise ValueError(f"area must have x_max > x_min and y_max > y_min, got {search.area}")
    offsets = _offsets(search.offsets, search.step)
    x = np.arange(x_min, x_max + spacing / 2, spacing)
    y = np.arange(y_min, y_max + spacing / 2, spacing)
    if x.size * y.size > _LARGEST:
        raise ValueError(
            f"area must hold at most {_LARGEST:,} pixels, got {x.size} x {y.size} of {spacing:.3g} m: take a smaller "
            "one or a wider spacing"
        )
    pixels = np.stack([*np.meshgrid(x, y), np.full((y.size, x.size), search.height)], axis=-1)
    fit = estimate_clock(
        _searched(held, keep_standing), way, pixels, offsets, ImagingOperator, search.rates
    )
    _refuse(fit, run, keep_standing)
    if output is not None:
        moved = with_track(held, way, fit.offset, fit.rate)
        _save(moved, output, {"clock_offset_s": fit.offset, "clock_rate": fit.rate})
    return fit


def calibrate_range_bias(
    run: PathLike,
    reflectors: PathLike,
    output: PathLike | None = None,
    search: float | None = None,
    tolerance: float = 0.15,
    keep_standing: bool = False,
) -> BiasFit:
    """Find by how much ranges are measured too long, from reflectors at known places, and store the run without it.

    ``reflectors`` is a CSV with ``x_m``, ``y_m``, ``z_m`` in the lane frame, ``search`` how far to either side of zero
    the bias is looked for, m; for ``tolerance`` see :func:`flgpr.calibrate.estimate_joint`. The poses must have the
    right clock. What stands still in the run is left out of the search unless ``keep_standing``; what is stored has it
    still. An answer not to be trusted is a ValueError with the reason.
    """
    held = open_run(run).compute()
    places = _reflectors(reflectors)
    if search is not None and not search > 0:
        raise ValueError(f"search must be positive, got {search:g}")
    fit = estimate_range_bias(
        _searched(held, keep_standing), places, ImagingOperator, search, tolerance
    )
    _refuse(fit, run, keep_standing)
    if output is not None:
        _save(remove_range_bias(held, fit.bias), output, {"range_bias_m": fit.bias})
    return fit


def calibrate_joint(
    run: PathLike,
    reflectors: PathLike,
    offsets: tuple[float, float],
    biases: tuple[float, float],
    output: PathLike | None = None,
    track: PathLike | None = None,
    anchor: PathLike | None = None,
    step: float = 0.05,
    tolerance: float = 0.15,
    keep_standing: bool = False,
) -> BiasFit:
    """Find clock offset and range bias together, and store the run with the poses and ranges that follow.

    ``offsets`` (s) and ``biases`` (m) are least and greatest, ``step`` the offsets' first step. All else is as in
    :func:`calibrate_clock` and :func:`calibrate_range_bias`.
    """
    held = open_run(run).compute()
    places = _reflectors(reflectors)
    way = _track_of_run(run, track, anchor)
    fit = estimate_joint(
        _searched(held, keep_standing),
        places,
        ImagingOperator,
        biases,
        way,
        _offsets(offsets, step),
        tolerance,
    )
    _refuse(fit, run, keep_standing)
    if output is not None and fit.offset is not None:
        ready = remove_range_bias(with_track(held, way, fit.offset), fit.bias)
        _save(
            ready,
            output,
            {"clock_offset_s": fit.offset, "clock_rate": 1.0, "range_bias_m": fit.bias},
        )
    return fit


def _offsets(limits: tuple[float, float], step: float) -> FloatArray:
    """Offsets to try; a single one for equal limits."""
    low, high = limits
    if not (np.isfinite(limits).all() and high >= low and step > 0):
        raise ValueError(f"offsets must increase and step be positive, got {limits} and {step:g}")
    if (high - low) / step > _MOST_OFFSETS:
        raise ValueError(
            f"offsets must be at most {_MOST_OFFSETS:,}, got {low:g} to {high:g} s by {step:g} s"
        )
    return np.arange(low, high + step / 2, step)


def _searched(run: xr.Dataset, keep_standing: bool) -> xr.Dataset:
    if keep_standing:
        return run
    try:
        return subtract_mean_scan(run.compute())
    except ValueError as error:
        raise ValueError(f"{error}: search with it, --keep-standing") from None


def _refuse(fit: ClockFit | BiasFit, run: PathLike, keep_standing: bool) -> None:
    if fit.doubt:
        hint = (
            ""
            if keep_standing
            else " (what stands still in the scans was left out; --keep-standing leaves it in)"
        )
        raise ValueError(f"{run}: {fit.doubt}{hint}")


def _reflectors(path: PathLike) -> FloatArray:
    """Places (reflector, 3) in the lane frame, m, of a CSV."""
    file = existing(path, "file of reflectors")
    try:
        columns = read_text_table(file)
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None
    missing = [name for name in ("x_m", "y_m", "z_m") if name not in columns]
    if missing:
        raise ValueError(
            f"{file}: must have the columns x_m, y_m, z_m; missing: {', '.join(missing)}"
        )
    places = np.stack([np.asarray(columns[name]) for name in ("x_m", "y_m", "z_m")], axis=1)
    if np.iscomplexobj(places) or not np.isfinite(places).all():
        bad = int(np.argmax(~np.isfinite(places).all(axis=1) | (places.imag != 0).any(axis=1)))
        raise ValueError(
            f"{file}: places must be finite, got {places[bad].tolist()} for reflector {bad + 1}"
        )
    return places


def _track_of_run(run: PathLike, track: PathLike | None, anchor: PathLike | None) -> pd.DataFrame:
    store = Path(run)
    return track_of(Path(track) if track else store.with_name(f"{store.stem}-track.csv"), anchor)


def _save(run: xr.Dataset, output: PathLike, figures: dict[str, Any]) -> None:
    before = run.attrs.get("calibration", {})
    save_run(run.assign_attrs(calibration={**before, **figures}), output, resume=True)
