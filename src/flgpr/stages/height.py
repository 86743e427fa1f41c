"""How high above the ground what raises an alarm stands, by the phases of its looks.

In one image, an echo at height h is that of ground nearer to the array by about ``h H / r``, with
the height H of the array and the ground range r. That changes as the array comes nearer, so that
only one height brings all looks into phase. Poses must hold within a tenth of a wavelength from
look to look: ``flgpr calibrate poses`` sees to it.

An object under the ground shows farther away, and so looks as if it stood below: an array 5 m high
that looks 8 to 16 m ahead sees 0.4 of its depth. The echo of the ground above it hides that, so no
depth is told.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Self

import numpy as np
import pandas as pd
import xarray as xr
from pydantic import Field, model_validator

from flgpr.model import SPEED_OF_LIGHT, ground_points, lane_to_scan, vehicle_to_scan
from flgpr.model.bounds import Spacing
from flgpr.screen.views import grid_of, sampled
from flgpr.stages import FeatureStage, Setup, Table, channel_of
from flgpr.types import AnyArray, Arrays, ComplexArray, FloatArray, floats

_STEPS = (0.6, 0.45, 0.3)
"""Wavelengths between trial places across the track, along it and in height.

Between neighbours the phase of one look against another changes by less than a third of a turn.
"""
_MOST_TRIALS = 4000  # places about an alarm, of 12 bytes each
_FEWEST_LOOKS = 5
_INTERVAL = (0.05, 0.5, 0.95)
_Height = Annotated[float, Field(ge=-100, le=100)]


class HeightSettings(Table):
    """The channel, and the places about an alarm at which its echo is looked for, m."""

    polarization: str | None = None  #: of the channel; by default the first
    subband: str | None = None  #: of the channel; by default the first
    span: tuple[_Height, _Height] = (-0.3, 1.2)  #: lowest and highest height
    reach: Spacing = 0.3  #: how far along the track it may lie from where the alarm shows it
    ground: Spacing = 0.15  #: up to which height an echo counts as one of the ground
    level: Spacing = 0.05  #: standard deviation of the ground's height in the poses' frame

    @model_validator(mode="after")
    def _check(self) -> Self:
        """Refuse a span that does not hold the ground."""
        lowest, highest = self.span
        if not lowest <= 0 < self.ground < highest:
            raise ValueError(
                f"span must hold the heights from 0 to ground, {self.ground:g}, got {self.span}"
            )
        return self


class Height(FeatureStage):
    """The columns ``height``, ``height_low`` and ``height_high``: its median and 90 % interval, m.

    They are NaN at alarms that fewer than five scans see.
    """

    Settings: ClassVar[type[Table]] = HeightSettings
    columns = ("height", "height_low", "height_high")
    alarm_columns = columns

    def __init__(self, settings: Any, setup: Setup, learnt: Arrays | None = None) -> None:
        super().__init__(settings, setup, learnt)
        self.channel = channel_of("height", settings, setup)
        name = list(setup.imager.subbands)[self.channel[1]]
        carrier = float(np.mean(setup.imager.subbands[name]))
        self.wavenumber = 4 * np.pi * carrier / SPEED_OF_LIGHT
        across, along, up = np.array(_STEPS) * SPEED_OF_LIGHT / carrier
        lowest, highest = settings.span
        self.heights = _spread(lowest, highest, up)
        beside = _spread(-across, across, across)
        before = _spread(-settings.reach, settings.reach, along)
        count = self.heights.size * beside.size * before.size
        if count > _MOST_TRIALS:
            raise ValueError(
                f"height.span and height.reach must give at most {_MOST_TRIALS} trial places at "
                f"the wavelengths of {name}, got {count}: take a lower sub-band or less"
            )
        trials = np.meshgrid(self.heights, beside, before, indexing="ij")
        antennas = np.concatenate([setup.run[end].values for end in ("tx_position", "rx_position")])
        self._middle = antennas.reshape(-1, 3).mean(axis=0)
        # Where an alarm is raised, what stands above the ground is nearer than it is.
        middle = vehicle_to_scan(self._middle, setup.pose(0))
        nearer = middle[2] / (np.mean(setup.images.y[[0, -1]]) - middle[1])
        height, x, y = (axis.ravel() for axis in trials)
        self.offsets = np.stack([x, y + nearer * height, height], axis=-1)

    def sums(self, alarms: pd.DataFrame) -> HeightSums:
        """Return what gathers the looks at alarms."""
        return HeightSums(self, alarms)

    def looks(self, image: xr.DataArray, points: FloatArray) -> ComplexArray:
        """Return what a scan shows of echoes at points above the ground.

        The image of the ground shows such an echo where the ground is as far from the array.

        Parameters
        ----------
        image : (polarization, subband, y, x) DataArray of complex
            Cleaned scan image with its ``pose``.
        points : (..., 3) ndarray
            In the scan frame, m.

        Returns
        -------
        (...) ndarray of complex
            NaN outside the image.
        """
        middle = vehicle_to_scan(self._middle, floats(image.attrs["pose"]))
        grid = grid_of(image)
        pixels = np.stack(np.meshgrid(grid.x, grid.y), axis=-1) - middle[:2]
        # Free of its carrier an image changes slowly enough between pixels to be interpolated.
        carrier = self.wavenumber * np.sqrt((pixels**2).sum(axis=-1) + middle[2] ** 2)
        slow = image.values[self.channel] * np.exp(-1j * carrier)
        path = np.linalg.norm(points - middle, axis=-1)
        ahead = path**2 - (points[..., 0] - middle[0]) ** 2 - middle[2] ** 2
        places = np.stack([points[..., 0], middle[1] + np.sqrt(np.maximum(ahead, 0))], axis=-1)
        return np.asarray(sampled(slow, grid, places) * np.exp(1j * self.wavenumber * path))

    def of_alarms(self, alarms: pd.DataFrame) -> list[str]:
        """Return how many alarms stand above the ground, and of how many that is not told."""
        known = alarms["height"].notna()
        if not known.any():
            return ["heights of alarms are not told: no alarm is seen by five scans"]
        ground = self.settings.ground
        above = int((alarms["height_low"] > ground).sum())
        on_ground = int((alarms["height_high"] <= ground).sum())
        return [
            f"alarms that stand more than {ground:g} m above the ground: {above} of {len(alarms)}; "
            f"at it or under it: {on_ground}; not told: {len(alarms) - above - on_ground}"
        ]


class HeightSums:
    """Sums of the looks at alarms, in the phase of an echo at each trial place.

    Parameters
    ----------
    stage : Height
        The stage.
    alarms : DataFrame
        ``x``, ``y`` in the lane frame, m.
    """

    def __init__(self, stage: Height, alarms: pd.DataFrame) -> None:
        self._stage = stage
        self._points = ground_points(alarms)
        shape = len(alarms), len(stage.offsets)
        self._sums: Arrays = {
            "total": np.zeros(shape, np.complex64),
            "power": np.zeros(shape, np.float32),
            "looks": np.zeros((len(alarms), 1), np.int64),
        }

    def add(self, image: xr.DataArray) -> None:
        """Add a scan's look at the alarms of which it shows all trial places."""
        pose = floats(image.attrs["pose"])
        near = lane_to_scan(self._points, pose)[:, :2]
        first, last = ([image[axis].values[end] for axis in "xy"] for end in (0, -1))
        seen = np.flatnonzero(((near >= first) & (near <= last)).all(axis=1))
        places = lane_to_scan(self._points[seen, None] + self._stage.offsets, pose)
        values = self._stage.looks(image, places)
        whole = np.isfinite(values).all(axis=1)
        values, rows = values[whole], seen[whole]
        self._sums["total"][rows] += values
        self._sums["power"][rows] += np.abs(values) ** 2
        self._sums["looks"][rows] += 1

    def state(self) -> Arrays:
        """Return the sums, with the rows of the alarms that they belong to."""
        return {"row": np.arange(len(self._points)), **self._sums}

    def merge(self, state: Mapping[str, AnyArray]) -> None:
        """Add the sums of other scans."""
        for name, total in self._sums.items():
            total[state["row"]] += state[name]

    def table(self) -> pd.DataFrame:
        r"""Return the heights.

        For looks of one unknown amplitude in white noise of unknown power the likelihood is
        proportional to $(1 - c)^{-n}$, with the coherence $c = |\sum x|^2 / n \sum |x|^2$ of the
        n looks x. It is summed over the places of a height; all heights are equally likely before.
        """
        looks = self._sums["looks"]
        with np.errstate(invalid="ignore", divide="ignore"):
            coherence = np.abs(self._sums["total"]) ** 2 / (looks * self._sums["power"])
            likelihood = -looks * np.log1p(-np.minimum(coherence, 1 - 1e-6))
        table = np.full((len(looks), len(_INTERVAL)), np.nan)
        heights = self._stage.heights
        blur = np.exp(-(((heights[:, None] - heights) / self._stage.settings.level) ** 2) / 2)
        for row in np.flatnonzero(looks >= _FEWEST_LOOKS):
            of_alarm = likelihood[row].reshape(len(heights), -1)
            weight = blur @ np.exp(of_alarm - of_alarm.max()).sum(axis=1)
            below = np.concatenate([[0.0], np.cumsum(weight) / weight.sum()])
            edges = np.append(heights, 2 * heights[-1] - heights[-2]) - np.diff(heights[:2]) / 2
            table[row] = np.interp(_INTERVAL, below, edges)
        columns = ["height_low", "height", "height_high"]
        return pd.DataFrame(table, columns=columns)[list(self._stage.columns)]


def _spread(first: float, last: float, step: float) -> FloatArray:
    """Return numbers from the first to the last, evenly spaced by at most a step."""
    return np.linspace(first, last, max(round(np.ceil((last - first) / step)), 1) + 1)
