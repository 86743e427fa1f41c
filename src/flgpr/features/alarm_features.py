"""The ten features of an alarm (Wang et al. 2007, Eq. 6-17), gathered scan by scan for any number of sub-bands."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.features.contrast import region_codes
from flgpr.features.patch import PatchShape
from flgpr.features.polarimetry import cameron, coherency, entropy_alpha_of
from flgpr.kernels.patches import MEAN, OUTER_MEAN, OUTER_STD, PEAK, region_statistics
from flgpr.model import Grid, ground_points, lane_to_scan

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
"""The paper's features in its order, #1 to #10."""
POLARIMETRIC = FEATURES[6:]
_AVERAGE = 5  # pixels of the window of <·> in Eq. 10
FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class FeatureSettings:
    """How features are computed."""

    patch: PatchShape = field(
        default_factory=PatchShape
    )  #: incoherent patch and its regions, cross-track x down-track
    #: central pixels of the coherent patch over which the polarimetric values are averaged, cross-track x down-track
    inner: tuple[int, int] = (5, 3)
    y_max: float = 16.0  #: farthest distance ahead of the array that counts, m
    #: how angles ψ are averaged: as directions, modulo 180°, or as numbers as the paper has it
    psi: Literal["circular", "linear"] = "circular"
    #: sub-bands whose polarimetric features are wanted; None wants all
    polarimetric: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        if any(n < 1 or n % 2 == 0 for n in self.inner):
            raise ValueError(f"inner must be odd numbers of pixels, got {self.inner}")
        if self.psi not in ("circular", "linear"):
            raise ValueError(f"psi must be circular or linear, got {self.psi!r}")

    def swapped(self) -> FeatureSettings:
        """Give the same settings with cross-track and down-track exchanged in all regions."""
        patch = PatchShape(
            self.patch.size, self.patch.spacing, self.patch.inner[::-1], self.patch.guard[::-1]
        )
        return replace(self, patch=patch, inner=self.inner[::-1])


class FeatureSums:
    """The sums over scans that the features are made of, for alarms (x, y in the lane frame, m).

    Only the scans in which the alarm lies within ``y_max`` and whose patch holds the whole inner region count. The
    images to come have these polarizations, sub-bands and pixels (of the scan frame); HH, VV and HV must be among them,
    VH stands in for HV where there is only that.
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
                f"polarizations must hold HH, VV and HV or VH for the features, got {', '.join(names)}"
            )
        self._hh, self._vv, self._hv = (names.index(name) for name in ("HH", "VV", cross))
        self._index = alarms.index
        self._centres = ground_points(alarms)
        self._regions = region_codes(self.settings.patch)
        wanted = self.settings.polarimetric
        bands = [i for i, band in enumerate(self.subbands) if wanted is None or band in wanted] or [
            -1
        ]
        self._coherent = slice(max(bands[0], 0), bands[-1] + 1)
        shape = (len(alarms), len(self.subbands))
        self._peak = {name: np.full(shape, -np.inf) for name in ("HH", "VV")}
        self._sum = {
            name: np.zeros(shape) for name in ("C_HH", "C_VV", "R_HH_HV", "R_VV_HV", "HH", "VV")
        }
        self._angle = {
            name: np.zeros(shape) for name in ("P_H", "P_alpha", "P_tau", "P_psi", "weight")
        }
        self._turn = np.zeros(shape, np.complex128)
        self._scans = np.zeros(len(alarms), np.int64)

    def add(
        self, magnitude: NDArray[np.float32], coherent: NDArray[np.complex64], pose: FloatArray
    ) -> None:
        """Take one scan in: cleaned magnitudes, each channel in units of its own gain background, and cleaned images.

        Both are (polarization, subband, y, x); the polarizations of the complex images share one gain.
        """
        self.add_all([(magnitude, coherent, pose)])

    def add_all(
        self, scans: Iterable[tuple[NDArray[np.float32], NDArray[np.complex64], FloatArray]]
    ) -> None:
        """Take in scans, at least one, in their order as :meth:`add` does; of few alarms quicker than one by one."""
        looks = zip(*(self._look(*scan) for scan in scans), strict=True)
        seen, values, patch, fits = (
            np.concatenate(one, axis) for one, axis in zip(looks, (0, 0, 2, 0), strict=True)
        )
        if not seen.size:
            return
        self._add_incoherent(seen, values)
        self._add_coherent(seen[fits], values[fits, self._hh, self._coherent, PEAK], patch)
        np.add.at(self._scans, seen, 1)

    def state(self) -> dict[str, NDArray[Any]]:
        """Give what was gathered, to be merged into another: ``row``, the alarms that were seen, and their sums."""
        row = np.flatnonzero(self._scans)
        named: dict[str, NDArray[Any]] = {
            f"peak.{name}": value for name, value in self._peak.items()
        }
        named |= {f"sum.{name}": value for name, value in self._sum.items()}
        named |= {f"angle.{name}": value for name, value in self._angle.items()}
        named |= {"turn": self._turn, "scans": self._scans}
        return {"row": row} | {name: value[row] for name, value in named.items()}

    def merge(self, state: dict[str, NDArray[Any]]) -> None:
        """Take in what another gathered (:meth:`state`) of other scans for the same alarms."""
        row = state["row"]
        for name, value in self._peak.items():
            value[row] = np.maximum(value[row], state[f"peak.{name}"])
        for kind, group in (("sum", self._sum), ("angle", self._angle)):
            for name, value in group.items():
                value[row] += state[f"{kind}.{name}"]
        self._turn[row] += state["turn"]
        self._scans[row] += state["scans"]

    def psi(self, mean: Literal["circular", "linear"]) -> FloatArray:
        """Compute P_psi (alarm, subband) by a mean of directions or of numbers, rad; NaN where no scan counts."""
        weight = self._angle["weight"]
        with np.errstate(invalid="ignore", divide="ignore"):
            values = (
                np.angle(self._turn) / 2 if mean == "circular" else self._angle["P_psi"] / weight
            )
        return np.where(weight > 0, values, np.nan)

    def table(self) -> pd.DataFrame:
        """Compute the features from the sums, with the index of the alarms; NaN where no scan counts.

        ``scans`` is the number of those that count; per sub-band follow the ten features as ``FEATURE_SUBBAND``, angles
        in rad.
        """
        with np.errstate(invalid="ignore", divide="ignore"):
            ten = {
                **{
                    f"M_{pol}": np.where(np.isfinite(peak), peak, np.nan)
                    for pol, peak in self._peak.items()
                },
                **{f"C_{pol}": self._sum[f"C_{pol}"] / self._sum[pol] for pol in ("HH", "VV")},
                **{
                    f"R_{pol}_HV": self._sum[f"R_{pol}_HV"] / self._sum[pol] for pol in ("HH", "VV")
                },
                **{name: self._angle[name] / self._angle["weight"] for name in POLARIMETRIC},
            }
            ten["P_psi"] = self.psi(self.settings.psi)
        names = [f"{name}_{subband}" for subband in self.subbands for name in FEATURES]
        values = np.stack([ten[name] for name in FEATURES], axis=2).reshape(
            len(self._index), len(names)
        )
        table = pd.DataFrame(values, self._index, names)
        table.insert(0, "scans", self._scans)
        return table

    def _look(
        self, magnitude: NDArray[np.float32], coherent: NDArray[np.complex64], pose: FloatArray
    ) -> tuple[NDArray[Any], ...]:
        """Tell which alarms a scan sees and their regions' statistics; cut their coherent patches."""
        grid = self.grid
        local = lane_to_scan(self._centres, pose)[:, :2]
        row, column = (local[:, 1] - grid.y_min) / grid.dy, (local[:, 0] - grid.x_min) / grid.dx
        reach = (local[:, 1] <= self.settings.y_max) & (row >= 0) & (row <= grid.ny - 1)
        reach &= (column >= 0) & (column <= grid.nx - 1)
        seen = np.flatnonzero(reach)
        values = self._statistics(magnitude, row[seen], column[seen])
        keep = np.isfinite(values).all(axis=(1, 2, 3))
        seen = seen[keep]
        values = values[keep]
        return seen, values, *self._patches(coherent, row[seen], column[seen])

    def _statistics(
        self, magnitude: NDArray[np.float32], row: FloatArray, column: FloatArray
    ) -> FloatArray:
        patch = self.settings.patch
        channels = magnitude.shape[:2]
        out = np.empty((row.size, channels[0] * channels[1], 1, 4))
        if row.size:
            offset = (np.arange(patch.size) - patch.size // 2) * patch.spacing / self.grid.dx
            flat = np.ascontiguousarray(magnitude.reshape(-1, *magnitude.shape[2:]))
            region_statistics(flat, row, column, offset, self._regions[None], out)
        return out.reshape(row.size, *channels, 4)

    def _patches(
        self, coherent: NDArray[np.complex64], row: FloatArray, column: FloatArray
    ) -> tuple[NDArray[Any], ...]:
        """Cut patches (polarization, subband, alarm, y, x) about places; tell which the image holds, and only those.

        They are not interpolated: the phase turns by up to a cycle from pixel to pixel.
        """
        half = _AVERAGE // 2
        nx, ny = (n // 2 + half for n in self.settings.inner)
        y = np.rint(row).astype(np.intp)
        x = np.rint(column).astype(np.intp)
        fits = (y - ny >= 0) & (y + ny < self.grid.ny) & (x - nx >= 0) & (x + nx < self.grid.nx)
        rows = y[fits, None, None] + np.arange(-ny, ny + 1)[:, None]
        columns = x[fits, None, None] + np.arange(-nx, nx + 1)
        return coherent[:, self._coherent, rows, columns], fits

    def _add_incoherent(self, seen: NDArray[np.intp], values: FloatArray) -> None:
        cross = values[:, self._hv]
        for name, place in (("HH", self._hh), ("VV", self._vv)):
            own = values[:, place]
            peak = own[..., PEAK]
            np.maximum.at(self._peak[name], seen, peak)  # Eq. 6
            np.add.at(self._sum[name], seen, peak)
            with np.errstate(invalid="ignore", divide="ignore"):
                contrast = peak * (peak - own[..., OUTER_MEAN]) / own[..., OUTER_STD]  # Eq. 7
                ratio = peak * own[..., MEAN] / cross[..., MEAN]  # Eq. 8
                np.add.at(self._sum[f"C_{name}"], seen, contrast)
                np.add.at(self._sum[f"R_{name}_HV"], seen, ratio)

    def _add_coherent(
        self, seen: NDArray[np.intp], weight: FloatArray, patch: NDArray[np.complex64]
    ) -> None:
        """Add the polarimetric values at the pixels about each alarm, weighed by m_in(Y, "HH")."""
        if not weight.size:
            return
        half = _AVERAGE // 2
        hh = patch[self._hh].astype(np.complex128)
        hv = patch[self._hv].astype(np.complex128)
        vv = patch[self._vv].astype(np.complex128)
        inner = (Ellipsis, slice(half, -half), slice(half, -half))
        H, alpha = entropy_alpha_of(_valid_mean(coherency(hh, hv, vv), _AVERAGE))  # Eq. 10
        tau, psi = cameron(hh[inner], hv[inner], vv[inner])  # Eq. 13 to 15

        def add(total: NDArray[Any], value: NDArray[Any]) -> None:
            """Add the mean over R_in, times the weight, to the alarms' sums."""
            mean_in = value.mean(axis=(-2, -1)).T
            np.add.at(total[:, self._coherent], seen, weight * mean_in)

        add(self._angle["P_H"], H)  # Eq. 11
        add(self._angle["P_alpha"], alpha)  # Eq. 12
        add(self._angle["P_tau"], tau)  # Eq. 16
        add(self._angle["P_psi"], psi)  # Eq. 17
        add(self._turn, np.exp(2j * psi))  # for the circular mean, which Eq. 17 is not
        np.add.at(self._angle["weight"][:, self._coherent], seen, weight)  # their denominator


def _valid_mean(matrix: NDArray[np.complex128], size: int) -> NDArray[np.complex128]:
    """Mean over the windows of ``size`` pixels that lie wholly in (..., y, x, 3, 3)."""
    ny, nx = matrix.shape[-4] - size + 1, matrix.shape[-3] - size + 1
    down = np.sum([matrix[..., i : i + ny, :, :, :] for i in range(size)], axis=0)
    across: NDArray[np.complex128] = np.sum(
        [down[..., i : i + nx, :, :] for i in range(size)], axis=0
    )
    return across / size**2
