"""Whether the ground that a vehicle drives over is unlike the training, scan by scan.

The figures are those of ``method/unlike.py``, of the last scans: sums forget what lies more than eight
looked-at scans behind. A verdict changes once three scans in a row agree on another one.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from flgpr.clutter import Background
from flgpr.method.unlike import (
    MOST_SCANS,
    Comparison,
    TrainingGround,
    compare_clutter,
    compare_level,
    level_profile,
)
from flgpr.model import Grid
from flgpr.model.run import polarizations_of
from flgpr.stages import MapStage
from flgpr.types import AnyArray, Arrays, FloatArray

AGREEING = 3
"""Looked-at scans in a row that must agree before the verdict changes."""
_SETTLED = 8  # looked-at scans after which the background has settled, so that its level is judged


class RunningGround:
    """Compare the ground of the last scans with that of the training lanes.

    Parameters
    ----------
    ground : TrainingGround
        What the model knows; it judges.
    mapper : MapStage or None
        The map, if it measures clutter.
    grid : Grid
        The pixels that count, in the scan frame.
    columns : tuple of float
        Where the lane lies across, m.
    least_step : float
        Least distance between scans that are looked at, m.
    """

    def __init__(
        self,
        ground: TrainingGround,
        mapper: MapStage | None,
        grid: Grid,
        columns: tuple[float, float],
        least_step: float,
    ) -> None:
        self._ground = ground
        self._mapper = mapper
        self._grid = grid
        self._columns = columns
        self._apart = max(ground.apart, least_step)
        self._sums: Arrays = {}
        self._scans = 0
        self._place = np.full(2, np.nan)  # of the last scan that was looked at
        self._agreeing = 0
        self.unlike = False  #: whether confidences do not hold here
        self.comparison = Comparison()  #: the latest

    def add(
        self, image: xr.DataArray, pose: FloatArray, background: Background
    ) -> Comparison | None:
        """Look at a scan, if it lies far enough from the last one that was looked at.

        Parameters
        ----------
        image : (polarization, subband, y, x) DataArray of complex
            Cleaned, with its phase.
        pose : (6,) ndarray
            Pose of the scan.
        background : Background
            What it was cleaned by.

        Returns
        -------
        Comparison or None
            The comparison with which the verdict changes; None where it stays.
        """
        if np.hypot(*(pose[:2] - self._place)) < self._apart:
            return None
        self._place = np.array(pose[:2])
        if self._mapper is not None:
            keep = 1.0 if self._scans < MOST_SCANS else 1 - 1 / MOST_SCANS
            for name, array in self._mapper.clutter_of(image).items():
                before = self._sums.get(name, np.zeros_like(array))
                self._sums[name] = keep * before + array
        self._scans += 1
        ground = self._ground
        near = self._grid.y_min
        figures = []
        if self._scans >= _SETTLED:
            gain = background.cropped(self._grid.ny).gain
            subbands = image["subband"].values
            labels = polarizations_of(image)
            channels = [f"{label} {subband}" for label in labels for subband in subbands]
            profile = level_profile(gain, self._grid, self._columns)
            figures += compare_level(ground, profile, channels, near)
        if self._mapper is not None:
            scans = min(self._scans, MOST_SCANS)
            whitener = self._mapper.learnt["whitener"]
            figures += compare_clutter(ground, self._sums, scans, whitener, near)
        self.comparison = Comparison(tuple(figures))
        self._agreeing = self._agreeing + 1 if self.comparison.unlike != self.unlike else 0
        if self._agreeing < AGREEING:
            return None
        self._agreeing = 0
        self.unlike = not self.unlike
        return self.comparison

    def state(self) -> Arrays:
        """Return everything summed so far as plain arrays; later scans do not change them."""
        counts = [self._scans, self._agreeing, int(self.unlike)]
        return {**self._sums, "counts": np.array(counts), "place": self._place}

    def restore(self, state: Mapping[str, AnyArray]) -> None:
        """Go on from a state."""
        self._sums = {
            name: np.array(array)
            for name, array in state.items()
            if name not in ("counts", "place")
        }
        self._scans, self._agreeing, unlike = (int(count) for count in state["counts"])
        self.unlike = bool(unlike)
        self._place = np.array(state["place"])
