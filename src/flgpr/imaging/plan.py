"""What an imaging operator prepares once: tones on a uniform spectrum, the range swath, antennas, pixels in blocks."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flgpr.kernels.direct import PreciseGeometry
from flgpr.kernels.geometry import antenna_paths
from flgpr.kernels.kaiser import MAX_WIDTH, Window, best_shape, design, polynomials, transform
from flgpr.kernels.layout import BLOCK, padded
from flgpr.kernels.profiles import Geometry, polynomial_degree
from flgpr.kernels.transform import Spectrum
from flgpr.model import SPEED_OF_LIGHT
from flgpr.model.arrays import ComplexArray, FloatArray

IndexArray = NDArray[np.int64]
Pattern = Callable[[FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True)
class Layout:
    """Antennas (antenna, 3), each once and transmitters first, and pixels (3, pixel) in blocks.

    ``tx`` and ``rx`` are rows of ``antenna``. The last of ``count`` pixels is repeated to fill a block. ``medium`` are
    the refractive indices above and below z = 0, the second zero where there is no ground; ``gain`` the amplitude of
    each antenna at each pixel, empty where it is one everywhere.
    """

    tx: IndexArray
    rx: IndexArray
    antenna: FloatArray
    pixels: FloatArray
    count: int
    medium: FloatArray
    gain: FloatArray

    def swath(self) -> tuple[float, float]:
        """Bounds of the optical paths of all pairs and pixels, m, from the box around the pixels."""
        low = self.pixels.min(axis=1)
        high = self.pixels.max(axis=1)
        index, ground = self.medium
        depth = max(0.0, -low[2]) if ground else 0.0
        if ground:
            # The straight line is a lower bound; down the normal from the surface is a path, so an
            # upper one.
            low = np.minimum(low, [np.inf, np.inf, 0.0])
            high = np.maximum(high, [-np.inf, -np.inf, 0.0])
        near = np.maximum(0.0, np.maximum(low - self.antenna, self.antenna - high))
        far = np.maximum(np.abs(self.antenna - low), np.abs(high - self.antenna))
        least = index * np.linalg.norm(near, axis=1)
        most = index * np.linalg.norm(far, axis=1) + ground * depth
        return float((least[self.tx] + least[self.rx]).min()), float(
            (most[self.tx] + most[self.rx]).max()
        )


def lay_out(
    tx: FloatArray, rx: FloatArray, pixels: FloatArray, medium: tuple[float, float],
    patterns: tuple[Pattern | None, Pattern | None],
) -> Layout:  # fmt: skip
    """Find the different antennas, put pixels in blocks and evaluate the antennas' amplitudes."""
    tx_unique, tx_index = np.unique(tx, axis=0, return_inverse=True)
    rx_unique, rx_index = np.unique(rx, axis=0, return_inverse=True)
    count = pixels.shape[0]
    padded = np.empty((3, -(-count // BLOCK) * BLOCK))
    padded[:, :count] = pixels.T
    padded[:, count:] = pixels[-1][:, None]
    antenna = np.concatenate([tx_unique, rx_unique])
    gain = np.empty((antenna.shape[0], 0))
    if any(pattern is not None for pattern in patterns):
        gain = np.ones((antenna.shape[0], padded.shape[1]))
        roles = [(tx_unique, patterns[0], "tx_pattern"), (rx_unique, patterns[1], "rx_pattern")]
        rows = [(p, pattern, name) for points, pattern, name in roles for p in points]
        for row, (position, pattern, name) in zip(gain, rows, strict=True):
            if pattern is not None:
                row[:count] = _amplitude(pattern, name, position, pixels)
    indices = (
        tx_index.reshape(-1).astype(np.int64),
        rx_index.reshape(-1).astype(np.int64) + len(tx_unique),
    )
    return Layout(*indices, antenna, padded, count, np.array(medium), gain)


def _amplitude(pattern: Pattern, name: str, position: FloatArray, pixels: FloatArray) -> FloatArray:
    value = np.asarray(pattern(position, pixels), dtype=np.float64)
    if value.shape not in ((), (pixels.shape[0],)) or not np.isfinite(value).all():
        raise ValueError(
            f"{name} must return one finite amplitude per pixel ({pixels.shape[0]}), got shape {value.shape}"
        )
    return value


@dataclass(frozen=True)
class Tones:
    """Where tones lie on a uniform spectrum."""

    step: float  #: spacing of the spectrum, Hz
    #: position of each tone on it, relative to the carrier, in steps; whole numbers where the tones are uniform
    place: FloatArray
    carrier: float  #: frequency of position zero, Hz
    uniform: bool  #: whether all places are whole numbers

    @property
    def extent(self) -> int:
        """Number of steps from the first to the last tone, both included."""
        return 2 * math.ceil(float(np.abs(self.place).max())) + 1


def place_tones(frequency: FloatArray, swath: tuple[float, float], tolerance: float) -> Tones:
    """Lay tones on a uniform spectrum: their own if they have one, gaps included, else one that the swath calls for.

    Tones count as uniform if their distance from the grid turns no phase by more than a tenth of ``tolerance``.
    """
    spacing = np.diff(frequency)
    step = float(spacing.min()) if spacing.size else float(frequency[0])
    position = np.rint((frequency - frequency[0]) / step)
    if position[-1] > 0:
        step = float((frequency[-1] - frequency[0]) / position[-1])
    drift = np.abs(frequency - frequency[0] - step * position).max()
    middle = position[-1] // 2
    if (
        2 * math.pi * drift * swath[1] / SPEED_OF_LIGHT <= tolerance / 10
        and position[-1] < 64 * frequency.size
    ):
        return Tones(step, position - middle, float(frequency[0] + step * middle), True)
    carrier = (frequency[0] + frequency[-1]) / 2
    # Three swaths are unambiguous, so that spreading tones over neighbouring slots has room to
    # alias into.
    step = min(SPEED_OF_LIGHT / (3 * (swath[1] - swath[0]) + 1e-3), frequency[-1] - frequency[0])
    return Tones(float(step), (frequency - carrier) / step, float(carrier), False)


@dataclass(frozen=True)
class Plan:
    """Everything the kernels of one operator are made from; the spectrum's tones and bins are in double precision.

    ``per_turn`` and ``carrier`` are the spacing of the spectrum and its position zero over the speed of light, 1/m.
    ``start`` is the first bin that a path reaches; the window's outer taps start earlier. ``phase`` (1 or pair, tone)
    is a factor on every tone. ``rounding`` is the largest phase that the 32-bit delays of the kernels in single
    precision are off by, rad.
    """

    layout: Layout
    window: Window
    spectrum: Spectrum
    per_turn: float
    carrier: float
    start: int
    phase: ComplexArray | None
    rounding: float

    @property
    def bins(self) -> int:
        """Bins per pair, those that only the window's outer taps reach included."""
        return self.spectrum.factor.size

    def geometry(self) -> Geometry:
        """Geometry for the kernels in single precision."""
        layout = self.layout
        width = self.window.width
        shift = 33 - self.window.size.bit_length()
        half_bin = 1 << (shift - 1) if width % 2 else 0
        weight = np.zeros((polynomial_degree(width) + 1, padded(width)), np.float32)
        weight[:, :width] = polynomials(self.window, polynomial_degree(width)).T
        return Geometry(
            layout.tx, layout.rx, layout.antenna, layout.pixels, layout.count, layout.medium, self.per_turn,
            self.carrier, ((self.start << shift) - half_bin) % 2**32, shift, layout.gain.astype(np.float32),
            weight.reshape(-1),
        )  # fmt: skip

    def precise_geometry(self) -> PreciseGeometry:
        """Geometry for the kernels in double precision."""
        layout = self.layout
        path = np.empty((layout.antenna.shape[0], layout.pixels.shape[1]))
        antenna_paths(layout.pixels, layout.antenna, layout.medium, path)
        start = self.start % self.window.size - (0.5 if self.window.width % 2 else 0.0)
        weight = polynomials(self.window, self.window.width + 9)
        return PreciseGeometry(
            path,
            layout.tx,
            layout.rx,
            layout.gain,
            self.per_turn,
            self.carrier,
            self.window.size,
            start,
            weight,
        )


def make_plan(
    frequency: FloatArray,
    active: NDArray[np.bool_],
    layout: Layout,
    offset: FloatArray,
    tolerance: float,
) -> Plan:
    """Choose window and spectrum for the ``active`` tones; ``offset`` (pair,) m is taken off by a factor on each."""
    swath = layout.swath()
    tones = place_tones(frequency[active], swath, tolerance)
    share = tolerance if tones.uniform else tolerance / 2
    window = design(
        tones.extent if tones.uniform else max(tones.extent + 16, 100), share, layout.count
    )
    size = window.size
    per_turn = tones.step / SPEED_OF_LIGHT
    start = math.floor(swath[0] * per_turn * size) - 1
    reach = min(math.floor(swath[1] * per_turn * size) + 3 - start, size)
    first = start - (window.width - 1) // 2
    bins = reach + window.width
    turns = np.zeros((1, frequency.size))
    centre = 0
    if not tones.uniform:
        centre = start + reach // 2
        turns[0, active] = tones.place * (centre / size)
    if offset.any():
        turns = turns - offset[:, None] * (frequency / SPEED_OF_LIGHT)
    phase = np.exp(2j * np.pi * (turns - np.floor(turns))) if turns.any() else None
    spectrum = _spectrum(tones, active, window, first - centre, bins, share)
    rounding = 2 * math.pi * float(np.abs(tones.place).max()) * 2 / 2**32
    return Plan(
        layout, window, spectrum, per_turn, tones.carrier / SPEED_OF_LIGHT, start, phase, rounding
    )


def _spectrum(
    tones: Tones, active: NDArray[np.bool_], window: Window, first: int, bins: int, tolerance: float
) -> Spectrum:
    """Slots of every tone; uneven tones are spread over several, as in a non-uniform transform of the first kind."""
    size = window.size
    weight = 1 / transform(window.width, window.beta, tones.place / size)[:, None]
    slots = np.rint(tones.place).astype(np.int64)[:, None]
    factor = np.ones(bins)
    if not tones.uniform:
        slots, shares, factor = _spread(tones.place, size, first, bins, tolerance)
        weight = weight * shares
    per_tone = np.where(active, slots.shape[1], 0)
    entries = np.concatenate([[0], np.cumsum(per_tone)]).astype(np.int64)
    twiddle = np.exp(2j * np.pi * np.arange(size) / size)
    return Spectrum(
        size, first % size, entries, (slots % size).reshape(-1), weight.reshape(-1), factor, twiddle
    )


def _spread(
    place: FloatArray, size: int, first: int, bins: int, tolerance: float
) -> tuple[IndexArray, FloatArray, FloatArray]:
    """Slots and weights that stand for tones between two slots, and the factor that undoes this on each bin."""
    width = next(
        w for w in range(2, MAX_WIDTH + 1) if w == MAX_WIDTH or best_shape(w, 2.0)[1] <= tolerance
    )
    beta = best_shape(width, 2.0)[0]
    lowest = np.ceil(place - width / 2).astype(np.int64)
    slots = lowest[:, None] + np.arange(width)
    distance = (slots - place[:, None]) / (width / 2)
    shares = np.i0(beta * np.sqrt(np.clip(1 - distance**2, 0, None))) / np.i0(beta)
    return slots, shares, 1 / transform(width, beta, np.arange(first, first + bins) / size)
