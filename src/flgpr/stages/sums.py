"""What a feature stage gathers of alarms, scan by scan."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Protocol

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.model import ground_points, lane_to_scan
from flgpr.types import AnyArray, Arrays, floats

if TYPE_CHECKING:
    from flgpr.stages import FeatureStage


class AlarmGatherer(Protocol):
    """Gathers columns of alarms from the images of one scan after the other."""

    def add(self, image: xr.DataArray) -> None:
        """Add a cleaned image (polarization, subband, y, x) with its ``pose``."""

    def state(self) -> Arrays:
        """Return all that was gathered, (alarm, ...) each, with ``row``, the alarms' rows."""
        raise NotImplementedError

    def merge(self, state: Mapping[str, AnyArray]) -> None:
        """Add what was gathered from other scans."""

    def table(self) -> pd.DataFrame:
        """Return the columns; NaN where no scan gave a value."""
        raise NotImplementedError


class StageSums:
    """Means over the scans of the columns of a feature stage.

    Parameters
    ----------
    stage : FeatureStage
        A stage that reads images.
    alarms : DataFrame
        ``x``, ``y`` in the lane frame, m.
    """

    def __init__(self, stage: FeatureStage, alarms: pd.DataFrame) -> None:
        self.stage = stage
        self._points = ground_points(alarms)
        self._total = np.zeros((len(alarms), len(stage.columns)))
        self._count = np.zeros(self._total.shape, np.int64)

    def add(self, image: xr.DataArray) -> None:
        """Add a cleaned image (polarization, subband, y, x) with its ``pose``."""
        pose = floats(image.attrs["pose"])
        positions = lane_to_scan(self._points, pose)[:, :2]
        columns = self.stage.of_image(image, positions)
        arrays = []
        for name in self.stage.columns:
            arrays.append(floats(columns[name]))
        values = np.stack(arrays, axis=1)
        # A scan that cannot measure a feature of an alarm does not count for it.
        self._total += np.nan_to_num(values)
        self._count += np.isfinite(values)

    def state(self) -> Arrays:
        """Return sums and counts, with the rows of the alarms that they belong to."""
        return {"row": np.arange(len(self._points)), "total": self._total, "count": self._count}

    def merge(self, state: Mapping[str, AnyArray]) -> None:
        """Add the sums and counts of other scans."""
        self._total[state["row"]] += state["total"]
        self._count[state["row"]] += state["count"]

    def table(self) -> pd.DataFrame:
        """Return the means; NaN where no scan gave a value."""
        with np.errstate(invalid="ignore"):
            means = np.where(self._count > 0, self._total / np.maximum(self._count, 1), np.nan)
        return pd.DataFrame(means, columns=list(self.stage.columns))
