"""Errors of a track from scan to scan, told by the ground that several scans see.

Two scans a step apart see the same ground under nearly the same angle: their images of it, in bands
so narrow that an error of the poses stays within a range cell, are alike but for a phase. An error
d of one pose against the other turns a cell of ground by ``-4πf/c·g·d``; g is the mean of the unit
vectors from the cell to the antennas. Cells in all directions and several bands give d by least
squares, as phases of radar interferometry do (Bamler and Hartl, "Synthetic aperture radar
interferometry", Inverse Problems 14, 1998). The navigation's errors, independent from scan
to scan, are the prior; all pairs of scans together give the poses.

Ground that lies higher by h than its pixels also turns the phase, because the two scans see it
under different angles. With the horizontal shift by which ranges are kept that is
``-4πf/c·(Δsin θ + Δcos θ·tan θ)·h``, for a grazing angle θ that differs by Δ. A common h is estimated
beside the poses, and for every pair of scans a height and two slopes of its own.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
import scipy.sparse
import xarray as xr
from scipy.sparse.linalg import splu

from flgpr.calibrate.clock import Operator
from flgpr.model import SPEED_OF_LIGHT
from flgpr.model.ambiguity import grating_clear
from flgpr.model.aperture import antennas_in_lane
from flgpr.model.frames import heading_matrix, scan_to_lane, steps_of, vehicle_to_scan
from flgpr.progress import Track, silent
from flgpr.types import ComplexArray, FloatArray, floats

# In heights of the antennas: where the ground begins and ends ahead of them, how far it reaches to
# either side, the range cell of a band, and how far apart scans are compared.
_AHEAD = (1.4, 3.4)
_ASIDE = 0.8
_RANGE_CELL = 0.12
_REACH = 0.9
_PIXEL = 0.4  # of the range cell
_PIXELS = 4  # along either side of a cell of ground
_POSITION = 0.03  # m, standard deviation of the navigation's errors where none is given
_MOST_TURN = 1.2  # rad, of the lowest band by errors of the navigation
_ALIKE = 1.3  # rad², variance of the phases between looks that are alike; of any others 3.3
_LEAST_VARIANCE = 0.02  # rad²
_HEIGHT = 0.05  # m, standard deviation of the height of what echoes: some of it lies deeper
_OF_PAIR = (0.02, 0.01, 0.01)  # the same of a pair's ground, with slopes across and along, m per m
_APART = 0.2  # antenna heights of the way, in which pairs have ground in common
_SETTLED = 0.03  # rad, step of the highest band's phase at which rounds end
_ROUNDS = 8
_MOST_ERRORS = 4.0  # times its assumed errors, by which a pose is moved
_ENDS = ("tx_position", "rx_position")
_AT_ONCE = 300  # columns of the covariance
_DIFFERENCE = np.hstack([np.eye(4, 3), -np.eye(4, 3), np.eye(4)[:, 3:]])
"""(4, 7): errors of two scans and the height, to the errors' difference and the height."""


@dataclass(frozen=True)
class PoseFit:
    """Poses by the ground that several scans see."""

    pose: FloatArray  #: (scan, 6) corrected
    correction: FloatArray  #: (scan, 3) what was added to the reported position, m
    sigma: FloatArray  #: (scan, 3) standard deviation of the position, m
    #: error of a scan's pose against its neighbours', along the sight of the ground, rms, m
    before: float
    after: float  #: the same of the corrected poses, by their covariance, m
    position: float  #: standard deviation that was assumed of the navigation's errors, m
    height: float  #: of what echoes over the mean ground, m
    band: tuple[float, float]  #: that was looked at, Hz
    pairs: int  #: pairs of scans that were compared
    alike: int  #: of these, those whose images are alike
    alone: int  #: scans in none of these: the navigation alone tells their poses
    doubt: str  #: why the answer is not to be trusted; empty if it is

    @property
    def deviation(self) -> FloatArray:
        """The standard deviation (3,) of the positions across, along and up, rms over scans, m."""
        return floats(np.sqrt(np.mean(self.sigma**2, axis=0)))

    def table(self) -> pd.DataFrame:
        """Return by how much each pose was moved, with its standard deviation, m."""
        columns: dict[str, Any] = {"scan": np.arange(len(self.pose))}
        for axis, name in enumerate("xyz"):
            columns[f"{name}_moved_m"] = self.correction[:, axis]
            columns[f"{name}_sigma_m"] = self.sigma[:, axis]
        return pd.DataFrame(columns)


def focus_poses(
    run: xr.Dataset, operator: Operator, position: float | None = None, track: Track = silent
) -> PoseFit:
    """Estimate the errors of a run's poses by the ground that several of its scans see.

    Errors of a few scans against one another are found, which defocus a sum over scans. What all
    scans have in common, and what grows slowly along the road, stays the navigation's. A turn of
    the array moves its image and hardly changes its phase: heading, pitch and roll stay as they
    are.

    Parameters
    ----------
    run : xarray.Dataset
        A run of an array that looks ahead, without what stands still in its scans. Missing sweeps
        are left out.
    operator : callable
        ``flgpr.imaging.ImagingOperator``.
    position : float, optional
        Standard deviation of the navigation's errors of a coordinate, m. Default: 0.03, or the most
        that leaves the phases of the lowest band unambiguous.
    track : callable
        Passes the scans of every round through and shows progress.

    Returns
    -------
    PoseFit
        Poses with their uncertainty.

    Raises
    ------
    ValueError
        If ``position`` is not positive or makes phases of the lowest band ambiguous, the antennas
        are not above the ground, or no scans lie near enough to be compared.
    """
    scene = _Scene(run, operator, position)
    pose, height = scene.reported.copy(), 0.0
    for number in range(_ROUNDS):
        bands = min(2**number, len(scene.bands))
        scans = track(range(len(pose)), f"scans compared, round {number + 1}", len(pose))
        compared = [pair for last in scans for pair in scene.pairs(last, pose, height, bands)]
        if not compared:
            raise ValueError(
                f"run must have scans at most {scene.reach:.2g} m apart to be compared, got none"
            )
        most = _ALIKE if bands == len(scene.bands) else math.inf
        pairs = [pair for pair in compared if pair.variance < most]
        matrix, right = scene.normal_equations(pairs, pose, height)
        inverse = splu(matrix)
        step = inverse.solve(right)
        moved = step[:-1].reshape(-1, 3)
        pose[:, :3] += moved
        height += float(step[-1])
        if bands == len(scene.bands) and scene.turn(moved, pose) < _SETTLED:
            break
    return scene.answer(pose, height, compared, pairs, inverse)


@dataclass(frozen=True)
class _Ground:
    """Pixels of the ground ahead, in square cells."""

    points: FloatArray  #: (pixel, 3) in the scan frame, m
    shape: tuple[int, int]  #: cells along y and x

    @classmethod
    def of(cls, centre: FloatArray, cell: float) -> _Ground:
        """Return the ground before an array with its centre (3,) in the scan frame."""
        near, far = (centre[1] + heights * centre[2] for heights in _AHEAD)
        aside = _ASIDE * centre[2]
        pixel = _PIXEL * cell
        rows, columns = (int(side / (_PIXELS * pixel)) for side in (far - near, 2 * aside))
        y = near + pixel * (np.arange(rows * _PIXELS) + 0.5)
        x = centre[0] + pixel * (np.arange(columns * _PIXELS) - (columns * _PIXELS - 1) / 2)
        across, along = np.meshgrid(x, y)
        return cls(np.stack([across, along, 0 * along], -1).reshape(-1, 3), (rows, columns))

    def mean(self, values: Any) -> Any:
        """Return the means (..., cell) of values (..., pixel)."""
        rows, columns = self.shape
        cells = values.reshape(*values.shape[:-1], rows, _PIXELS, columns, _PIXELS)
        return cells.mean(axis=(-3, -1)).reshape(*values.shape[:-1], -1)


@dataclass(frozen=True)
class _Look:
    """Ground as a scan sees it."""

    image: ComplexArray  #: (polarization, band, pixel)
    slope: FloatArray  #: (cell, 3) of half the path, by the position of the array


@dataclass(frozen=True)
class _Pair:
    """What two looks say of the first scan's error less the second's, and of the height."""

    scans: tuple[int, int]
    information: FloatArray  #: (4, 4)
    right: FloatArray  #: (4,) right side of the normal equations
    variance: float  #: of a cell's phase, rad²; infinite if a look holds nothing


class _Scene:
    """A run whose scans are compared on the ground ahead of them."""

    def __init__(self, run: xr.Dataset, operator: Operator, position: float | None) -> None:
        self.reported = floats(run["pose"].values)
        self._run = run
        self._operator = operator
        self._data = np.nan_to_num(run["signal"].values)
        middle = np.median(self.reported, axis=0)
        ends = [vehicle_to_scan(run[name].values, middle) for name in _ENDS]
        self._centre = floats(np.mean(ends, axis=(0, 1)))
        height = float(self._centre[2])
        if not height > 0:
            raise ValueError(f"antennas must be above the ground, got a height of {height:.3g} m")
        self.reach = _REACH * height
        self._ground = _Ground.of(self._centre, _RANGE_CELL * height)
        self.bands = _bands(run, SPEED_OF_LIGHT / (2 * _RANGE_CELL * height))
        self._in_common = self._pairs_in_common(_APART * height)
        self.position = self._checked(position)

    def _pairs_in_common(self, apart: float) -> float:
        """Return how many pairs share ground: those in a stretch of the way, at least one.

        Their speckle and the shape of their ground are the same, so that they err together, by more
        the farther apart their scans are. Pairs of a vehicle that waits do not.
        """
        pairs = 0
        for last in range(len(self.reported)):
            pairs += sum(self._way(first, last) > apart / 10 for first in self._earlier(last))
        way = float(steps_of(self.reported).sum())
        return max(pairs * apart / max(way, apart), 1.0)

    def _checked(self, position: float | None) -> float:
        """Return the navigation's errors, m, which must leave the lowest band's phases unambiguous."""
        most = _MOST_TURN / (math.sqrt(2) * float(self._wavenumber(1)[0]))
        if position is None:
            return min(_POSITION, most)
        if not 0 < position < math.inf:
            raise ValueError(f"position must be positive, got {position:g}")
        if position > most:
            raise ValueError(
                f"position must be at most {most:.2g} m for the phases of the lowest band, around "
                f"{sum(self.bands[0]) / 2e9:.3g} GHz, to be unambiguous, got {position:g} m"
            )
        return position

    def pairs(self, last: int, pose: FloatArray, height: float, bands: int) -> Iterator[_Pair]:
        """Yield what a scan says together with scans one, two, four and so on before it."""
        earlier = list(self._earlier(last))
        if earlier:
            points = scan_to_lane(self._ground.points, pose[last])
            look = self._look(last, pose, points, bands)
            for first in earlier:
                other = self._look(first, pose, points, bands)
                yield self._pair((first, last), other, look, height)

    def _earlier(self, last: int) -> Iterator[int]:
        """Yield the numbers of the scans that a scan is compared with."""
        back = 1
        while back <= last:
            if self._way(last - back, last) > self.reach:
                return
            yield last - back
            back *= 2

    def _way(self, first: int, last: int) -> float:
        """Return how far two scans lie apart, m."""
        return float(np.hypot(*(self.reported[last] - self.reported[first])[:2]))

    def _look(self, scan: int, pose: FloatArray, points: FloatArray, bands: int) -> _Look:
        """Return ground (pixel, 3) of the lane as a scan sees it."""
        tx, rx = antennas_in_lane(self._run, pose[scan : scan + 1])
        tones = self._run["frequency"].values
        imaging = self._operator(tones, tx, rx, points, subbands=self.bands[:bands], window="hann")
        cells = self._ground.mean(points.T).T
        slope = np.mean([_directions(cells, end) for end in (tx, rx)], axis=0)
        return _Look(imaging.adjoint(self._data[scan]), slope)

    def _pair(self, scans: tuple[int, int], first: _Look, last: _Look, height: float) -> _Pair:
        """Return what two looks say of their scans, by least squares of their phases."""
        mean = self._ground.mean
        product = mean((first.image * last.image.conj()).sum(axis=0))
        powers = [mean((np.abs(look.image) ** 2).sum(axis=0)) for look in (first, last)]
        most = np.sqrt(powers[0] * powers[1])
        coherence = np.abs(product) / np.where(most > 0, most, np.inf)
        if not coherence.any():
            return _Pair(scans, np.zeros((4, 4)), np.zeros(4), math.inf)
        rise = _slope_of_height(first.slope, last.slope)
        wavenumber = self._wavenumber(len(product))[:, None]
        middles = mean(self._ground.points.T)[:2]
        tilts = middles - middles.mean(axis=1, keepdims=True)
        uneven = np.column_stack([rise, *(rise * tilts)])
        phase = np.angle(product * np.exp(1j * wavenumber * rise * height))
        weight = coherence**2
        variance = max(float(np.average(phase**2, weights=weight)), _LEAST_VARIANCE)
        weight /= weight.mean() * variance * self._in_common

        # By the difference of the errors, by the height of all ground, and by height and slopes
        # of this pair's.
        slope = (first.slope + last.slope) / 2
        columns = np.column_stack([slope, rise, uneven])
        design = (-wavenumber[..., None] * columns).reshape(-1, columns.shape[1])
        weighted = (design * weight.reshape(-1, 1)).T
        own_deviation = math.sqrt(self._in_common) * np.array(_OF_PAIR)
        information, right = _without_own(
            weighted @ design, weighted @ phase.ravel(), own_deviation
        )
        return _Pair(scans, information, right, variance)

    def _wavenumber(self, bands: int) -> FloatArray:
        """Return 4πf/c in the middle of the lowest bands (band,), rad/m."""
        return floats(2 * np.pi * np.sum(self.bands[:bands], axis=1) / SPEED_OF_LIGHT)

    def normal_equations(
        self, pairs: Sequence[_Pair], pose: FloatArray, height: float
    ) -> tuple[Any, FloatArray]:
        """Return matrix and right side for a step of all positions and, last, of the height."""
        prior = np.append(np.full(3 * len(pose), self.position), _HEIGHT) ** -2
        off = np.append((self.reported - pose)[:, :3], -height)
        right = prior * off
        every = np.arange(prior.size)
        values, rows, columns = [prior], [every], [every]
        for pair in pairs:
            coordinates = [3 * scan + axis for scan in pair.scans for axis in range(3)]
            place = np.append(coordinates, every[-1:])
            right[place] += _DIFFERENCE.T @ pair.right
            values.append((_DIFFERENCE.T @ pair.information @ _DIFFERENCE).ravel())
            rows.append(np.repeat(place, place.size))
            columns.append(np.tile(place, place.size))
        entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
        return scipy.sparse.csc_matrix(entries, shape=2 * (prior.size,)), right

    def turn(self, step: FloatArray, pose: FloatArray) -> float:
        """Return the phase by which a step (scan, 3) turns the highest band against neighbours, rad."""
        return float(self._wavenumber(len(self.bands))[-1]) * self._against_next(step, pose)

    def _against_next(self, error: FloatArray, pose: FloatArray) -> float:
        """Return errors (scan, 3) along the sight of the ground against the next scan's, rms, m."""
        along = (error * self._sight(pose)).sum(axis=1)
        return float(np.sqrt(np.mean(np.diff(along) ** 2)))

    def _sight(self, pose: FloatArray) -> FloatArray:
        """Return unit vectors (scan, 3) from the middle of a scan's ground to its array."""
        sight = self._centre - self._ground.points.mean(axis=0)
        return floats(heading_matrix(pose[:, 3]) @ (sight / np.linalg.norm(sight)))

    def answer(
        self,
        pose: FloatArray,
        height: float,
        compared: Sequence[_Pair],
        pairs: Sequence[_Pair],
        inverse: Any,
    ) -> PoseFit:
        """Return the poses, with their uncertainty and whether they can be trusted."""
        scans = len(pose)
        correction = pose[:, :3] - self.reported[:, :3]
        sigma = np.sqrt(_variances(inverse, scipy.sparse.eye(3 * scans + 1, 3 * scans)))
        sight = self._sight(pose)
        against = scipy.sparse.lil_matrix((3 * scans + 1, scans - 1))
        for scan in range(scans - 1):
            against[3 * scan : 3 * scan + 3, scan] = -sight[scan][:, None]
            against[3 * scan + 3 : 3 * scan + 6, scan] = sight[scan + 1][:, None]
        # Of the difference of two scans each has half the variance.
        after = math.sqrt(_variances(inverse, against).mean() / 2)
        before = math.hypot(self._against_next(correction, pose) / math.sqrt(2), after)
        told = {scan for pair in pairs for scan in pair.scans}
        fit = PoseFit(
            pose=pose,
            correction=correction,
            sigma=sigma.reshape(-1, 3),
            before=before,
            after=after,
            position=self.position,
            height=height,
            band=(self.bands[0][0], self.bands[-1][1]),
            pairs=len(compared),
            alike=len(pairs),
            alone=scans - len(told),
            doubt="",
        )
        return replace(fit, doubt=_doubt(fit))


def _bands(run: xr.Dataset, width: float) -> list[tuple[float, float]]:
    """Return bands (Hz) of about a width, up to where grating lobes come near."""
    tones = run["frequency"].values
    low, high = float(tones[0]), float(tones[-1])
    clear = grating_clear(*(run[name].values for name in _ENDS))
    high = min(high, max(clear, low + width))
    edges = np.linspace(low, high, max(1, round((high - low) / width)) + 1)
    return list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))


def _directions(cells: FloatArray, ends: FloatArray) -> FloatArray:
    """Return the mean unit vectors (cell, 3) from cells (cell, 3) to antennas (pair, 3)."""
    sight = ends - cells[:, None]
    return floats((sight / np.linalg.norm(sight, axis=-1, keepdims=True)).mean(axis=1))


def _slope_of_height(first: FloatArray, last: FloatArray) -> FloatArray:
    """Return how half the difference of two paths grows with the height of the ground.

    Higher ground is seen at pixels that lie nearer, so that the mean of the two ranges is kept.

    Parameters
    ----------
    first, last : (cell, 3) ndarray
        Slopes of half the paths by the positions of two arrays.
    """
    near = [np.hypot(slope[:, 0], slope[:, 1]) for slope in (first, last)]
    nearer = (first[:, 2] + last[:, 2]) / (near[0] + near[1])
    return floats(last[:, 2] - first[:, 2] + (near[0] - near[1]) * nearer)


def _without_own(
    information: FloatArray, right: FloatArray, deviation: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return normal equations of the first four unknowns; the others deviate from zero."""
    free = information[4:, 4:] + np.diag(deviation**-2.0)
    gain = np.linalg.solve(free, information[4:, :4]).T
    return information[:4, :4] - gain @ information[4:, :4], right[:4] - gain @ right[4:]


def _variances(inverse: Any, weights: Any) -> FloatArray:
    """Return the variances (sum,) of weighted sums of the unknowns, weights (unknown, sum)."""
    columns = weights.tocsc()
    parts = []
    for start in range(0, columns.shape[1], _AT_ONCE):
        part = columns[:, start : start + _AT_ONCE].toarray()
        parts.append((part * inverse.solve(part)).sum(axis=0))
    return floats(np.concatenate(parts))


def _doubt(fit: PoseFit) -> str:
    """Return the reason not to trust poses; empty if there is none."""
    if fit.alike < fit.pairs / 2:
        return (
            f"only {fit.alike} of {fit.pairs} pairs of scans see the ground alike: are poses right to "
            f"{1e3 * fit.position:.2g} mm, is the clock, and does the array look at the ground ahead?"
        )
    most = float(np.abs(fit.correction).max())
    if most > _MOST_ERRORS * fit.position:
        return (
            f"poses would be moved by up to {most:.3f} m, more than {_MOST_ERRORS:g} times their "
            f"assumed errors: are these larger than {fit.position:.2g} m?"
        )
    return ""
