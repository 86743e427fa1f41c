"""How well consecutive looks of a run agree, phase included: the figure that its geometry is judged by.

The image of a scan is compared with that of a later one at the same ground, where the poses place
it; what scans of other ground agree by, too, such as what stands still, is taken off. The images
are coarse: a patch of ground ahead, the lowest tones, like polarizations.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, combinations

import numpy as np

from flgpr.health.sums import LEAST_POWER
from flgpr.model.constants import SPEED_OF_LIGHT
from flgpr.model.frames import lane_to_scan, scan_to_lane, steps_of, vehicle_to_scan
from flgpr.types import ComplexArray, FloatArray, IndexArray

_UNEVEN = 1e-3  # of the step, by which tones that count as even may differ
_LEAST_TONES = 9
_MOST_TONES = 511  # enough for a coarse image
_OVERSAMPLING = 4  # of range profiles that are read by linear interpolation
_LEAST_SHARE = 0.05  # of the power that the paths of a scene and their mirror hold, to be compared
_CELL = 0.05  # of the height, m between points of the ground
_OTHER_GROUND = 1.3  # ratio of heights, from where on another patch of ground is looked at
_STEPS = (0.05, 60.0)  # m between scans of a vehicle that drives, least and most
_ARRAY = (0.02, 20.0)  # m, extent of an array
AIRBORNE = 100.0
"""Height above the ground, m, from where on no ground vehicle's array looks ahead."""


def like_polarized(polarizations: Sequence[str]) -> list[int]:
    """Return the numbers of the like polarizations, which see ground best; else of the first."""
    return [k for k, name in enumerate(polarizations) if name in ("HH", "VV")] or [0]


def looked_at(frequency: FloatArray) -> slice | None:
    """Return which tones looks are made of, an odd number; None: uneven, or fewer than nine.

    Parameters
    ----------
    frequency : (frequency,) ndarray of float
        Tones, Hz.
    """
    count = min(frequency.size, _MOST_TONES)
    if count < _LEAST_TONES:
        return None
    steps = np.diff(frequency)
    is_even = np.ptp(steps) < _UNEVEN * np.median(steps)
    return slice(count - 1 + count % 2) if is_even else None


@dataclass(frozen=True)
class Taken:
    """Some scans of a run, and how their data, antennas and poses are taken."""

    profiles: ComplexArray  #: (scan, polarization, pair, bin) by range
    bin_path: float  #: path of a bin, m
    carrier: float  #: the middle tone, Hz
    numbers: list[int]  #: of the scans in ``pose``
    stretches: list[list[int]]  #: places of scans that are compared with one another
    tx: FloatArray  #: (pair, 3) transmitters in the vehicle frame, m
    rx: FloatArray  #: (pair, 3) receivers
    pose: FloatArray  #: (scan of the run, 6)
    stated_height: float  #: m, as recorded: heights alike look at the same patch of ground

    @property
    def height(self) -> float:
        """Height of the antennas above the ground, m."""
        return mean_height(self.pose, self.tx, self.rx)

    @property
    def step(self) -> float:
        """Usual distance between scans, m."""
        return float(np.median(steps_of(self.pose)))

    @property
    def is_possible(self) -> bool:
        """Whether a vehicle may have such an array and course."""
        extent = float(np.ptp(np.concatenate([self.tx, self.rx]), axis=0).max())
        return (
            0.1 < self.height < AIRBORNE
            and _STEPS[0] < self.step < _STEPS[1]
            and (len(self.tx) == 1 or _ARRAY[0] < extent < _ARRAY[1])
        )

    def is_like(self, other: Taken) -> bool:
        """Whether it is the same but for what no look can show."""
        return (
            self.profiles is other.profiles
            and np.array_equal(self.tx, other.tx)
            and np.array_equal(self.rx, other.rx)
            and np.allclose(self.pose[:, :3], other.pose[:, :3], atol=1e-3)
            and np.allclose(self.pose[:, 3:], other.pose[:, 3:], atol=np.deg2rad(0.1))
        )

    def ground(self) -> FloatArray:
        """Return a patch of ground ahead, points (point, 3) in the scan frame, m."""
        is_same = abs(np.log(self.height / self.stated_height)) < np.log(_OTHER_GROUND)
        height = self.stated_height if is_same else self.height
        across = np.arange(-0.6, 0.61, _CELL)
        ahead = np.arange(1.0, 2.8, _CELL)
        x, y = np.meshgrid(across, ahead)
        return height * np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])

    @cached_property
    def _antennas(self) -> tuple[FloatArray, IndexArray]:
        """Places of the antennas, which pairs share, and numbers (2, pair) of those of each pair."""
        every = np.concatenate([self.tx, self.rx])
        places, numbers = np.unique(every, axis=0, return_inverse=True)
        return places, numbers.reshape(2, -1)

    def look(self, scan: int, points: FloatArray) -> ComplexArray:
        """Return the image (polarization, point) of a scan, of unit norm.

        Parameters
        ----------
        scan : int
            Its place among the scans.
        points : (point, 3) ndarray of float
            Points in the scan frame, m.
        """
        pose = self.pose[self.numbers[scan]]
        places, (tx, rx) = self._antennas
        way = np.linalg.norm(points - vehicle_to_scan(places, pose)[:, None], axis=-1)
        angle = (2 * np.pi * np.mod(self.carrier / SPEED_OF_LIGHT * way, 1)).astype(np.float32)
        turn = np.cos(angle) + 1j * np.sin(angle)
        position = (way[tx] + way[rx]) / self.bin_path
        below = position.astype(np.int32)
        share = (position - below).astype(np.float32)
        profiles = self.profiles[scan]
        bins = profiles.shape[-1]
        flat = profiles.reshape(len(profiles), -1)
        rows = bins * np.arange(profiles.shape[-2])[:, None]
        lower = flat.take(rows + below % bins, axis=-1)
        upper = flat.take(rows + (below + 1) % bins, axis=-1)
        image = ((lower + share * (upper - lower)) * (turn[tx] * turn[rx])).sum(axis=-2)
        power = np.linalg.norm(image, axis=-1, keepdims=True)
        return np.asarray(image / np.maximum(power, LEAST_POWER))

    def agreement(self, every: int = 1, points_every: int = 2) -> FloatArray:
        """Return how well the scans of a stretch agree, over what unrelated ones do.

        Parameters
        ----------
        every : int
            Looks at every so many stretches.
        points_every : int
            Looks at every so many points of the ground.

        Returns
        -------
        (value,) ndarray of float
            For every stretch of more than one scan, and polarization, the correlation of its looks
            (root of the mean square), from 0 to 1; chance is about 0.
        """
        points = self.ground()[::points_every]
        stretches = self.stretches[::every]
        looks = {scan: self.look(scan, points) for scan in sorted({*chain(*stretches)})}
        values = []
        for stretch in stretches:
            by_lag: dict[int, list[FloatArray]] = defaultdict(list)
            unrelated = [look for scan, look in looks.items() if scan not in stretch]
            for first, second in combinations(stretch, 2):
                before, after = (self.pose[self.numbers[scan]] for scan in (first, second))
                places = lane_to_scan(scan_to_lane(points, before), after)
                others = np.array([looks[first], *unrelated])
                alike = np.einsum("spn,pn->sp", others.conj(), self.look(second, places))
                power = np.abs(alike) ** 2
                chance = power[1:].mean(axis=0) if unrelated else 1 / len(points)
                by_lag[self.numbers[second] - self.numbers[first]].append(power[0] - chance)
            if by_lag:
                lags = [np.mean(of_lag, axis=0) for of_lag in by_lag.values()]
                mean = np.mean(lags, axis=0)
                # Of roots no single stretch with bright targets decides.
                values.append(np.sign(mean) * np.sqrt(np.abs(mean)))
        return np.concatenate(values) if values else np.zeros(0)

    def scene_db(self) -> float:
        """Return the power at the paths of a scene over that at their mirror, dB; NaN: not known."""
        power = (np.abs(self.profiles) ** 2).sum(axis=-2).reshape(-1, self.profiles.shape[-1])
        unambiguous = self.bin_path * power.shape[1]
        nearest = 2.1 * self.height
        farthest = min(8 * self.height, unambiguous / 2)
        if farthest < 1.3 * nearest:
            return np.nan
        paths = self.bin_path * np.arange(power.shape[1])
        scene, mirror = (
            power[:, (way > nearest) & (way < farthest)].sum(axis=1)
            for way in (paths, unambiguous - paths)
        )
        known = scene + mirror > _LEAST_SHARE * power.sum(axis=1)
        known &= (scene > 0) & (mirror > 0)
        ratio = scene[known] / mirror[known]
        return float(np.median(10 * np.log10(ratio))) if ratio.size else np.nan


def mean_height(pose: FloatArray, tx: FloatArray, rx: FloatArray) -> float:
    """Return the height of antennas (pair, 3) above the ground by poses (scan, 6), m."""
    return float(np.median(pose[:, 2]) + np.mean([tx[:, 2], rx[:, 2]]))


def taken(
    echoes: ComplexArray,
    frequency: FloatArray,
    numbers: Sequence[int],
    stretches: Sequence[Sequence[int]],
    tx: FloatArray,
    rx: FloatArray,
    pose: FloatArray,
) -> Taken:
    """Return scans as they are recorded.

    Parameters
    ----------
    echoes : (scan, polarization, pair, frequency) ndarray of complex
        Data without what stands still, of the tones that :func:`looked_at` says.
    frequency : (frequency,) ndarray of float
        These tones, Hz.
    numbers : sequence of int
        Numbers of the scans in ``pose``.
    stretches : sequence of sequence of int
        Places, among these scans, of consecutive ones that are compared with one another.
    tx, rx : (pair, 3) ndarray of float
        Antennas in the vehicle frame, m.
    pose : (scan of the run, 6) ndarray of float
        Poses.
    """
    tones = frequency.size
    bins = 1 << int(_OVERSAMPLING * tones - 1).bit_length()
    spectrum = np.zeros((*echoes.shape[:-1], bins), np.complex64)
    # The middle tone at zero: profiles turn slowly from bin to bin, and those of conjugated data are
    # conjugated and turned round.
    places = (np.arange(tones) - tones // 2) % bins
    spectrum[..., places] = echoes * np.hanning(tones + 2)[1:-1]
    # SciPy is not loaded for it, so that `flgpr info` begins at once.
    return Taken(
        np.fft.ifft(spectrum, axis=-1, norm="forward").astype(np.complex64),
        SPEED_OF_LIGHT / (float(np.median(np.diff(frequency))) * bins),
        float(frequency[tones // 2]),
        list(numbers),
        [list(stretch) for stretch in stretches],
        tx,
        rx,
        pose,
        mean_height(pose, tx, rx),
    )
