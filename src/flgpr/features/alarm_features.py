"""The ten features of an alarm (Wang et al. 2007, Eq. 6-17), scan by scan for all sub-bands."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd

from flgpr.features.patch import PatchShape
from flgpr.features.polarimetry import cameron, coherency, entropy_alpha_of
from flgpr.features.regions import patch_statistics
from flgpr.kernels.patches import MEAN, OUTER_MEAN, OUTER_STD, PEAK
from flgpr.model import Grid, ground_points, lane_to_scan
from flgpr.types import (
    AnyArray,
    Arrays,
    BoolArray,
    Complex128Array,
    ComplexArray,
    Float32Array,
    FloatArray,
    IndexArray,
)

FEATURES = (
    "M_VV",
    "C_VV",
    "R_VV_HV",
    "M_HH",
    "C_HH",
    "R_HH_HV",
    "P_H",
    "P_alpha",
    "P_tau",
    "P_psi",
)
"""The paper's features in its order, #1 to #10. A new feature is a stage (``stages/named.py``)."""
POLARIMETRIC = ("P_H", "P_alpha", "P_tau", "P_psi")
_WINDOW = 5  # pixels of the window of <·> in Eq. 10


@dataclass(frozen=True)
class FeatureSettings:
    """Settings of the features."""

    #: incoherent patch and its regions, cross-track x down-track
    patch: PatchShape = field(default_factory=PatchShape)
    #: central pixels of the coherent patch over which the polarimetric values are averaged,
    #: cross-track x down-track
    inner: tuple[int, int] = (5, 3)
    y_max: float = 16.0  #: farthest distance ahead of the array that counts, m
    #: mean of the angles ψ: of directions, modulo 180°, or of numbers as in the paper
    psi: Literal["circular", "linear"] = "circular"
    #: sub-bands whose polarimetric features are computed; None for all
    polarimetric: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        if any(n < 1 or n % 2 == 0 for n in self.inner):
            raise ValueError(f"inner must be odd numbers of pixels, got {self.inner}")
        if self.psi not in ("circular", "linear"):
            raise ValueError(f"psi must be circular or linear, got {self.psi!r}")

    def swapped(self) -> FeatureSettings:
        """Return the same settings with cross-track and down-track exchanged in all regions."""
        patch = replace(self.patch, inner=self.patch.inner[::-1], guard=self.patch.guard[::-1])
        return replace(self, patch=patch, inner=self.inner[::-1])


class FeatureSums:
    """Compute the features of alarms scan by scan.

    Only the scans count in which the alarm lies within ``y_max`` and the image holds all of the
    inner region of its patch.

    Parameters
    ----------
    alarms : DataFrame
        x, y in the lane frame, m.
    polarizations, subbands : sequence of str
        Labels of the scan images. HH, VV and HV must be among them; VH replaces a missing HV.
    grid : Grid
        Pixels of the scan images, in the scan frame.
    settings : FeatureSettings, optional
        Settings; default the paper's.

    Raises
    ------
    ValueError
        If a polarization is missing.
    """

    def __init__(
        self,
        alarms: pd.DataFrame,
        polarizations: Sequence[str],
        subbands: Sequence[str],
        grid: Grid,
        settings: FeatureSettings | None = None,
    ) -> None:
        self.settings = settings or FeatureSettings()
        self.grid = grid
        self.subbands = list(subbands)
        names = list(polarizations)
        cross = "HV" if "HV" in names else "VH"
        missing = [name for name in ("HH", "VV", cross) if name not in names]
        if missing:
            raise ValueError(
                "polarizations must hold HH, VV and HV or VH for the features, "
                f"got {', '.join(names)}"
            )
        self._hh = names.index("HH")
        self._vv = names.index("VV")
        self._hv = names.index(cross)
        self._index = alarms.index
        self._centres = ground_points(alarms)
        self._coherent = self._polarimetric_bands()

        # Eq. 7, 8 and 11 to 17 are means over scans: numerators by feature, and denominators under
        # the names HH and VV (of the peaks) and weight (of the polarimetric values).
        shape = (len(alarms), len(self.subbands))
        sums = ("C_HH", "C_VV", "R_HH_HV", "R_VV_HV", "HH", "VV")
        angles = ("P_H", "P_alpha", "P_tau", "P_psi", "weight")
        self._peak = {name: np.full(shape, -np.inf) for name in ("HH", "VV")}
        self._sum = {name: np.zeros(shape) for name in sums}
        self._angle = {name: np.zeros(shape) for name in angles}
        self._double_angle = np.zeros(shape, np.complex128)  # Σ weight·exp(2jψ)
        self._scans = np.zeros(len(alarms), np.int64)

    def _polarimetric_bands(self) -> slice:
        """Return the range of sub-bands from the first polarimetric one to the last."""
        polarimetric = self.settings.polarimetric
        if polarimetric is None:
            return slice(0, len(self.subbands))
        numbers = [i for i, band in enumerate(self.subbands) if band in polarimetric]
        if not numbers:
            return slice(0, 0)
        return slice(numbers[0], numbers[-1] + 1)

    def add(self, magnitude: Float32Array, coherent: ComplexArray, pose: FloatArray) -> None:
        """Add one scan.

        Parameters
        ----------
        magnitude : (polarization, subband, y, x) ndarray of float32
            Cleaned magnitudes, each channel in units of its own gain background.
        coherent : (polarization, subband, y, x) ndarray of complex64
            Cleaned images, whose polarizations share one gain.
        pose : (6,) ndarray
            Pose of the scan, m and rad.
        """
        self.add_all([(magnitude, coherent, pose)])

    def add_all(self, scans: Iterable[tuple[Float32Array, ComplexArray, FloatArray]]) -> None:
        """Add scans, at least one, in their order; for few alarms quicker than one by one."""
        samples = [self._samples(*scan) for scan in scans]
        alarm = np.concatenate([scan.alarm for scan in samples])
        if not alarm.size:
            return
        statistics = np.concatenate([scan.statistics for scan in samples])
        patch = np.concatenate([scan.patch for scan in samples], axis=2)
        has_patch = np.concatenate([scan.has_patch for scan in samples])

        self._add_incoherent(alarm, statistics)
        weight = statistics[has_patch, self._hh, self._coherent, PEAK]
        self._add_coherent(alarm[has_patch], weight, patch)
        np.add.at(self._scans, alarm, 1)

    def state(self) -> Arrays:
        """Return the sums for :meth:`merge`: ``row``, the alarms with a scan, and their sums."""
        row = np.flatnonzero(self._scans)
        state: Arrays = {"row": row}
        for group, sums in (("peak", self._peak), ("sum", self._sum), ("angle", self._angle)):
            for name, total in sums.items():
                state[f"{group}.{name}"] = total[row]
        state["turn"] = self._double_angle[row]
        state["scans"] = self._scans[row]
        return state

    def merge(self, state: Arrays) -> None:
        """Add the sums (:meth:`state`) of other scans for the same alarms."""
        row = state["row"]
        for name, total in self._peak.items():
            total[row] = np.maximum(total[row], state[f"peak.{name}"])
        for name, total in self._sum.items():
            total[row] += state[f"sum.{name}"]
        for name, total in self._angle.items():
            total[row] += state[f"angle.{name}"]
        self._double_angle[row] += state["turn"]
        self._scans[row] += state["scans"]

    def psi(self, mean: Literal["circular", "linear"]) -> FloatArray:
        """Return P_psi by a mean of directions or of numbers.

        Parameters
        ----------
        mean : {"circular", "linear"}
            Mean of directions, modulo 180°, or of numbers as in the paper (Eq. 17).

        Returns
        -------
        (alarm, subband) ndarray
            P_psi, rad; NaN where no scan counts.
        """
        weight = self._angle["weight"]
        with np.errstate(invalid="ignore", divide="ignore"):
            circular = np.angle(self._double_angle) / 2
            linear = self._angle["P_psi"] / weight
        return np.where(weight > 0, circular if mean == "circular" else linear, np.nan)

    def table(self) -> pd.DataFrame:
        """Return the features that follow from the sums.

        Returns
        -------
        DataFrame
            With the index of the alarms: ``scans``, the number of those that count, and per
            sub-band the ten features as ``FEATURE_SUBBAND``, angles in rad; NaN where no scan
            counts.
        """
        features = {}
        with np.errstate(invalid="ignore", divide="ignore"):
            for pol in ("HH", "VV"):
                peak = self._peak[pol]
                features[f"M_{pol}"] = np.where(np.isfinite(peak), peak, np.nan)
                features[f"C_{pol}"] = self._sum[f"C_{pol}"] / self._sum[pol]
                features[f"R_{pol}_HV"] = self._sum[f"R_{pol}_HV"] / self._sum[pol]
            for name in POLARIMETRIC:
                features[name] = self._angle[name] / self._angle["weight"]
        features["P_psi"] = self.psi(self.settings.psi)
        names = [f"{name}_{subband}" for subband in self.subbands for name in FEATURES]
        values = np.stack([features[name] for name in FEATURES], axis=2)
        table = pd.DataFrame(values.reshape(len(self._index), len(names)), self._index, names)
        table.insert(0, "scans", self._scans)
        return table

    def _samples(
        self, magnitude: Float32Array, coherent: ComplexArray, pose: FloatArray
    ) -> _Samples:
        """Return what one scan shows of the alarms that it sees."""
        grid = self.grid
        local = lane_to_scan(self._centres, pose)[:, :2]
        row = (local[:, 1] - grid.y_min) / grid.dy
        column = (local[:, 0] - grid.x_min) / grid.dx
        in_reach = local[:, 1] <= self.settings.y_max
        in_reach &= (row >= 0) & (row <= grid.ny - 1)
        in_reach &= (column >= 0) & (column <= grid.nx - 1)
        alarm = np.flatnonzero(in_reach)

        # A patch whose inner region leaves the image has no statistics, and does not count.
        statistics = self._statistics(magnitude, row[alarm], column[alarm])
        known = np.isfinite(statistics).all(axis=(1, 2, 3))
        alarm = alarm[known]
        patch, has_patch = self._patches(coherent, row[alarm], column[alarm])
        return _Samples(alarm, statistics[known], patch, has_patch)

    def _statistics(
        self, magnitude: Float32Array, row: FloatArray, column: FloatArray
    ) -> FloatArray:
        """Return statistics (alarm, polarization, subband, 4) of the regions about pixels."""
        channels = magnitude.shape[:2]
        if not row.size:
            return np.empty((0, *channels, 4))
        images = magnitude.reshape(-1, *magnitude.shape[2:])
        statistics = patch_statistics(self.settings.patch, images, row, column, self.grid.dx)
        return statistics.reshape(row.size, *channels, 4)

    def _patches(
        self, coherent: ComplexArray, row: FloatArray, column: FloatArray
    ) -> tuple[ComplexArray, BoolArray]:
        """Cut the coherent patches about pixels, and return which of them the image holds.

        The patches are (polarization, subband, alarm, y, x). They are not interpolated: the phase
        turns by up to a cycle from pixel to pixel.
        """
        # Half of a patch: the inner region, and the window of <·> about its outermost pixels.
        half_window = _WINDOW // 2
        inner_x, inner_y = self.settings.inner
        nx = inner_x // 2 + half_window
        ny = inner_y // 2 + half_window

        y = np.rint(row).astype(np.intp)
        x = np.rint(column).astype(np.intp)
        fits = (y - ny >= 0) & (y + ny < self.grid.ny)
        fits &= (x - nx >= 0) & (x + nx < self.grid.nx)
        rows = y[fits, None, None] + np.arange(-ny, ny + 1)[:, None]
        columns = x[fits, None, None] + np.arange(-nx, nx + 1)
        return coherent[:, self._coherent, rows, columns], fits

    def _add_incoherent(self, alarm: IndexArray, statistics: FloatArray) -> None:
        """Add the peaks, contrasts and ratios of HH and VV, each weighed by its peak m_in(Y)."""
        cross_mean = statistics[:, self._hv][..., MEAN]
        for name, number in (("HH", self._hh), ("VV", self._vv)):
            regions = statistics[:, number]
            peak = regions[..., PEAK]
            np.maximum.at(self._peak[name], alarm, peak)  # Eq. 6
            np.add.at(self._sum[name], alarm, peak)
            with np.errstate(invalid="ignore", divide="ignore"):
                contrast = peak * (peak - regions[..., OUTER_MEAN]) / regions[..., OUTER_STD]
                ratio = peak * regions[..., MEAN] / cross_mean
                np.add.at(self._sum[f"C_{name}"], alarm, contrast)  # Eq. 7
                np.add.at(self._sum[f"R_{name}_HV"], alarm, ratio)  # Eq. 8

    def _add_coherent(self, alarm: IndexArray, weight: FloatArray, patch: ComplexArray) -> None:
        """Add the polarimetric values at the pixels about each alarm, weighed by m_in(Y, "HH")."""
        if not weight.size:
            return
        half = _WINDOW // 2
        hh = patch[self._hh].astype(np.complex128)
        hv = patch[self._hv].astype(np.complex128)
        vv = patch[self._vv].astype(np.complex128)
        inner = (Ellipsis, slice(half, -half), slice(half, -half))
        mean_coherency = _valid_mean(coherency(hh, hv, vv), _WINDOW)  # Eq. 10
        H, alpha = entropy_alpha_of(mean_coherency)
        tau, psi = cameron(hh[inner], hv[inner], vv[inner])  # Eq. 13 to 15

        def add(total: AnyArray, value: AnyArray) -> None:
            """Add the mean over R_in, times the weight, to the alarms' sums."""
            mean_in = value.mean(axis=(-2, -1)).T
            np.add.at(total[:, self._coherent], alarm, weight * mean_in)

        add(self._angle["P_H"], H)  # Eq. 11
        add(self._angle["P_alpha"], alpha)  # Eq. 12
        add(self._angle["P_tau"], tau)  # Eq. 16
        add(self._angle["P_psi"], psi)  # Eq. 17
        add(self._double_angle, np.exp(2j * psi))  # for the circular mean, which Eq. 17 is not
        np.add.at(self._angle["weight"][:, self._coherent], alarm, weight)  # their denominator


class _Samples(NamedTuple):
    """What one scan shows of the alarms that it sees."""

    alarm: IndexArray  #: (alarm,): rows of the alarms
    statistics: FloatArray  #: (alarm, polarization, subband, 4): of the regions about each
    patch: ComplexArray  #: (polarization, subband, alarm with a patch, y, x)
    has_patch: BoolArray  #: (alarm,): whether the image holds the coherent patch


def _valid_mean(matrix: Complex128Array, size: int) -> Complex128Array:
    """Average over the windows of ``size`` pixels that lie wholly in (..., y, x, 3, 3)."""
    ny = matrix.shape[-4] - size + 1
    nx = matrix.shape[-3] - size + 1
    # A square window is a sum along y of sums along x.
    shifted_rows = [matrix[..., i : i + ny, :, :, :] for i in range(size)]
    down = np.sum(shifted_rows, axis=0)
    shifted_columns = [down[..., i : i + nx, :, :] for i in range(size)]
    across: Complex128Array = np.sum(shifted_columns, axis=0)
    return across / size**2
