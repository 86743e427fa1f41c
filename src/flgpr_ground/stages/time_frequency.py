"""Columns of the range profile at an alarm in time and frequency (after Sun & Li 2003)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

import numpy as np
import xarray as xr
from pydantic import Field, model_validator

from flgpr.features import range_wavenumbers, reflection_features, spectrograms
from flgpr.model import SPEED_OF_LIGHT, vehicle_to_scan
from flgpr.model.bounds import NotNegative
from flgpr.stages import FeatureStage, Positive, Setup, Table
from flgpr.types import Arrays, Complex128Array, ComplexArray, FloatArray, IntArray

_NAMES = ("level", "second", "distance", "shift", "bandwidth", "entropy")
_GIGAHERTZ = ("shift", "bandwidth")


class TimeFrequencySettings(Table):
    """The range profile of an alarm, and where its reflections are looked for; lengths in m.

    ``polarizations`` are those whose profiles are read, in the sub-band ``subband``, by default the
    widest. The profile is the column of the image, among those within ``across`` of the alarm, that
    holds the brightest pixel within ``search`` down-track; there its first reflection is looked
    for, and the second from ``gate[0]`` to ``gate[1]`` behind it. ``width`` is the standard
    deviation of the window, ``frequencies`` the number of frequencies across the sub-band.
    """

    polarizations: tuple[str, ...] = ("HH", "VV")
    subband: str | None = None
    across: NotNegative = 0.15
    search: Positive = 0.25
    gate: tuple[Positive, Positive] = (0.1, 0.35)
    width: Positive = 0.06
    frequencies: Annotated[int, Field(ge=2, le=256)] = 16

    @model_validator(mode="after")
    def _increasing(self) -> TimeFrequencySettings:
        """Refuse a gate that ends before it begins."""
        if self.gate[1] <= self.gate[0]:
            raise ValueError(f"gate must increase, got {self.gate[0]:g}, {self.gate[1]:g}")
        return self

    @property
    def reach(self) -> float:
        """How far the profile reaches either way, m: the window's flanks beyond the gate."""
        return self.search + self.gate[1] + 2 * self.width


class TimeFrequency(FeatureStage):
    """The columns ``tf_NAME_POLARIZATION``: one reflection at an alarm, or two in a row.

    ``level`` (dB) is the energy of the first reflection, ``second`` (dB) how far the strongest one
    behind it stays below, ``distance`` (m) how far behind it lies, ``shift`` (GHz) how much higher
    its frequencies are, ``bandwidth`` (GHz) that of the first, and ``entropy`` (bits) grows with
    the number of parts in the plane. See :mod:`flgpr_ground.features.time_frequency`.
    """

    Settings: ClassVar[type[Table]] = TimeFrequencySettings

    def __init__(self, settings: Any, setup: Setup, learnt: Arrays | None = None) -> None:
        super().__init__(settings, setup, learnt)
        labels = setup.imager.run["polarization"].values
        imaged = [str(labels[number]) for number in setup.imaged]
        missing = [name for name in settings.polarizations if name not in imaged]
        if missing:
            raise ValueError(
                f"time-frequency.polarizations must be among {', '.join(imaged)}, "
                f"got {missing[0]!r}"
            )
        subbands = setup.imager.subbands
        widths = {name: high - low for name, (low, high) in subbands.items()}
        self._subband = settings.subband or max(widths, key=lambda name: widths[name])
        if self._subband not in subbands:
            raise ValueError(
                f"time-frequency.subband must be one of {', '.join(subbands)}, "
                f"got {self._subband!r}"
            )
        # The path changes by two metres per metre at most. Pixels farther apart than this would
        # show one frequency as another.
        coarsest = SPEED_OF_LIGHT / (2 * widths[self._subband])
        if setup.images.dy >= coarsest:
            raise ValueError(
                f"image.spacing must be below {coarsest:.3g} m down-track for the sub-band "
                f"{self._subband}, got {setup.images.dy:g} m"
            )
        self._frequency = np.linspace(*subbands[self._subband], settings.frequencies)
        self.columns = tuple(
            f"tf_{name}_{label}" for label in settings.polarizations for name in _NAMES
        )

    def of_image(self, image: xr.DataArray, points: FloatArray) -> Mapping[str, FloatArray]:
        """Return the features of a scan; NaN where a profile leaves the image."""
        values = {name: np.full(len(points), np.nan) for name in self.columns}
        grid = self.setup.images
        half = round(self.settings.reach / grid.dy)
        row = np.rint((points[:, 1] - grid.y_min) / grid.dy).astype(int)
        column = np.rint((points[:, 0] - grid.x_min) / grid.dx).astype(int)
        side = round(self.settings.across / grid.dx)
        rows, columns = image.shape[-2:]
        inside = (row >= half) & (row + half < rows) & (column >= side) & (column + side < columns)
        alarms = np.flatnonzero(inside)
        if not len(alarms):
            return values

        settings = self.settings
        offsets = grid.dy * np.arange(-half, half + 1)
        pose = np.asarray(image.attrs["pose"])
        tx, rx = (
            vehicle_to_scan(self.setup.run[name].values, pose)
            for name in ("tx_position", "rx_position")
        )
        wavenumbers = range_wavenumbers(points[alarms], tx, rx, self._frequency)
        band = image.sel(subband=self._subband)
        for polarization in settings.polarizations:
            channel = band.sel(polarization=polarization).values
            profiles = self._profiles(channel, row[alarms], column[alarms], half, side)
            known = np.isfinite(profiles).all(axis=1)
            energy = spectrograms(profiles[known], offsets, wavenumbers[known], settings.width)
            features = reflection_features(
                energy, offsets, self._frequency, settings.search, settings.gate
            )
            for name in _NAMES:
                unit = 1e9 if name in _GIGAHERTZ else 1.0
                feature = getattr(features, name) / unit
                values[f"tf_{name}_{polarization}"][alarms[known]] = feature
        return values

    def _profiles(
        self,
        channel: ComplexArray,
        row: IntArray,
        column: IntArray,
        half: int,
        side: int,
    ) -> Complex128Array:
        """Return the profiles (alarm, range): the column with the brightest pixel near the middle.

        Pixels are taken as they are, as the phase turns too fast between them to interpolate.
        """
        down = row[:, None, None] + np.arange(-half, half + 1)[:, None]
        across = column[:, None, None] + np.arange(-side, side + 1)
        chips = channel[down, across].astype(np.complex128)
        search = round(self.settings.search / self.setup.images.dy)
        middle = np.abs(chips[:, half - search : half + search + 1])
        brightest = np.nan_to_num(middle).max(axis=1).argmax(axis=1)
        return chips[np.arange(len(chips)), :, brightest]
