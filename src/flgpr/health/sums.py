"""Sums over the scans of a run, from its raw data alone, that tell a radar at fault.

They stream: a scan enters once and is not kept, so that a stored run and a run that comes in scan
by scan are judged by the same numbers.
"""

from __future__ import annotations

from collections import deque
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flgpr.types import BoolArray, FloatArray

ComplexArray = NDArray[np.complexfloating]

LEAST_POWER = 1e-30
"""Power that stands for none where a level is taken, in the square of the signal's unit."""
LOWEST_SHARE = 20
"""Neighbouring receivers are compared on the lowest one in so many of the tones."""
REMEMBERED = 256
"""Latest scans whose delays and changes are remembered one by one."""
TONES_AROUND = 101
"""Tones around one whose median is what it is compared with."""
BURST_DB = 10.0
"""Level of a tone in one scan, over those around it, from which it stands out."""


_NEIGHBOURS_EVERY = 4  # scans between two whose neighbouring tones are compared
_SWEEPS_TOGETHER = 64  # whose sum of noise is small beside that of echoes
_LEAST_DELAYED = 8  # pairs whose delay is taken, if there are more
_MOST_IN_MEAN = 16  # scans in the mean that a scan's delay is taken from
_DECIBELS = 10 / np.log(10)  # of a natural logarithm
_MEDIAN_EVERY = 8  # tones between two medians of those around
_SUMMED = (
    *("scans", "sweeps", "power", "standing", "not_finite", "stuck", "steps", "change_db"),
    *("changes", "excess_db", "bursts", "repeated", "pair_products", "tone_power", "tone_sum"),
    *("delays", "clearness", "changed", "in_mean", "latest_mean"),
)
"""Attributes of the sums that a state holds; the quarters are those of a run that is known whole."""
_BESIDE = ("next_changes", "next_tones")
"""Those that are sums of neighbouring tones."""


class ScanFigures(NamedTuple):
    """What a scan shows by itself."""

    finite: BoolArray  #: (polarization, pair): sweeps without a value that is not finite
    level_db: FloatArray  #: (polarization, pair) over the median pair of its polarization
    excess_db: FloatArray  #: (frequency,) power of a tone over that of the tones around it
    repeated: bool  #: whether it holds the same numbers as the scan before
    change_db: float  #: power of its change from the scan before, over that of the scan


class TonesBeside:
    """How alike every tone and the next are, of sweeps that are added.

    The phase between them is that of the echoes' delay, which changes as an echo comes near: sweeps
    of few scans are added with their phase, and these sums by their magnitude.
    """

    def __init__(self, tones: int) -> None:
        between = max(tones - 1, 0)
        self.magnitude = np.zeros(between)
        self.product = np.zeros(between, np.complex128)  # of the latest sweeps
        self.sweeps = 0  # that it is of

    def add(self, sweeps: ComplexArray) -> None:
        """Add sweeps (polarization, pair, frequency)."""
        self.product += np.einsum("apf,apf->f", sweeps[..., 1:], sweeps[..., :-1].conj())
        self.sweeps += sweeps.shape[0] * sweeps.shape[1]
        if self.sweeps >= _SWEEPS_TOGETHER:
            self.magnitude += np.abs(self.product)
            self.product = np.zeros_like(self.product)
            self.sweeps = 0

    def likeness(self, power: FloatArray) -> FloatArray:
        """Return it over the power (frequency,) of all sweeps, 0 to 1 (frequency - 1,)."""
        both = np.sqrt(power[1:] * power[:-1])
        return np.asarray((self.magnitude + np.abs(self.product)) / np.maximum(both, LEAST_POWER))


class HealthSums:
    """Sums of what tells a radar at fault, scan by scan.

    Parameters
    ----------
    shape : tuple of int
        Polarizations, pairs and tones.
    scans : int, optional
        Scans that will come; with it the first and the last quarter are summed, which tell drift.
    """

    def __init__(self, shape: tuple[int, ...], scans: int = 0) -> None:
        self.shape = shape
        self._quarter = scans // 4
        self._total = scans
        polarizations, pairs, tones = shape
        channels = (polarizations, pairs)
        self.scans = 0
        self.sweeps = np.zeros(channels, np.int64)  # without a value that is not finite
        self.power = np.zeros(channels)  # sum over these of the mean power of the tones
        self.standing = np.zeros(shape, np.complex128)  # sum of these
        self.first = np.zeros(shape if self._quarter else (0, 0, 0), np.complex128)
        self.last = np.zeros_like(self.first)
        self.in_first = np.zeros(channels, np.int64)
        self.in_last = np.zeros(channels, np.int64)
        self.not_finite = np.zeros(shape, np.int32)  # values
        self.stuck = np.zeros(shape, np.int32)  # values equal to those of the scan before
        self.steps = np.zeros(channels, np.int64)  # from a finite sweep to the next
        self.change_db = np.zeros(tones)  # sum over steps of the mean over channels, dB
        self.changes = 0
        self.excess_db = np.zeros(tones)  # sum over scans of a tone's level over those around it
        self.bursts = np.zeros(tones, np.int64)  # scans in which it stands out
        self.repeated = 0  # scans that hold the numbers of the scan before
        # of a pair's change with another's, on the lowest tones; each change of a pair weighs the same
        self.pair_products = np.zeros((*channels, pairs), np.complex128)
        self.next_changes = TonesBeside(tones)  # of the changes from scan to scan
        self.tone_power = np.zeros(tones)  # of these
        self.next_tones = TonesBeside(tones)
        self.tone_sum = np.zeros(tones)  # of the power
        # of every scan, the latest: delay over that of scans before, as phase per tone, rad, how clear
        # it is (1 where all is delayed alike), and power of the change over that of the scan, dB
        self.delays = deque[float](maxlen=REMEMBERED)
        self.clearness = deque[float](maxlen=REMEMBERED)
        self.changed = deque[float](maxlen=REMEMBERED)
        # of some pairs, spread over all, the mean of the latest scans at one delay, and how many these
        # are: echoes that come near average out of it
        self._delayed = slice(None, None, max(pairs // _LEAST_DELAYED, 1))
        self.in_mean = 0
        self.latest_mean = np.zeros(shape, np.complex64)[:, self._delayed].copy()
        self._before: tuple[ComplexArray, BoolArray] | None = None  # a scan, and what is finite

    def add(self, signal: ComplexArray) -> ScanFigures:
        """Take in a scan (polarization, pair, frequency), and return what it shows by itself."""
        not_finite = ~np.isfinite(signal)
        finite: BoolArray = np.logical_not(np.any(not_finite, axis=-1))
        if not finite.all():
            self.not_finite += not_finite
            signal = np.where(not_finite, 0, signal)
        power = _power(signal)
        channel_power = power.mean(axis=-1, dtype=np.float64)
        self.sweeps += finite
        self.power += np.where(finite, channel_power, 0)
        if self.scans % _NEIGHBOURS_EVERY == 0:
            self.next_tones.add(signal)
            self.tone_sum += power.sum(axis=(0, 1), dtype=np.float64)
        whole = signal if finite.all() else np.where(finite[..., None], signal, 0)
        self.standing += whole
        self._add_quarters(whole, finite)
        excess = over_neighbours(_tone_levels(power, finite))
        self.excess_db += excess
        repeated, change_db = self._add_change(signal, finite, channel_power)
        if not repeated:
            self._add_delay(whole[:, self._delayed], channel_power[:, self._delayed])
        self.bursts += excess > BURST_DB
        self.changed.append(change_db)
        self.scans += 1
        return ScanFigures(finite, _levels(channel_power, finite), excess, repeated, change_db)

    def _add_quarters(self, whole: ComplexArray, finite: BoolArray) -> None:
        """Add a scan to the first or the last quarter of the run."""
        if self.scans < self._quarter:
            self.first += whole
            self.in_first += finite
        if self._quarter and self.scans >= self._total - self._quarter:
            self.last += whole
            self.in_last += finite

    def _add_delay(self, some: ComplexArray, power: FloatArray) -> None:
        """Add how much later a scan is than those before, as phase per tone, and how clearly.

        What stands still has the same phase in all, but for the delay: at that delay its correlation
        with their mean is greatest, and other echoes that come near correlate at others. Every
        channel weighs the same, so that none decides alone.

        Parameters
        ----------
        some : (polarization, pair, frequency) ndarray of complex
            The scan's data of some pairs.
        power : (polarization, pair) ndarray of float
            Their mean power.
        """
        tones = np.arange(some.shape[-1])
        of_mean = _power(self.latest_mean).mean(axis=-1, dtype=np.float64)
        back = np.ones(tones.size)
        if of_mean.any():
            weight = 1 / np.sqrt(np.maximum(power * of_mean, LEAST_POWER**2))
            turned = self.latest_mean.conj() * weight.astype(np.float32)[..., None]
            across = np.einsum("apf,apf->f", some, turned)
            delay = _delay_in(across)
            self.delays.append(delay)
            total = complex(np.vdot(np.exp(1j * delay * tones), across))
            living = int(np.count_nonzero(np.minimum(power, of_mean) > LEAST_POWER))
            self.clearness.append(abs(total) / tones.size / (living or 1))
            back = np.exp(-1j * (delay * tones + np.angle(total)))
        self.in_mean = min(self.in_mean + 1, _MOST_IN_MEAN)
        change = some * back.astype(np.complex64) - self.latest_mean
        self.latest_mean += change / np.float32(self.in_mean)

    def _add_change(
        self, signal: ComplexArray, finite: BoolArray, channel_power: FloatArray
    ) -> tuple[bool, float]:
        """Add the change from the scan before.

        Return whether there is none, and its power over that of the scan, dB.
        """
        latest = self._before
        self._before = signal, finite
        if latest is None:
            return False, np.nan
        before, before_finite = latest
        change = signal - before
        both = finite & before_finite
        self.steps += both
        self.stuck += (change == 0) & both[..., None]
        if not both.any():
            return False, np.nan
        change_power = _power(change)
        total = float(change_power[both].mean(dtype=np.float64))
        if not total:
            self.repeated += 1
            return True, -np.inf
        self.change_db += _tone_levels(change_power, both)
        self.changes += 1
        if self.changes % 2:
            changed = change if both.all() else change[both][None]
            self.next_changes.add(changed)
            self.tone_power += change_power[both].sum(axis=0, dtype=np.float64)
        low = change[..., : max(8, change.shape[-1] // LOWEST_SHARE)] * both[..., None]
        amplitude = np.sqrt(_power(low).mean(axis=-1, keepdims=True))
        low = low / np.maximum(amplitude, np.sqrt(LEAST_POWER))  # so that no scan decides alone
        self.pair_products += low @ low.conj().swapaxes(-1, -2)
        level = float(channel_power[both].mean())
        return False, 10 * np.log10(total / max(level, LEAST_POWER))

    def gap(self) -> None:
        """Let the next scan not be compared with the one before: scans in between are left out."""
        self._before = None

    def state(self) -> dict[str, NDArray[Any]]:
        """Return the state as arrays, copies, for a later :meth:`restore`."""
        arrays = {name: np.asarray(getattr(self, name)).copy() for name in _SUMMED}
        for name in _BESIDE:
            arrays |= {
                f"{name}.{part}": np.array(value)
                for part, value in vars(getattr(self, name)).items()
            }
        if self._before is not None:
            before, finite = self._before
            arrays |= {"before": before.copy(), "before_finite": finite.copy()}
        return arrays

    def restore(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Continue from arrays that :meth:`state` returned."""
        for name in arrays.keys() & set(_SUMMED):  # one of a version before may have less
            value: Any = arrays[name]
            kind = type(getattr(self, name))
            if kind is int:
                value = int(value)
            elif kind is deque:
                value = deque(value.tolist(), maxlen=REMEMBERED)
            setattr(self, name, value)
        for name in _BESIDE:
            beside = TonesBeside(self.shape[2])
            if f"{name}.sweeps" in arrays:
                beside.magnitude = arrays[f"{name}.magnitude"]
                beside.product = arrays[f"{name}.product"]
                beside.sweeps = int(arrays[f"{name}.sweeps"])
            setattr(self, name, beside)
        self._before = None
        if "before" in arrays:
            self._before = arrays["before"], arrays["before_finite"]

    @property
    def mean(self) -> ComplexArray:
        """Mean of the finite sweeps (polarization, pair, frequency): what stands still."""
        return np.asarray(self.standing / np.maximum(self.sweeps, 1)[..., None])

    @property
    def changed_db(self) -> FloatArray:
        """Change from scan to scan of every tone (frequency,) over that of the tones around, dB."""
        return over_neighbours(self.change_db / max(self.changes, 1))

    @property
    def likeness(self) -> float:
        """How alike a tone and the next are, 0 to 1, the median of the tones."""
        known = self.tone_sum[1:] * self.tone_sum[:-1] > 0
        alike = self.next_tones.likeness(self.tone_sum)[known]
        return float(np.median(alike)) if alike.size else 1.0

    @property
    def tone_likeness(self) -> FloatArray:
        """How alike the changes of a tone and of the next are (frequency - 1,), 0 to 1."""
        return self.next_changes.likeness(self.tone_power)

    @property
    def pair_likeness(self) -> FloatArray:
        """Correlation, real, of a pair's change with another's (polarization, pair, pair).

        It is that of the lowest tones; NaN where nothing changes.
        """
        amplitude = np.sqrt(np.einsum("app->ap", self.pair_products).real)
        with np.errstate(invalid="ignore", divide="ignore"):
            scaled = self.pair_products.real / amplitude[:, None] / amplitude[..., None]
            return np.asarray(scaled)


def _power(signal: ComplexArray) -> NDArray[np.floating]:
    """Return the power of numbers."""
    return np.square(signal.real) + np.square(signal.imag)


def _delay_in(across: ComplexArray) -> float:
    """Return the delay in a cross-spectrum (frequency,), as phase per tone, rad."""
    tones = np.arange(across.size)
    lags = 1 << (4 * across.size - 1).bit_length()
    peak = int(np.argmax(np.abs(np.fft.fft(across, lags))))
    phase = 2 * np.pi * (peak - lags if peak > lags // 2 else peak) / lags
    half = across.size // 2
    for _ in range(3 if half else 0):  # the phase between the halves of the band refines it
        left = across * np.exp(-1j * phase * tones)
        turn = float(np.angle(np.vdot(left[:half].sum(), left[-half:].sum())))
        phase += turn / (across.size - half)
    return phase


def _tone_levels(power: NDArray[np.floating], which: BoolArray) -> FloatArray:
    """Return the level of every tone, dB: the mean over channels, so that none decides alone."""
    # The natural logarithm of 32 bits takes a fraction of the time of that to the base of 10.
    levels = np.log(power[which] + np.float32(LEAST_POWER))
    if not len(levels):
        return np.zeros(power.shape[-1])
    return np.asarray(_DECIBELS * levels.mean(axis=0, dtype=np.float64), np.float64)


def _levels(power: FloatArray, finite: BoolArray) -> FloatArray:
    """Return levels (polarization, pair) over the median pair of a polarization, dB.

    NaN where a value is not finite.
    """
    levels = np.where(finite, 10 * np.log10(np.maximum(power, LEAST_POWER)), np.nan)
    for row in levels:
        known = row[~np.isnan(row)]
        if known.size:
            row -= np.median(known)
    return np.asarray(levels, np.float64)


def over_neighbours(levels: FloatArray, around: int = TONES_AROUND) -> FloatArray:
    """Return levels over the running median of the tones around, in the unit of the levels.

    Parameters
    ----------
    levels : (frequency,) ndarray of float
        Levels.
    around : int
        Tones whose median is taken; fewer at the ends of the band.
    """
    half = min(around // 2, (levels.size - 1) // 2)
    padded = np.pad(levels, half, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1)
    # A median of so many changes slowly from tone to tone.
    centres = np.arange(0, levels.size, _MEDIAN_EVERY)
    usual = np.interp(np.arange(levels.size), centres, np.median(windows[centres], axis=-1))
    return np.asarray(levels - usual, np.float64)
