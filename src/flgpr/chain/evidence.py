"""What explains an alarm: its patches by scan and channel, range cut, A-scan and polarimetric point."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from flgpr.features import PatchShape
from flgpr.features.polarimetry import entropy_alpha_of
from flgpr.kernels.focus import focus
from flgpr.kernels.sampling import bilinear
from flgpr.kernels.windows import WINDOWS, band_weights
from flgpr.model import SPEED_OF_LIGHT, ground_points, lane_to_scan, vehicle_to_scan
from flgpr.screen.views import grid_of, look_weight

MOST_SCANS = 4  # the nearest, where resolution is best
# alarms that are explained; of how many, the strongest, it is gathered
MOST_ALARMS = 1000
MOST_GATHERED = 4000
Maps = Mapping[str, NDArray[Any]]
Parts = Callable[[xr.DataArray], tuple[Maps, Maps]]
_CUT = np.round(np.arange(-40, 41) * 0.05, 3)
_TRACE = np.round(np.arange(-80, 81) * 0.025, 4)
_FLOOR = 1e-6


@dataclass(frozen=True)
class Evidence:
    """What explains the alarms of a detection, in the order of its table, at most ``MOST_ALARMS`` of them."""

    #: polarization, subband: channels
    polarization: list[str]
    subband: list[str]
    patch: PatchShape  #: shape of the patches
    #: cut, trace: range offsets of the cuts and of the A-scans about the alarm, m; ``trace`` is empty without raw data
    cut: NDArray[np.float64]
    trace: NDArray[np.float64]
    #: per alarm, nearest scan first: ``scan``, ``distance`` (m, ground range from the array)
    scans: list[list[dict[str, Any]]]
    #: per alarm (scan, value), dB: patches (polarization, subband, y, x), cuts (polarization, subband, cut), A-scans
    #: (polarization, trace), one after the other; NaN outside the image
    blocks: list[NDArray[np.float16]]
    polarimetric: (
        pd.DataFrame
    )  #: ``entropy`` and ``alpha`` (rad) per alarm; NaN where a polarization is missing
    #: adds, alone: what a look's value is made of, where the map tells, and what explains it without adding up
    adds: list[str] = field(default_factory=list)
    alone: list[str] = field(default_factory=list)
    #: per alarm and look, nearest first: scan, distance (m), share of the weight, then a value each of these
    causes: list[NDArray[np.float64]] = field(default_factory=list)


@dataclass(frozen=True)
class _Look:
    scan: int
    distance: float
    values: NDArray[np.float16]


def decibels(magnitude: ArrayLike) -> NDArray[np.float16]:
    """Take magnitudes to dB in half precision, good to 1/32 dB below 64 dB; not below -120 dB; NaN stays."""
    return np.asarray(20 * np.log10(np.maximum(magnitude, _FLOOR)), dtype=np.float16)


def in_order(evidence: Evidence, rows: NDArray[np.intp]) -> Evidence:
    """Bring evidence into the order of ranked alarms, given the rows that they had; the first ``MOST_ALARMS`` only."""
    known = len(evidence.scans)
    wanted = rows[:MOST_ALARMS]
    scans = [evidence.scans[row] if row < known else [] for row in wanted]
    blocks = [
        evidence.blocks[row] if row < known else np.zeros((0, 0), np.float16) for row in wanted
    ]
    points = evidence.polarimetric.reindex(wanted).reset_index(drop=True)
    columns = 3 + len(evidence.adds) + len(evidence.alone)
    causes = [evidence.causes[row] if row < known else np.zeros((0, columns)) for row in wanted]
    return replace(evidence, scans=scans, blocks=blocks, polarimetric=points, causes=causes)


def confidence_contributions(
    evidence: Evidence, slope: float, confidence: ArrayLike
) -> pd.DataFrame:
    """Split confidences, linear in the map with this slope, into what each part adds and a ``constant``.

    NaN where an alarm is not explained.
    """
    count = len(evidence.adds)
    total = np.asarray(confidence, dtype=np.float64)
    shares = np.full((len(total), count), np.nan)
    for row, one in enumerate(evidence.causes):
        if len(one):
            shares[row] = slope * one[:, 2] @ one[:, 3 : 3 + count]
    return pd.DataFrame(shares, columns=evidence.adds).assign(constant=total - shares.sum(axis=1))


class EvidenceSums:
    """What explains alarms, gathered scan by scan, from the ``MOST_SCANS`` nearest scans that see each.

    Alarms (x, y in the lane frame, m) come the most mine-like first. A-scans need the ``run``;
    ``subband`` is that of the polarimetric point, default the first. ``poses`` are those (6,) of
    all scans that will be taken in, here or by others, as far as they see the same alarms: with
    them only the scans that will be kept are cut up. ``parts`` gives the maps of a cleaned image
    that add up to what alarms are raised on, and others; the run-view weighs looks by their
    distance to the power -``falloff``.
    """

    def __init__(
        self,
        alarms: pd.DataFrame,
        patch: PatchShape,
        y_max: float,
        run: xr.Dataset | None = None,
        subband: str | None = None,
        poses: Mapping[int, NDArray[np.float64]] | None = None,
        parts: Parts | None = None,
        falloff: float = 0.0,
    ) -> None:
        self._points = ground_points(alarms)
        self._patch = patch
        self._y_max = y_max
        self._run = run
        self._subband = subband
        self._looks: list[list[_Look]] = [[] for _ in self._points]
        self._seen = np.zeros(len(self._points), bool)
        self._coherency = np.zeros((len(self._points), 3, 3), np.complex128)
        self._channels: tuple[list[str], list[str]] = ([], [])
        self._parts = parts
        self._falloff = falloff
        self._names: tuple[list[str], list[str]] = ([], [])
        self._causes: list[
            tuple[NDArray[np.intp], NDArray[np.float64]]
        ] = []  # numbers of alarms, and a row each
        self._poses = poses
        self._nearest: list[set[int]] | None = None

    @cached_property
    def _kernel(self) -> NDArray[np.complex128]:
        return range_kernel(
            np.zeros(2) if self._run is None else self._run["frequency"].values, _TRACE
        )

    def add(self, image: xr.DataArray, signal: NDArray[np.complex64] | None = None) -> None:
        """Take in a cleaned scan image (polarization, subband, y, x) in the scan frame with ``scan`` and ``pose``.

        ``signal`` is the run's data of the scan, where it has been read already.
        """
        polarization, subband = (
            [str(label) for label in image[n].values] for n in ("polarization", "subband")
        )
        self._channels = (polarization, subband)
        scan = int(image.attrs["scan"])
        pose = np.asarray(image.attrs["pose"])
        local = lane_to_scan(self._points, pose)
        if self._poses is not None and self._nearest is None:
            self._nearest = self._nearest_scans(image, self._poses)
        seen = _in_sight(image, local, self._y_max)
        wanted = [
            int(number) for number in seen if self._nearest is None or scan in self._nearest[number]
        ]
        if wanted:
            parts = _samples(image, local[wanted], self._patch)
            if self._run is not None:
                read = (
                    np.asarray(self._run["signal"].isel(scan=scan).values)
                    if signal is None
                    else signal
                )
                tx, rx = (
                    vehicle_to_scan(self._run[name].values, pose)
                    for name in ("tx_position", "rx_position")
                )
                frequency = self._run["frequency"].values
                parts.append(focused_trace(read, frequency, tx, rx, local[wanted], self._kernel))
            values = np.concatenate(
                [decibels(part).reshape(len(wanted), -1) for part in parts], axis=1
            )
            for number, one in zip(wanted, values, strict=True):
                self._look(number, _Look(scan, _distance(local[number]), one.copy()))
        self._seen[seen] = True
        if seen.size and self._parts is not None:
            self._cause(image, seen, local[seen], self._parts(image))
        if seen.size:
            self._coherency[seen] += _coherency(
                image.sel(subband=self._subband or subband[0]), local[seen]
            )

    def _cause(
        self,
        image: xr.DataArray,
        seen: NDArray[np.intp],
        local: NDArray[np.float64],
        parts: tuple[Maps, Maps],
    ) -> None:
        """Take in what a look's value at each alarm in sight is made of."""
        self._names = list(parts[0]), list(parts[1])
        grid = grid_of(image)
        maps = [one for some in parts for one in some.values()]
        if maps:
            row, column = (local[:, 1] - grid.y_min) / grid.dy, (local[:, 0] - grid.x_min) / grid.dx
            values = bilinear(np.stack(maps), row, column).T
            distance = np.hypot(local[:, 0], local[:, 1])
            weight = look_weight(distance, self._falloff)
            scan = np.full(len(seen), float(image.attrs["scan"]))
            self._causes.append((seen, np.column_stack([scan, distance, weight, values])))

    def _nearest_scans(
        self, image: xr.DataArray, poses: Mapping[int, NDArray[np.float64]]
    ) -> list[set[int]]:
        """Find the scans of every alarm that will be kept; all images have the pixels of this one."""
        seeing: list[list[tuple[float, int]]] = [[] for _ in self._points]
        for scan, pose in poses.items():
            local = lane_to_scan(self._points, pose)
            for number in _in_sight(image, local, self._y_max):
                seeing[number].append((_distance(local[number]), scan))
        return [{scan for _, scan in sorted(some)[:MOST_SCANS]} for some in seeing]

    def state(self) -> dict[str, NDArray[Any]]:
        """Return every look that is kept, and the coherency of the alarms in sight, to be taken in by another."""
        looks = [(number, look) for number, some in enumerate(self._looks) for look in some]
        seen = np.flatnonzero(self._seen)
        polarization, subband = self._channels
        return {
            "alarm": np.array([number for number, _ in looks], dtype=np.int64),
            "scan": np.array([look.scan for _, look in looks], dtype=np.int64),
            "distance": np.array([look.distance for _, look in looks], dtype=np.float64),
            "values": _stacked([look for _, look in looks]),
            "seen": seen,
            "coherency": self._coherency[seen],
            "polarization": np.array(polarization, dtype=np.str_),
            "subband": np.array(subband, dtype=np.str_),
            "adds": np.array(self._names[0], dtype=np.str_),
            "alone": np.array(self._names[1], dtype=np.str_),
            "cause": np.concatenate([one for one, _ in self._causes] or [np.zeros(0, np.intp)]),
            "causes": np.concatenate([rows for _, rows in self._causes] or [np.zeros((0, 0))]),
        }

    def merge(self, state: dict[str, NDArray[Any]]) -> None:
        """Take in what another gathered of other scans for the same alarms."""
        if state["polarization"].size:
            self._channels = (
                [str(n) for n in state["polarization"]],
                [str(n) for n in state["subband"]],
            )
        if state["cause"].size:
            self._names = [str(n) for n in state["adds"]], [str(n) for n in state["alone"]]
            self._causes.append((state["cause"], state["causes"]))
        rows = zip(state["alarm"], state["scan"], state["distance"], state["values"], strict=True)
        for number, scan, distance, values in rows:
            self._look(int(number), _Look(int(scan), float(distance), values))
        self._seen[state["seen"]] = True
        self._coherency[state["seen"]] += state["coherency"]

    def result(self) -> Evidence:
        """Assemble the evidence."""
        entropy, alpha = entropy_alpha_of(self._coherency)
        return Evidence(
            *self._channels,
            self._patch,
            _CUT,
            _TRACE if self._run is not None else np.zeros(0),
            [
                [{"scan": look.scan, "distance": round(look.distance, 3)} for look in one]
                for one in self._looks
            ],
            [_stacked(one) for one in self._looks],
            pd.DataFrame({"entropy": entropy, "alpha": alpha}),
            *self._names,
            self._caused(),
        )

    def _caused(self) -> list[NDArray[np.float64]]:
        """Return every alarm's looks, nearest first, with their shares of the weight."""
        columns = 3 + sum(map(len, self._names))
        alarm = np.concatenate([one for one, _ in self._causes] or [np.zeros(0, np.intp)])
        rows = np.concatenate([rows for _, rows in self._causes] or [np.zeros((0, columns))])
        order = np.lexsort((rows[:, 0], rows[:, 1], alarm))
        alarm = alarm[order]
        rows = rows[order]
        borders = np.searchsorted(alarm, np.arange(len(self._points) + 1))
        parts = [rows[first:end].copy() for first, end in itertools.pairwise(borders)]
        for one in parts:
            one[:, 2] /= max(one[:, 2].sum(), np.finfo(float).tiny)
        return parts

    def _look(self, number: int, look: _Look) -> None:
        some = [*self._looks[number], look]
        self._looks[number] = sorted(some, key=lambda one: (one.distance, one.scan))[:MOST_SCANS]


def _stacked(looks: list[_Look]) -> NDArray[np.float16]:
    values = np.array([look.values for look in looks], dtype=np.float16)
    return values.reshape(len(looks), -1 if looks else 0)


def _distance(point: NDArray[np.float64]) -> float:
    return float(np.hypot(point[0], point[1]))


def _in_sight(image: xr.DataArray, local: NDArray[np.float64], y_max: float) -> NDArray[np.intp]:
    x, y = image["x"].values, image["y"].values
    inside = (
        (local[:, 0] >= x[0])
        & (local[:, 0] <= x[-1])
        & (local[:, 1] >= y[0])
        & (local[:, 1] <= y[-1])
    )
    return np.flatnonzero(inside & (local[:, 1] <= y_max))


def _samples(
    image: xr.DataArray, points: NDArray[np.float64], patch: PatchShape
) -> list[NDArray[np.float32]]:
    """Magnitudes about points (alarm, 3), by alarm and channel: patches (y, x), and cuts along the line of sight."""
    grid = grid_of(image)
    magnitude = np.abs(image.values)
    where = points[:, :2]
    away = where / np.maximum(np.hypot(where[:, :1], where[:, 1:]), np.finfo(float).tiny)
    parts = []
    for offsets in (
        np.broadcast_to(patch.offsets(), (len(where), patch.size, patch.size, 2)),
        _CUT[:, None] * away[:, None],
    ):
        at = where.reshape(-1, *[1] * (offsets.ndim - 2), 2) + offsets
        sampled = bilinear(
            magnitude, (at[..., 1] - grid.y_min) / grid.dy, (at[..., 0] - grid.x_min) / grid.dx
        )
        parts.append(np.moveaxis(sampled, 2, 0))
    return parts


def range_kernel(
    frequency: NDArray[np.float64], offsets: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Make the matrix (frequency, offset) ``w(f)·exp(+j4πfr/c)``, w the Hann window of sum one, r in m."""
    weight = band_weights(
        frequency, ((float(frequency[0]), float(frequency[-1])),), WINDOWS["hann"]
    )[0]
    scale = weight / max(float(weight.sum()), np.finfo(float).tiny)
    phase = 4 * np.pi * frequency[:, None] * offsets / SPEED_OF_LIGHT
    return np.asarray(scale[:, None] * np.exp(1j * phase), dtype=np.complex128)


def focused_trace(
    signal: NDArray[np.complex64],
    frequency: NDArray[np.float64],
    tx: NDArray[np.float64],
    rx: NDArray[np.float64],
    points: NDArray[np.float64],
    kernel: NDArray[np.complex128],
) -> NDArray[np.float32]:
    """A-scans (point, polarization, range) of the whole array focused on points: delays steered to each, then range.

    ``s(r) = mean over pair and f of w(f)·b(pair, f)·exp(+j2πf(L_pair + 2r)/c)`` with the Hann
    window w of mean one, for a scan's signal b (polarization, pair, frequency) and the ranges of
    the ``kernel``; antennas (pair, 3) and the points (point, 3) in the scan frame, m. A unit
    scatterer at the point alone gives the magnitude 1 at r = 0.
    """
    path = sum(np.linalg.norm(points[:, None] - ends, axis=-1) for ends in (tx, rx))
    out = np.empty((len(points), len(signal), kernel.shape[1]), np.float32)
    parts = np.stack([kernel.real, kernel.imag]).astype(np.float32)
    focus(np.asarray(signal, np.complex64), frequency / SPEED_OF_LIGHT, path, parts, out)
    return out


def _coherency(image: xr.DataArray, points: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Sum k·k^H over 5 x 5 pixels about each place, k the Pauli vector; zero where a polarization is missing."""
    labels = [str(label) for label in image["polarization"].values]
    cross = [label for label in ("HV", "VH") if label in labels]
    if not ({"HH", "VV"} <= set(labels) and cross):
        return np.zeros((len(points), 3, 3), np.complex128)
    x, y = image["x"].values, image["y"].values
    offset = np.arange(-2.0, 3.0)
    row = ((points[:, 1] - y[0]) / (y[1] - y[0]))[:, None, None] + offset[:, None]
    column = ((points[:, 0] - x[0]) / (x[1] - x[0]))[:, None, None] + offset
    pixels = np.broadcast_arrays(row, column)
    hh, vv = (bilinear(image.values[labels.index(name)], *pixels) for name in ("HH", "VV"))
    hv = np.mean([bilinear(image.values[labels.index(name)], *pixels) for name in cross], axis=0)
    vector = np.nan_to_num(
        np.stack([hh + vv, hh - vv, 2 * hv], axis=1).reshape(len(points), 3, -1)
    ) / np.sqrt(2)
    return np.asarray(vector @ vector.conj().swapaxes(1, 2), dtype=np.complex128)
