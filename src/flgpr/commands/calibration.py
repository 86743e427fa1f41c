"""What the calibrations of stored runs share: trials, checks of the answer, and storing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.calibrate import BiasFit, ClockFit, PoseFit, remove_range_bias, with_track
from flgpr.clutter import subtract_mean_scan
from flgpr.commands.positions import track_of
from flgpr.model.faults import faults_of
from flgpr.store import open_run, save_run
from flgpr.store.files import existing
from flgpr.store.text_tables import read_text_table
from flgpr.types import FloatArray, PathLike

_COLUMNS = ("x_m", "y_m", "z_m")


class Calibration:
    """A stored run that is to be calibrated.

    Parameters
    ----------
    path : path
        Run store.
    keep_standing : bool
        Whether the search is with what is the same in all scans.
    """

    def __init__(self, path: PathLike, keep_standing: bool) -> None:
        self._path = Path(path)
        self._keep_standing = keep_standing
        self.run = open_run(path)

    @property
    def searched(self) -> xr.Dataset:
        """The run for the search; a ValueError if the mean of the scans cannot be subtracted."""
        if self._keep_standing:
            return self.run
        try:
            return subtract_mean_scan(self.run.compute())
        except ValueError as error:
            raise ValueError(f"{error}: search with it, keep_standing") from None

    def track(self, track: PathLike | None, anchor: PathLike | None) -> pd.DataFrame:
        """Read a track, by default NAME-track.csv beside the run.

        It is that of :func:`flgpr.commands.positions.track_of`.
        """
        beside = self._path.with_name(f"{self._path.stem}-track.csv")
        return track_of(Path(track) if track else beside, anchor)

    def finish(
        self,
        fit: ClockFit | BiasFit | PoseFit,
        output: PathLike | None,
        track: pd.DataFrame | None = None,
    ) -> None:
        """Refuse an answer that cannot be trusted, and store the calibrated run.

        Its attribute ``calibration`` has the figures of the answer in addition; a range bias is added
        to the one that was removed before. An interrupted call resumes.

        Parameters
        ----------
        fit : ClockFit, BiasFit or PoseFit
            The answer.
        output : path or None
            Run store to write.
        track : pandas.DataFrame, optional
            The track, where its clock was estimated.

        Raises
        ------
        ValueError
            If the answer is doubtful; it states why.
        """
        if fit.doubt:
            hint = ""
            if not self._keep_standing:
                hint = (
                    " (what stands still in the scans was left out; --keep-standing leaves it in)"
                )
            raise ValueError(f"{self._path}: {fit.doubt}{hint}")
        if output is None:
            return
        # The search was without the standing part; the stored run has all of the data.
        run = self.run
        figures = dict(run.attrs.get("calibration", {}))
        if isinstance(fit, PoseFit):
            run = run.assign(pose=(run["pose"].dims, fit.pose))
            figures |= {"pose_error_before_m": fit.before, "pose_error_m": fit.after}
        elif track is not None and fit.offset is not None:
            rate = fit.rate if isinstance(fit, ClockFit) else 1.0
            run = with_track(run, track, fit.offset, rate)
            figures |= {"clock_offset_s": fit.offset, "clock_rate": rate}
        if isinstance(fit, BiasFit):
            run = remove_range_bias(run, fit.bias)
            figures["range_bias_m"] = fit.bias + float(figures.get("range_bias_m", 0.0))
        save_run(run.assign_attrs(calibration=figures), output, resume=True, share_files=True)


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
    with faults_of(file):
        columns = read_text_table(file)
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
