"""Migrated sections below a line of antennas on the ground."""

from __future__ import annotations

import math

import numpy as np
import xarray as xr

from flgpr.imaging.aperture import aperture_blocks, aperture_image
from flgpr.imaging.focus import scan_weights
from flgpr.imaging.view_axes import chosen_scans
from flgpr.model import SPEED_OF_LIGHT, unambiguous_path
from flgpr.types import ComplexArray

_SPACING = 0.03  # m along the line; assumed
_HIGHEST = 0.5  # wavelengths in the middle of the band, of antennas on the ground; assumed
_TOLERANCE = 1e-2  # of the images, which are only compared with one another


class LineSection:
    """Sections of the same delays below a stretch of a line, for any permittivity of the ground.

    Parameters
    ----------
    run : xarray.Dataset
        A run of antennas that are coupled to the ground.
    along : (float, float), optional
        Stretch of the line, m, by default all of it.
    delays : (float, float)
        Two-way delays that the section spans, s.

    Raises
    ------
    ValueError
        If limits do not increase, the stretch lies off the line, the delays lie beyond the record,
        after which echoes come round again, or antennas are off the ground.
    """

    def __init__(
        self, run: xr.Dataset, along: tuple[float, float] | None, delays: tuple[float, float]
    ) -> None:
        scans = chosen_scans(run, None)
        pose = run["pose"].values[scans]
        frequency = run["frequency"].values
        antennas = np.concatenate([run["tx_position"].values, run["rx_position"].values])
        height = float(np.median(pose[:, 2]) + antennas[:, 2].min())
        most = _HIGHEST * SPEED_OF_LIGHT / float(frequency.mean())
        if abs(height) > most:
            raise ValueError(
                f"antennas must be on level ground, z = 0 to {most:.2g} m, half a wavelength, got z = "
                f"{height:.3g} m"
            )
        self._axis = int(np.ptp(pose[:, 1]) >= np.ptp(pose[:, 0]))
        position = pose[:, self._axis]
        low, high = along or (float(position.min()), float(position.max()))
        if not (high > low and 0 <= delays[0] < delays[1]):
            raise ValueError(
                f"along and delays must have limits that increase, got {low:g}, {high:g} m and "
                f"{delays} s"
            )
        if low >= position.max() or high <= position.min():
            raise ValueError(
                f"along must hold a part of the line, {position.min():g} to {position.max():g} m, got "
                f"{low:g} to {high:g} m"
            )
        record = unambiguous_path(frequency) / SPEED_OF_LIGHT
        if delays[0] >= record:
            raise ValueError(
                f"delays must begin within the record of {record:.4g} s, got {delays[0]:g} s"
            )
        self._run = run
        self._middle = (pose[:, 0].mean(), pose[:, 1].mean())
        self._along = np.linspace(low, high, max(round((high - low) / _SPACING), 2))
        self._delay = np.arange(*delays, 1 / (4 * frequency[-1]))
        self._weights = scan_weights(run, scans)
        self._blocks = aperture_blocks(run, scans)

    def image(self, permittivity: float) -> ComplexArray:
        """Return the section (polarization, delay, place) migrated with a permittivity."""
        points = np.zeros((self._delay.size, self._along.size, 3))
        points[..., 0] = self._middle[0]
        points[..., 1] = self._middle[1]
        points[..., self._axis] = self._along
        points[..., 2] = -self._delay[:, None] * SPEED_OF_LIGHT / math.sqrt(permittivity) / 2
        return aperture_image(
            self._run,
            points,
            self._blocks,
            self._weights,
            permittivity=permittivity,
            window="hann",
            tolerance=_TOLERANCE,
        )

    def focus(self, permittivity: float) -> tuple[float, float, bool]:
        """Return where along the line (m) and at which delay (s) the section is brightest.

        It is looked for without what is the same all along the line; the last value says whether it
        lies at an edge of the delays, from beyond which its echo may come.
        """
        image = self.image(permittivity)
        power = (np.abs(image - image.mean(axis=-1, keepdims=True)) ** 2).sum(axis=0)
        row, column = np.unravel_index(int(power.argmax()), power.shape)
        is_edge = row in (0, len(self._delay) - 1)
        return float(self._along[column]), float(self._delay[row]), is_edge
