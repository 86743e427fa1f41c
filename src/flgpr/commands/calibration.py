"""What the calibrations of stored runs share: trials, checks of the answer, and storing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.calibrate import BiasFit, ClockFit
from flgpr.clutter import subtract_mean_scan
from flgpr.commands.positions import track_of
from flgpr.model.arrays import FloatArray
from flgpr.store import save_run
from flgpr.store.files import existing
from flgpr.store.text_tables import read_text_table

PathLike = str | Path
_COLUMNS = ("x_m", "y_m", "z_m")


def searched_run(run: xr.Dataset, keep_standing: bool) -> xr.Dataset:
    """Return the run for the search, without what is the same in all scans unless that is kept.

    Parameters
    ----------
    run : xarray.Dataset
        The run.
    keep_standing : bool
        Whether what stands still in the scans is kept.

    Returns
    -------
    xarray.Dataset
        The run.

    Raises
    ------
    ValueError
        If the mean of the scans cannot be subtracted.
    """
    if keep_standing:
        return run
    try:
        return subtract_mean_scan(run.compute())
    except ValueError as error:
        raise ValueError(f"{error}: search with it, --keep-standing") from None


def refuse_doubt(fit: ClockFit | BiasFit, run: PathLike, keep_standing: bool) -> None:
    """Refuse an answer that cannot be trusted.

    Parameters
    ----------
    fit : ClockFit or BiasFit
        The answer.
    run : path
        The run, for the error.
    keep_standing : bool
        Whether what stands still was kept in the search.

    Raises
    ------
    ValueError
        If the answer is doubtful; it states why.
    """
    if not fit.doubt:
        return
    hint = ""
    if not keep_standing:
        hint = " (what stands still in the scans was left out; --keep-standing leaves it in)"
    raise ValueError(f"{run}: {fit.doubt}{hint}")


def read_reflectors(path: PathLike) -> FloatArray:
    """Read the positions of reflectors in the lane frame from a CSV.

    Parameters
    ----------
    path : path
        CSV with ``x_m``, ``y_m`` and ``z_m``.

    Returns
    -------
    (reflector, 3) ndarray of float
        Positions, m.

    Raises
    ------
    ValueError
        If columns are missing or a position is not finite.
    """
    file = existing(path, "file of reflectors")
    try:
        columns = read_text_table(file)
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None
    missing = [name for name in _COLUMNS if name not in columns]
    if missing:
        raise ValueError(
            f"{file}: must have the columns {', '.join(_COLUMNS)}; missing: {', '.join(missing)}"
        )
    sides = [np.asarray(columns[name]) for name in _COLUMNS]
    positions = np.stack(sides, axis=1)
    # A column of text tables may be complex: "2j" is a number, too.
    if np.iscomplexobj(positions) or not np.isfinite(positions).all():
        is_bad = ~np.isfinite(positions).all(axis=1) | (positions.imag != 0).any(axis=1)
        bad = int(np.argmax(is_bad))
        raise ValueError(
            f"{file}: places must be finite, got {positions[bad].tolist()} for reflector {bad + 1}"
        )
    return positions


def track_of_run(run: PathLike, track: PathLike | None, anchor: PathLike | None) -> pd.DataFrame:
    """Read the track of a run, by default NAME-track.csv beside the run.

    Parameters
    ----------
    run : path
        Run store.
    track : path or None
        The track, in place of that beside the run.
    anchor : path or None
        TOML that ties positions on the Earth to the lane.

    Returns
    -------
    pandas.DataFrame
        The track (:func:`flgpr.commands.positions.track_of`).
    """
    store = Path(run)
    path = Path(track) if track else store.with_name(f"{store.stem}-track.csv")
    return track_of(path, anchor)


def save_calibrated(run: xr.Dataset, output: PathLike, figures: dict[str, Any]) -> None:
    """Store a run with the figures of its calibration in its attributes.

    Parameters
    ----------
    run : xarray.Dataset
        The calibrated run.
    output : path
        Run store to write; an interrupted call resumes.
    figures : dict
        Entries that are added to the run's attribute ``calibration``.
    """
    earlier = run.attrs.get("calibration", {})
    calibrated = run.assign_attrs(calibration={**earlier, **figures})
    save_run(calibrated, output, resume=True)
