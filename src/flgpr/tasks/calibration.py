"""Calibration of stored runs: clock and range bias against the positions, files in, files out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from flgpr.calibrate import BiasFit, ClockFit, estimate_clock, estimate_range_bias, remove_range_bias, with_track
from flgpr.imaging import ImagingOperator
from flgpr.io import open_run, save_run
from flgpr.io.files import check_new, existing
from flgpr.io.textarrays import read_text_table
from flgpr.model import SPEED_OF_LIGHT
from flgpr.tasks.exchange import track_of

PathLike = str | Path
_LARGEST = 2_000_000  # pixels of the area that is focused for every trial


@dataclass(frozen=True)
class ClockSearch:
    """Where a clock offset is looked for."""

    area: tuple[float, float, float, float]  #: ground that is focused, lane frame, m
    offsets: tuple[float, float]  #: least and greatest offset of the track's clock from the radar's, s
    step: float = 0.05  #: first step, s; it is halved four times around the best
    height: float = 0.0  #: z of the area, m
    spacing: float | None = None  #: of the pixels, m; None takes a quarter of the shortest wavelength
    rates: tuple[float, ...] = (1.0,)  #: clock rates to try


def calibrate_clock(
    run: PathLike,
    search: ClockSearch,
    track: PathLike | None = None,
    output: PathLike | None = None,
    anchor: PathLike | None = None,
) -> ClockFit:
    """Find the clock offset at which a run focuses best, and store the run with the poses that follow.

    ``track`` is a CSV, or an NMEA log with the anchor it needs, of the array's reference point; by default
    ``NAME-track.csv`` beside the run, whose times it must cover.
    """
    store = Path(run)
    check_new(output)
    held = open_run(store)
    way = track_of(Path(track) if track else store.with_name(f"{store.stem}-track.csv"), anchor)
    x_min, x_max, y_min, y_max = search.area
    spacing = search.spacing or SPEED_OF_LIGHT / float(held["frequency"].values[-1]) / 4
    low, high = search.offsets
    if not (x_max > x_min and y_max > y_min and spacing > 0):
        raise ValueError(f"area must have x_max > x_min and y_max > y_min, got {search.area}")
    if not (high >= low and search.step > 0):
        raise ValueError(f"offsets must increase and step be positive, got {search.offsets} and {search.step:g}")
    x, y = np.arange(x_min, x_max + spacing / 2, spacing), np.arange(y_min, y_max + spacing / 2, spacing)
    if x.size * y.size > _LARGEST:
        raise ValueError(
            f"area must hold at most {_LARGEST:,} pixels, got {x.size} x {y.size} of {spacing:.3g} m: take a smaller "
            "one or a wider spacing"
        )
    pixels = np.stack([*np.meshgrid(x, y), np.full((y.size, x.size), search.height)], axis=-1)
    offsets = np.arange(low, high + search.step / 2, search.step)
    fit = estimate_clock(held, way, pixels, offsets, ImagingOperator, search.rates)
    if output is not None:
        moved = with_track(held, way, fit.offset, fit.rate)
        _save(moved, output, {"clock_offset_s": fit.offset, "clock_rate": fit.rate})
    return fit


def calibrate_range_bias(
    run: PathLike, reflectors: PathLike, output: PathLike | None = None, search: float = 0.6
) -> BiasFit:
    """Find by how much ranges are measured too long, from reflectors at known places, and store the run without it.

    ``reflectors`` is a CSV with ``x_m``, ``y_m``, ``z_m`` in the lane frame, ``search`` how far from one its echo is
    looked for, m. The poses must have the right clock.
    """
    check_new(output)
    held = open_run(run).compute()
    path = existing(reflectors, "file of reflectors")
    columns = read_text_table(path)
    missing = [name for name in ("x_m", "y_m", "z_m") if name not in columns]
    if missing:
        raise ValueError(f"{path}: must have the columns x_m, y_m, z_m; missing: {', '.join(missing)}")
    places = np.stack([np.asarray(columns[name], dtype=np.float64) for name in ("x_m", "y_m", "z_m")], axis=1)
    if not np.isfinite(places).all():
        raise ValueError(f"{path}: places must be finite, got {places[~np.isfinite(places).all(axis=1)][0].tolist()}")
    if not search > 0:
        raise ValueError(f"search must be positive, got {search:g}")
    fit = estimate_range_bias(held, places, ImagingOperator, search)
    if output is not None:
        _save(remove_range_bias(held, fit.bias), output, {"range_bias_m": fit.bias})
    return fit


def _save(run: xr.Dataset, output: PathLike, figures: dict[str, Any]) -> None:
    before = run.attrs.get("calibration", {})
    save_run(run.assign_attrs(calibration={**before, **figures}), output)
