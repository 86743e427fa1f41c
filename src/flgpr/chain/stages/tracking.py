"""Alarms followed over scans: in how many of those that see the place does something stand out there.

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

from flgpr.chain.engine import Arrays
from flgpr.chain.stages import FeatureStage, FloatArray, Positive, Setup, Table


class TrackingSettings(Table):
    """Channel, by default the first; how far a scan's maximum may lie from the alarm (m); its least magnitude.

    The magnitude is in units of the background.
    """

    polarization: str | None = None
    subband: str | None = None
    reach: Positive = 0.5
    level: Positive = 2.0


class Tracking(FeatureStage):
    """The column ``tracked``: the share of the scans that see the place which have a maximum of their own there."""

    Settings: ClassVar[type[Table]] = TrackingSettings
    columns = ("tracked",)

    def __init__(self, settings: Any, setup: Setup, learnt: Arrays | None = None) -> None:
        super().__init__(settings, setup, learnt)
        imager = setup.imager
        labels = [str(imager.run["polarization"].values[k]) for k in setup.imaged]
        self._channel = tuple(
            _number(name, wanted, known)
            for name, wanted, known in (
                ("polarization", settings.polarization, labels),
                ("subband", settings.subband, list(imager.subbands)),
            )
        )

    def of_image(self, image: xr.DataArray, points: FloatArray) -> Mapping[str, FloatArray]:
        """1 where the largest pixel within reach is a maximum of at least the level, 0 where not, NaN out of sight."""
        level = np.abs(image.values[self._channel])
        reach = self.settings.reach
        x, y = image["x"].values, image["y"].values
        tracked = np.full(len(points), np.nan)
        for row in np.flatnonzero(
            ((points >= [x[0], y[0]]) & (points <= [x[-1], y[-1]])).all(axis=1)
        ):
            tracked[row] = _stands_out(level, x, y, points[row], reach, self.settings.level)
        return {"tracked": tracked}


def _number(name: str, wanted: str | None, known: list[str]) -> int:
    if wanted is not None and wanted not in known:
        raise ValueError(f"tracking.{name} must be one of {', '.join(known)}, got {wanted!r}")
    return 0 if wanted is None else known.index(wanted)


def _stands_out(
    level: Any, x: FloatArray, y: FloatArray, place: FloatArray, reach: float, least: float
) -> bool:
    """Return whether the largest pixel within reach of a place is no flank of something brighter within reach of it."""
    columns = slice(*np.searchsorted(x, [place[0] - 2 * reach, place[0] + 2 * reach]))
    rows = slice(*np.searchsorted(y, [place[1] - 2 * reach, place[1] + 2 * reach]))
    part = level[rows, columns]
    u = x[columns] - place[0]
    v = y[rows, None] - place[1]
    near = np.where(u**2 + v**2 <= reach**2, np.nan_to_num(part), -np.inf)
    top = np.unravel_index(int(near.argmax()), near.shape)
    around = (u - u[top[1]]) ** 2 + (v - v[top[0]]) ** 2 <= reach**2
    return bool(near[top] >= max(least, np.nan_to_num(part)[around].max()))
