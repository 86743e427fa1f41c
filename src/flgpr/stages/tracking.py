"""Alarms followed over scans: in how many of those that see the place something stands out there.

After the abstract of Fuse, Rostami, Gonzalez-Valdes & Rappaport, "False alarm reduction by target
tracking for forward looking ground penetrating radar", Ground Penetrating Radar 1(2), 2018: buried
objects stand still while the platform advances, and what does not stay is taken for clutter. Reach
and level are ours.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import xarray as xr

from flgpr.stages import FeatureStage, Positive, Setup, Table, channel_of
from flgpr.types import Arrays, Float32Array, FloatArray


class TrackingSettings(Table):
    """How a maximum is searched, in which channel."""

    polarization: str | None = None  #: of the channel; by default the first
    subband: str | None = None  #: of the channel; by default the first
    reach: Positive = 0.5  #: how far a scan's maximum may lie from the alarm, m
    level: Positive = 2.0  #: least magnitude of the maximum, in units of the background


class Tracking(FeatureStage):
    """The column ``tracked``: of the scans that see an alarm, the share with a maximum there."""

    Settings: ClassVar[type[Table]] = TrackingSettings
    columns = ("tracked",)

    def __init__(self, settings: Any, setup: Setup, learnt: Arrays | None = None) -> None:
        super().__init__(settings, setup, learnt)
        self._channel = channel_of("tracking", settings, setup)

    def of_image(self, image: xr.DataArray, points: FloatArray) -> Mapping[str, FloatArray]:
        """Return 1 where the brightest pixel within reach is a maximum of at least the level.

        It is 0 where it is not, and NaN out of sight.
        """
        magnitude = np.abs(image.values[self._channel])
        x = image["x"].values
        y = image["y"].values
        beyond_first = points >= [x[0], y[0]]
        before_last = points <= [x[-1], y[-1]]
        in_sight = (beyond_first & before_last).all(axis=1)
        tracked = np.full(len(points), np.nan)
        for number in np.flatnonzero(in_sight):
            tracked[number] = _stands_out(
                magnitude, x, y, points[number], self.settings.reach, self.settings.level
            )
        return {"tracked": tracked}


def _stands_out(
    magnitude: Float32Array,
    x: FloatArray,
    y: FloatArray,
    point: FloatArray,
    reach: float,
    level: float,
) -> bool:
    """Return whether the brightest pixel within reach of a point is a maximum of its surroundings.

    It is none if it lies on the flank of something brighter, within reach of it.
    """
    # Twice the reach: the surroundings of the farthest pixel are compared too.
    columns = slice(*np.searchsorted(x, [point[0] - 2 * reach, point[0] + 2 * reach]))
    rows = slice(*np.searchsorted(y, [point[1] - 2 * reach, point[1] + 2 * reach]))
    values = np.nan_to_num(magnitude[rows, columns])
    u = x[columns] - point[0]
    v = y[rows, None] - point[1]
    within_reach = np.where(u**2 + v**2 <= reach**2, values, -np.inf)
    row, column = np.unravel_index(int(within_reach.argmax()), within_reach.shape)
    surroundings = (u - u[column]) ** 2 + (v - v[row]) ** 2 <= reach**2
    brightest_around = values[surroundings].max()
    return bool(within_reach[row, column] >= max(level, brightest_around))
