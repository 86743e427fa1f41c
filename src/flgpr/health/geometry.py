"""Whether data, antennas and poses fit one another, on a sub-sample of consecutive scans.

Three questions that need no target. Do echoes come from paths that a scene has, or from their
mirror, as when data are conjugated or their tones are in reverse order? Does the ground focus
better with another order of the receivers? Do consecutive looks agree where the poses say that they
should? The images are coarse: a patch of ground ahead, the lowest tones, one polarization at a time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flgpr.model.constants import SPEED_OF_LIGHT
from flgpr.model.frames import lane_to_scan, scan_to_lane, vehicle_to_scan
from flgpr.types import FloatArray

ComplexArray = NDArray[np.complexfloating]

_UNEVEN = 1e-3  # of the step, by which tones that count as even may differ
_MOST_TONES = 512  # enough for a coarse image
_OVERSAMPLING = 4  # of range profiles that are read by linear interpolation
_LEAST_SHARE = 0.05  # of the power that the paths of a scene and their mirror hold, to be compared
_BRIGHT = 12  # pixels whose focus is compared
_CELL = 0.05  # of the height, m of a pixel
_SMOOTH = 3  # pixels over which the levels of a look are averaged, both ways
_OVERLAP = 8  # least rows that two looks must share
AIRBORNE = 100.0
"""Height above the ground, m, from where on no ground vehicle's array looks ahead."""
BLOCKS = 4
"""Stretches of consecutive scans that are looked at."""
BLOCK_SCANS = 7
"""Scans of a stretch."""


def sampled_scans(scans: int) -> NDArray[np.intp]:
    """Return the numbers of the scans that are looked at: stretches, evenly over a run.

    Parameters
    ----------
    scans : int
        Scans of the run.
    """
    length = min(BLOCK_SCANS, scans)
    starts = np.unique(np.linspace(0, scans - length, BLOCKS).astype(int))
    return np.unique(starts[:, None] + np.arange(length)).astype(np.intp)


@dataclass
class GeometryFigures:
    """What scans show of paths, focus and poses: a value for each; empty lists: not checked."""

    #: power at paths of the scene over that at their mirror, dB
    path_db: list[float] = field(default_factory=list)
    #: focus with conjugated data over that with their tones reversed; above 1: conjugated
    conjugated: list[float] = field(default_factory=list)
    #: focus with the receivers in reverse order, less that as stated
    receivers: list[float] = field(default_factory=list)
    #: correlation of consecutive looks with the way driven backwards, less that as stated
    heading: list[float] = field(default_factory=list)
    #: likeness of consecutive images with the poses of the scan after, less that as stated
    late: list[float] = field(default_factory=list)
    #: the same with the poses of the scan before
    early: list[float] = field(default_factory=list)

    def add(self, name: str, value: float) -> None:
        """Add a value of a figure, unless it is not known."""
        if np.isfinite(value):
            getattr(self, name).append(float(value))

    def join(self, later: GeometryFigures, most: int) -> None:
        """Add the values of later scans, and keep the latest ``most`` of each figure."""
        for name, values in vars(self).items():
            values += getattr(later, name)
            del values[:-most]


def median(values: Sequence[float] | FloatArray) -> float:
    """Return the median of values; NaN where there are none."""
    return float(np.median(values)) if len(values) else np.nan


def mean(values: Sequence[float] | FloatArray) -> float:
    """Return the mean of values; NaN where there are none."""
    return float(np.mean(values)) if len(values) else np.nan


def deviations(values: Sequence[float] | FloatArray) -> float:
    """Return the mean of values over its standard error; 0 for fewer than four."""
    if len(values) < 4:
        return 0.0
    error = float(np.std(values, ddof=1)) / np.sqrt(len(values))
    return mean(values) / error if error > 0 else 0.0


def like_polarized(polarizations: Sequence[str]) -> list[int]:
    """Return the numbers of the like polarizations, which see ground best; else of the first."""
    return [k for k, name in enumerate(polarizations) if name in ("HH", "VV")] or [0]


class GeometryCheck:
    """Judges a sub-sample of scans.

    Parameters
    ----------
    frequency : (frequency,) ndarray of float
        Tones, Hz.
    tx_position, rx_position : (pair, 3) ndarray of float
        Antennas in the vehicle frame, m.
    polarizations : sequence of str
        Names of the polarizations.
    standing : (polarization, pair, frequency) ndarray of complex
        What stands still, and is no echo of the ground; like the polarizations for :meth:`figures`.
    """

    def __init__(
        self,
        frequency: FloatArray,
        tx_position: FloatArray,
        rx_position: FloatArray,
        polarizations: Sequence[str] = (),
        standing: ComplexArray | None = None,
    ) -> None:
        self._step = float(np.median(np.diff(frequency))) if frequency.size > 1 else np.nan
        even = frequency.size > 8 and np.ptp(np.diff(frequency)) < _UNEVEN * self._step
        self.tones = slice(0, min(frequency.size, _MOST_TONES)) if even else None
        self._frequency = frequency[self.tones] if even else frequency
        self._tx = tx_position
        self._rx = rx_position
        self.polarizations = like_polarized(polarizations)
        self._standing = np.zeros(1, np.complex64) if standing is None else standing

    @cached_property
    def _window(self) -> FloatArray:
        return np.asarray(np.hanning(self._frequency.size + 2)[1:-1])

    def figures(
        self, scans: Sequence[int], signals: Sequence[ComplexArray], pose: FloatArray
    ) -> GeometryFigures:
        """Judge scans.

        Parameters
        ----------
        scans : sequence of int
            Their numbers, ascending.
        signals : sequence of (polarization, pair, frequency) ndarray of complex
            Their data without gaps.
        pose : (scan, 6) ndarray of float
            Poses of the whole run.
        """
        found = GeometryFigures()
        if self.tones is None or not len(scans):
            return found
        height = float(np.median(pose[:, 2]) + np.mean([self._tx[:, 2], self._rx[:, 2]]))
        if not 0 < height < AIRBORNE:
            return found
        patch = Patch(height)
        for k in self.polarizations:
            before: tuple[int, ComplexArray, FloatArray] | None = None
            for number, signal in zip(scans, signals, strict=True):
                echoes = (signal[k] - self._standing[k])[:, self.tones]
                profiles, step = self.profiles(echoes)
                image = self._judge_scan(
                    found, number, echoes, (profiles, step), pose[number], patch
                )
                look = patch.look(image)
                if before is not None and before[0] == number - 1:
                    driven = _driven(pose, number - 1)
                    stated = patch.agreement(before[2], look, driven)
                    found.add("heading", patch.agreement(before[2], look, -driven) - stated)
                    alike = self._likeness(before[1], profiles, step, pose, number, patch)
                    found.add("late", alike[1] - alike[0])
                    found.add("early", alike[-1] - alike[0])
                before = (number, image, look)
        return found

    def _judge_scan(
        self,
        found: GeometryFigures,
        number: int,
        echoes: ComplexArray,
        profiled: tuple[ComplexArray, float],
        pose: FloatArray,
        patch: Patch,
    ) -> ComplexArray:
        """Add what a scan shows by itself; return its image (point,)."""
        profiles, step = profiled
        tx, rx = self.antennas(pose)
        path_db = self.scene_db(profiles, step, patch.height)
        found.add("path_db", path_db)
        image = self.image(profiles, step, tx, rx, patch.points)
        if number % 2:
            mirrored = self.image(profiles, step, tx, rx * [-1, 1, 1], patch.points)
            found.add("receivers", _focus(mirrored) - _focus(image))
        if path_db < 0:
            focus = [
                _focus(self.image(*self.profiles(other), tx, rx, patch.points))
                for other in (echoes.conj(), echoes[:, ::-1])
            ]
            found.add("conjugated", focus[0] / focus[1])
        return np.asarray(image.sum(axis=0))

    def _likeness(
        self,
        before: ComplexArray,
        profiles: ComplexArray,
        step: float,
        pose: FloatArray,
        number: int,
        patch: Patch,
    ) -> dict[int, float]:
        """Return how alike the ground looks to a scan and to the one before, phase included.

        Where the second lies from the first is taken from the poses as they are (0), from those of
        one scan later (1) and of one earlier (-1).
        """
        tx, rx = self.antennas(pose[number])
        seen = before[::2]
        alike = {}
        for shift in (0, 1, -1):
            first, second = number - 1 + shift, number + shift
            if first < 0 or second >= len(pose):
                alike[shift] = np.nan
                continue
            places = lane_to_scan(scan_to_lane(patch.points[::2], pose[first]), pose[second])
            again = self.image(profiles, step, tx, rx, places).sum(axis=0)
            power = np.linalg.norm(seen) * np.linalg.norm(again)
            alike[shift] = float(abs(np.vdot(again, seen)) / power) if power > 0 else np.nan
        return alike

    def antennas(self, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the antennas in the scan frame, whose origin is the ground below the array."""
        return vehicle_to_scan(self._tx, pose), vehicle_to_scan(self._rx, pose)

    def profiles(self, echoes: ComplexArray) -> tuple[ComplexArray, float]:
        """Return range profiles (..., pair, bin) of echoes, and the path of a bin, m."""
        tones = self._frequency.size
        size = 1 << int(_OVERSAMPLING * tones - 1).bit_length()
        spectrum = np.zeros((*echoes.shape[:-1], size), np.complex64)
        # the middle tone at zero: profiles turn slowly from bin to bin
        places = (np.arange(tones) - tones // 2) % size
        spectrum[..., places] = echoes * self._window
        profiles = np.fft.ifft(spectrum, axis=-1, norm="forward")
        return profiles, self.path_of(size)

    def path_of(self, bins: int) -> float:
        """Return the path of one of so many bins of a profile, m."""
        return SPEED_OF_LIGHT / (self._step * bins)

    @staticmethod
    def scene_db(profiles: ComplexArray, path: float, height: float) -> float:
        """Return the power at paths of the scene over that at their mirror, dB; NaN: not known."""
        power = (np.abs(profiles) ** 2).sum(axis=0)
        unambiguous = path * power.size
        nearest = 2.1 * height
        farthest = min(8 * height, unambiguous / 2)
        if farthest < 1.3 * nearest:
            return np.nan
        paths = path * np.arange(power.size)
        scene = power[(paths > nearest) & (paths < farthest)].sum()
        mirror = power[(unambiguous - paths > nearest) & (unambiguous - paths < farthest)].sum()
        if not (scene > 0 and mirror > 0 and scene + mirror > _LEAST_SHARE * power.sum()):
            return np.nan
        return float(10 * np.log10(scene / mirror))

    def image(
        self,
        profiles: ComplexArray,
        path: float,
        tx: FloatArray,
        rx: FloatArray,
        points: FloatArray,
    ) -> ComplexArray:
        """Return the image of every pair (..., pair, point)."""
        turns = self._frequency[self._frequency.size // 2] / SPEED_OF_LIGHT
        length = np.zeros(1, np.float64)
        turn: ComplexArray = np.ones(1, np.complex64)
        for antennas, (first, of_pair) in zip((tx, rx), self._antennas_used, strict=True):
            x, y, z = np.moveaxis(points - antennas[first, None], -1, 0)
            way = np.sqrt(x * x + y * y + z * z)
            angle = (2 * np.pi * np.mod(turns * way, 1)).astype(np.float32)
            length = length + way[of_pair]
            turn = turn * (np.cos(angle) + 1j * np.sin(angle))[of_pair]
        position = length / path
        below = position.astype(np.int32)
        share = (position - below).astype(np.float32)
        bins = profiles.shape[-1]
        flat = profiles.reshape(*profiles.shape[:-2], -1)
        rows = bins * np.arange(profiles.shape[-2])[:, None]
        lower = flat.take(rows + below % bins, axis=-1)
        upper = flat.take(rows + (below + 1) % bins, axis=-1)
        return np.asarray((lower + share * (upper - lower)) * turn)

    @cached_property
    def _antennas_used(self) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
        """For transmitters and receivers a pair that has each, and which of these a pair has."""
        used = []
        for places in (self._tx, self._rx):  # pairs share antennas
            _, first, of_pair = np.unique(places, axis=0, return_index=True, return_inverse=True)
            used.append((first, of_pair.ravel()))
        return used


class Patch:
    """Ground ahead of an array at a height, m, that a coarse image is made of."""

    def __init__(self, height: float) -> None:
        self.height = height
        self.cell = _CELL * height
        across = np.arange(-0.6 * height, 0.61 * height, self.cell)
        ahead = np.arange(height, 2.8 * height, self.cell)
        self.shape = (ahead.size, across.size)
        x, y = np.meshgrid(across, ahead)
        self.points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])

    def look(self, image: ComplexArray) -> FloatArray:
        """Return the levels (y, x) of an image, dB, without what only falls off with distance."""
        power = (np.abs(image) ** 2).reshape(self.shape)
        levels = 10 * np.log10(power + 1e-30)
        levels = levels - levels.mean(axis=1, keepdims=True)
        kernel = np.ones(_SMOOTH) / _SMOOTH
        for axis in (0, 1):
            levels = np.apply_along_axis(np.convolve, axis, levels, kernel, "same")
        return np.asarray(levels)

    def agreement(self, before: FloatArray, after: FloatArray, driven: float) -> float:
        """Return the correlation of two looks, the second one ``driven`` m farther on."""
        rows = driven / self.cell
        below = int(np.floor(rows))
        share = rows - below
        values = []
        for shift in (below, below + 1):
            if shift >= 0:
                first, second = before[shift:], after[: len(after) - shift]
            else:
                first, second = before[:shift], after[-shift:]
            if len(first) < _OVERLAP:
                return np.nan
            values.append(float(np.corrcoef(first.ravel(), second.ravel())[0, 1]))
        return (1 - share) * values[0] + share * values[1]


def _driven(pose: FloatArray, number: int) -> float:
    """Return how far a vehicle drives along its heading from a scan to the next, m."""
    there = np.array([*pose[number + 1][:2], 0.0])
    return float(lane_to_scan(there, pose[number])[1])


def _focus(image: ComplexArray) -> float:
    """Return the coherence factor over pairs at the brightest pixels, mean."""
    total = np.abs(image.sum(axis=0)) ** 2
    bright = np.argsort(total)[-_BRIGHT:]
    power = (np.abs(image[:, bright]) ** 2).sum(axis=0)
    return float((total[bright] / (len(image) * power + 1e-30)).mean())
