"""What explains an alarm: patches by scan and channel, range cut, A-scan and polarimetric point."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from operator import attrgetter

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from flgpr.features import PatchShape
from flgpr.features.polarimetry import entropy_alpha_of
from flgpr.method.look_samples import (
    CUT,
    TRACE,
    coherency_at,
    cuts_along_sight,
    decibels,
    focused_trace,
    in_sight,
    patches,
    range_kernel,
)
from flgpr.model import ground_points, lane_to_scan, vehicle_to_scan
from flgpr.model.run import polarizations_of
from flgpr.screen.views import grid_of, look_weight, sampled
from flgpr.types import (
    AnyArray,
    Arrays,
    Complex128Array,
    ComplexArray,
    Entries,
    Float32Array,
    FloatArray,
    IndexArray,
    floats,
)

MOST_SCANS = 4
"""Looks that explain an alarm: those of the nearest scans, where resolution is best."""
MOST_ALARMS = 1000
"""Alarms of a result that are explained, the most confident."""
MOST_GATHERED = 4000
"""Alarms that looks are gathered for, the strongest; which are confident is known only later."""
Maps = Mapping[str, AnyArray]
MapsOf = Callable[[xr.DataArray], tuple[Maps, Maps]]


@dataclass(frozen=True)
class Evidence:
    """What explains the alarms of a detection, at most ``MOST_ALARMS``, in their order."""

    polarization: list[str]  #: polarizations of the channels
    subband: list[str]  #: sub-bands of the channels
    patch: PatchShape  #: shape of the patches
    cut: FloatArray  #: range offsets of the cuts, m
    trace: FloatArray  #: range offsets of the A-scans, m; empty without raw data
    #: per alarm, nearest scan first: ``scan``, ``distance`` (m, ground range from the array)
    scans: list[list[Entries]]
    #: per alarm (scan, value), dB: patches (polarization, subband, y, x), cuts (polarization,
    #: subband, cut), A-scans (polarization, trace), one after the other; NaN outside the image
    blocks: list[NDArray[np.float16]]
    #: ``entropy`` and ``alpha`` (rad) per alarm; NaN where a polarization is missing
    polarimetric: pd.DataFrame
    #: what adds up to the value of a look, where the map says so
    adds: list[str] = field(default_factory=list)
    #: what explains the value of a look without adding up
    alone: list[str] = field(default_factory=list)
    #: per alarm and look, nearest first: scan, distance (m), share of the weight, then a value for
    #: each of ``adds`` and ``alone``
    causes: list[FloatArray] = field(default_factory=list)


@dataclass(frozen=True)
class _Look:
    """What a scan shows about an alarm."""

    scan: int
    distance: float  #: m, ground range from the array
    values: NDArray[np.float16]


def in_order(evidence: Evidence, rows: IndexArray) -> Evidence:
    """Bring evidence into the order of ranked alarms, of which the first ``MOST_ALARMS`` are kept.

    Parameters
    ----------
    evidence : Evidence
        Evidence in the order in which the alarms were raised.
    rows : (alarm,) ndarray of int
        The numbers that the ranked alarms had in that order.
    """
    explained = len(evidence.scans)
    columns = 3 + len(evidence.adds) + len(evidence.alone)
    chosen = rows[:MOST_ALARMS]
    scans: list[list[Entries]] = []
    blocks = []
    causes = []
    for row in chosen:
        if row < explained:
            scans.append(evidence.scans[row])
            blocks.append(evidence.blocks[row])
            causes.append(evidence.causes[row])
        else:
            scans.append([])
            blocks.append(np.zeros((0, 0), np.float16))
            causes.append(np.zeros((0, columns)))
    points = evidence.polarimetric.reindex(chosen).reset_index(drop=True)
    return replace(evidence, scans=scans, blocks=blocks, polarimetric=points, causes=causes)


def confidence_contributions(
    evidence: Evidence, slope: float, confidence: ArrayLike
) -> pd.DataFrame:
    """Split confidences that are linear in the map into what each part of the map adds.

    Parameters
    ----------
    evidence : Evidence
        Evidence in the order of the alarms.
    slope : float
        Confidence per unit of the map.
    confidence : (alarm,) array_like
        The confidences.

    Returns
    -------
    DataFrame
        A column for each of ``evidence.adds``, and the ``constant``; NaN where an alarm is not
        explained.
    """
    count = len(evidence.adds)
    total = floats(confidence)
    shares = np.full((len(total), count), np.nan)
    for row, looks in enumerate(evidence.causes):
        if len(looks):
            weight = looks[:, 2]
            values = looks[:, 3 : 3 + count]
            shares[row] = slope * weight @ values
    table = pd.DataFrame(shares, columns=evidence.adds)
    return table.assign(constant=total - shares.sum(axis=1))


class EvidenceSums:
    """What explains alarms, gathered scan by scan from the ``MOST_SCANS`` nearest that see each.

    Parameters
    ----------
    alarms : DataFrame
        ``x``, ``y`` in the lane frame, m; the strongest first.
    patch : PatchShape
        Shape of the patches.
    y_max : float
        Farthest distance ahead of the array that counts, m.
    run : xarray.Dataset, optional
        The run, whose data A-scans are made of; without it there are none.
    subband : str, optional
        Sub-band of the polarimetric point; by default the first.
    poses : mapping of int to (6,) ndarray, optional
        Poses of all scans that see the same alarms, by scan number, whether they are added here or
        by others. With them only the nearest scans of every alarm are sampled.
    maps_of : callable, optional
        Returns the maps of a cleaned image that add up to what alarms are raised on, and those that
        explain it without adding up.
    falloff : float
        The run-view weighs looks by their distance to the power -``falloff``.
    """

    def __init__(
        self,
        alarms: pd.DataFrame,
        patch: PatchShape,
        y_max: float,
        run: xr.Dataset | None = None,
        subband: str | None = None,
        poses: Mapping[int, FloatArray] | None = None,
        maps_of: MapsOf | None = None,
        falloff: float = 0.0,
    ) -> None:
        self._points = ground_points(alarms)
        self._patch = patch
        self._y_max = y_max
        self._run = run
        self._subband = subband
        self._poses = poses
        self._maps_of = maps_of
        self._falloff = falloff
        self._looks: list[list[_Look]] = [[] for _ in self._points]
        self._seen = np.zeros(len(self._points), bool)
        self._coherency = np.zeros((len(self._points), 3, 3), np.complex128)
        self._channels: tuple[list[str], list[str]] = ([], [])
        self._names: tuple[list[str], list[str]] = ([], [])
        # Of every scan the numbers of alarms, and a row each of what their look is made of.
        self._causes: list[tuple[IndexArray, FloatArray]] = []
        self._nearest: list[set[int]] | None = None

    @cached_property
    def _kernel(self) -> Complex128Array:
        frequency = np.zeros(2) if self._run is None else self._run["frequency"].values
        return range_kernel(frequency, TRACE)

    def add(self, image: xr.DataArray, signal: ComplexArray | None = None) -> None:
        """Add a scan.

        Parameters
        ----------
        image : (polarization, subband, y, x) DataArray of complex
            Its cleaned image in the scan frame, with ``scan`` and ``pose``.
        signal : (polarization, pair, frequency) ndarray of complex, optional
            Its data, where they have been read already.
        """
        subband = _texts(image["subband"].values)
        self._channels = (polarizations_of(image), subband)
        points = lane_to_scan(self._points, floats(image.attrs["pose"]))
        if self._poses is not None and self._nearest is None:
            self._nearest = self._nearest_scans(image, self._poses)

        visible = in_sight(image, points, self._y_max)
        self._sample(image, signal, visible, points)
        self._seen[visible] = True
        if visible.size and self._maps_of is not None:
            adding, alone = self._maps_of(image)
            self._add_causes(image, visible, points[visible], adding, alone)
        if visible.size:
            one_band = image.sel(subband=self._subband or subband[0])
            self._coherency[visible] += coherency_at(one_band, points[visible])

    def _sample(
        self,
        image: xr.DataArray,
        signal: ComplexArray | None,
        visible: IndexArray,
        points: FloatArray,
    ) -> None:
        """Add a look for each alarm in sight of which the scan is one of the nearest."""
        scan = int(image.attrs["scan"])
        chosen = []
        for number in visible.tolist():
            if self._nearest is None or scan in self._nearest[number]:
                chosen.append(number)
        if not chosen:
            return
        chosen_points = points[chosen]
        magnitude = image.copy(data=np.abs(image.values))
        samples = [
            patches(magnitude, chosen_points, self._patch),
            cuts_along_sight(magnitude, chosen_points),
        ]
        if self._run is not None:
            samples.append(self._traces(self._run, image, signal, chosen_points))
        in_decibels = [decibels(sample).reshape(len(chosen), -1) for sample in samples]
        values = np.concatenate(in_decibels, axis=1)
        for number, of_alarm in zip(chosen, values, strict=True):
            look = _Look(scan, _ground_range(points[number]), of_alarm.copy())
            self._keep_nearest(number, look)

    def _traces(
        self,
        run: xr.Dataset,
        image: xr.DataArray,
        signal: ComplexArray | None,
        points: FloatArray,
    ) -> Float32Array:
        """Return the A-scans (point, polarization, range) of a scan at points in its frame."""
        if signal is None:
            signal = np.asarray(run["signal"].isel(scan=int(image.attrs["scan"])).values)
        pose = floats(image.attrs["pose"])
        tx = vehicle_to_scan(run["tx_position"].values, pose)
        rx = vehicle_to_scan(run["rx_position"].values, pose)
        return focused_trace(signal, run["frequency"].values, tx, rx, points, self._kernel)

    def _add_causes(
        self,
        image: xr.DataArray,
        visible: IndexArray,
        points: FloatArray,
        adding: Maps,
        alone: Maps,
    ) -> None:
        """Add what the value of the look at each alarm in sight is made of.

        ``adding`` are maps that add up to it, ``alone`` those that explain it without adding up.
        """
        self._names = list(adding), list(alone)
        maps = [*adding.values(), *alone.values()]
        if not maps:
            return
        values = sampled(np.stack(maps), grid_of(image), points).T
        distance = np.hypot(points[:, 0], points[:, 1])
        weight = look_weight(distance, self._falloff)
        scan = np.full(len(visible), float(image.attrs["scan"]))
        self._causes.append((visible, np.column_stack([scan, distance, weight, values])))

    def _nearest_scans(
        self, image: xr.DataArray, poses: Mapping[int, FloatArray]
    ) -> list[set[int]]:
        """Return the nearest scans of every alarm; all images have the pixels of this one."""
        by_distance: list[list[tuple[float, int]]] = [[] for _ in self._points]
        for scan, pose in poses.items():
            points = lane_to_scan(self._points, pose)
            for number in in_sight(image, points, self._y_max):
                by_distance[number].append((_ground_range(points[number]), scan))
        nearest = []
        for scans in by_distance:
            scans.sort()
            nearest.append({scan for _, scan in scans[:MOST_SCANS]})
        return nearest

    def state(self) -> Arrays:
        """Return all looks, and the coherency of the alarms in sight, for :meth:`merge`."""
        alarms = []
        looks = []
        for number, of_alarm in enumerate(self._looks):
            alarms += [number] * len(of_alarm)
            looks += of_alarm
        in_sight_once = np.flatnonzero(self._seen)
        polarization, subband = self._channels
        adds, alone = self._names
        cause_alarms, causes = self._joined_causes(columns=0)
        return {
            "alarm": np.array(alarms, dtype=np.int64),
            "scan": np.array([look.scan for look in looks], dtype=np.int64),
            "distance": np.array([look.distance for look in looks], dtype=np.float64),
            "values": _stacked(looks),
            "seen": in_sight_once,
            "coherency": self._coherency[in_sight_once],
            "polarization": np.array(polarization, dtype=np.str_),
            "subband": np.array(subband, dtype=np.str_),
            "adds": np.array(adds, dtype=np.str_),
            "alone": np.array(alone, dtype=np.str_),
            "cause": cause_alarms,
            "causes": causes,
        }

    def _joined_causes(self, columns: int) -> tuple[IndexArray, FloatArray]:
        """Return the causes of all scans; without any, an array of so many columns."""
        if not self._causes:
            return np.zeros(0, np.intp), np.zeros((0, columns))
        alarms = np.concatenate([alarms for alarms, _ in self._causes])
        rows = np.concatenate([rows for _, rows in self._causes])
        return alarms, rows

    def merge(self, state: Arrays) -> None:
        """Add what was gathered of other scans for the same alarms."""
        if state["polarization"].size:
            self._channels = (_texts(state["polarization"]), _texts(state["subband"]))
        if state["cause"].size:
            self._names = (_texts(state["adds"]), _texts(state["alone"]))
            self._causes.append((state["cause"], state["causes"]))
        rows = zip(state["alarm"], state["scan"], state["distance"], state["values"], strict=True)
        for number, scan, distance, values in rows:
            self._keep_nearest(int(number), _Look(int(scan), float(distance), values))
        self._seen[state["seen"]] = True
        self._coherency[state["seen"]] += state["coherency"]

    def result(self) -> Evidence:
        """Return the evidence of all alarms."""
        entropy, alpha = entropy_alpha_of(self._coherency)
        scans = []
        for looks in self._looks:
            scans.append(
                [{"scan": look.scan, "distance": round(look.distance, 3)} for look in looks]
            )
        polarization, subband = self._channels
        adds, alone = self._names
        return Evidence(
            polarization=polarization,
            subband=subband,
            patch=self._patch,
            cut=CUT,
            trace=TRACE if self._run is not None else np.zeros(0),
            scans=scans,
            blocks=[_stacked(looks) for looks in self._looks],
            polarimetric=pd.DataFrame({"entropy": entropy, "alpha": alpha}),
            adds=adds,
            alone=alone,
            causes=self._causes_by_alarm(),
        )

    def _causes_by_alarm(self) -> list[FloatArray]:
        """Return every alarm's looks, nearest first, with their shares of the weight."""
        columns = 3 + sum(map(len, self._names))
        alarm, rows = self._joined_causes(columns)
        order = np.lexsort((rows[:, 0], rows[:, 1], alarm))
        alarm = alarm[order]
        rows = rows[order]
        borders = np.searchsorted(alarm, np.arange(len(self._points) + 1))
        by_alarm = []
        for first, end in itertools.pairwise(borders):
            looks = rows[first:end].copy()
            looks[:, 2] /= max(looks[:, 2].sum(), np.finfo(float).tiny)
            by_alarm.append(looks)
        return by_alarm

    def _keep_nearest(self, number: int, look: _Look) -> None:
        """Add a look at an alarm, and drop the farthest if there are too many."""
        looks = sorted([*self._looks[number], look], key=attrgetter("distance", "scan"))
        self._looks[number] = looks[:MOST_SCANS]


def _texts(labels: AnyArray) -> list[str]:
    """Return an array of labels as plain texts."""
    return [str(label) for label in labels]


def _stacked(looks: Sequence[_Look]) -> NDArray[np.float16]:
    """Return the values (look, value) of looks."""
    values = np.array([look.values for look in looks], dtype=np.float16)
    return values.reshape(len(looks), -1 if looks else 0)


def _ground_range(point: FloatArray) -> float:
    """Return the distance of a point of the scan frame from the array, m."""
    return float(np.hypot(point[0], point[1]))
