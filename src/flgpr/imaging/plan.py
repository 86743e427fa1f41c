"""What an imaging operator prepares once: spectrum, range swath, antennas, pixels in blocks."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flgpr.kernels.geometry import antenna_paths
from flgpr.kernels.kaiser import (
    MAX_WIDTH,
    Window,
    best_shape,
    design_window,
    polynomials,
    transform,
)
from flgpr.kernels.layout import BLOCK, padded
from flgpr.kernels.precise import PreciseGeometry
from flgpr.kernels.profiles import Geometry, polynomial_degree
from flgpr.kernels.transform import Spectrum
from flgpr.model import SPEED_OF_LIGHT
from flgpr.types import BoolArray, Complex128Array, FloatArray, IntArray, floats

Pattern = Callable[[FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True)
class ImagingLayout:
    """Antennas, each once, and pixels in blocks.

    The last pixel is repeated to fill a block.
    """

    tx: IntArray  #: (pair,): rows of the transmitters in ``antenna``
    rx: IntArray  #: (pair,): rows of the receivers in ``antenna``
    antenna: FloatArray  #: (antenna, 3): positions, transmitters first, m
    pixels: FloatArray  #: (3, pixel): positions with those that fill the last block, m
    count: int  #: pixels without these
    #: (2,): refractive indices above and below z = 0, the second zero where there is no ground
    medium: FloatArray
    #: (antenna, pixel): amplitude of each antenna, or (antenna, 0) where it is one everywhere
    gain: FloatArray

    def swath(self) -> tuple[float, float]:
        """Return bounds of the optical paths of all pairs and pixels, m, from the pixels' box."""
        low = self.pixels.min(axis=1)
        high = self.pixels.max(axis=1)
        index, ground = self.medium
        depth = max(0.0, -low[2]) if ground else 0.0
        if ground:
            # The straight line is a lower bound. Along the surface and down the normal is a path,
            # so that its length is an upper bound.
            low = np.minimum(low, [np.inf, np.inf, 0.0])
            high = np.maximum(high, [-np.inf, -np.inf, 0.0])

        # From an antenna to the nearest and to the farthest point of the pixels' box.
        nearest = np.maximum(0.0, np.maximum(low - self.antenna, self.antenna - high))
        farthest = np.maximum(np.abs(self.antenna - low), np.abs(high - self.antenna))
        least = index * np.linalg.norm(nearest, axis=1)
        most = index * np.linalg.norm(farthest, axis=1) + ground * depth
        shortest = float((least[self.tx] + least[self.rx]).min())
        longest = float((most[self.tx] + most[self.rx]).max())
        return shortest, longest

    def paths(self) -> FloatArray:
        """Return the one-way optical paths (antenna, pixel), m."""
        path = np.empty((self.antenna.shape[0], self.pixels.shape[1]))
        antenna_paths(self.pixels, self.antenna, self.medium, path)
        return path


def lay_out(
    tx: FloatArray,
    rx: FloatArray,
    pixels: FloatArray,
    medium: tuple[float, float],
    patterns: tuple[Pattern | None, Pattern | None],
) -> ImagingLayout:
    """Find the different antennas, put pixels in blocks and evaluate the antennas' amplitudes.

    Parameters
    ----------
    tx, rx : (pair, 3) ndarray
        Positions of every pair's antennas, m.
    pixels : (pixel, 3) ndarray
        Pixels, at least one, m.
    medium : tuple of float
        Refractive indices above and below z = 0, the second zero where there is no ground.
    patterns : tuple of callables or None
        Amplitudes of transmitters and receivers by position and pixels; None is one.

    Returns
    -------
    ImagingLayout
        The layout.

    Raises
    ------
    ValueError
        If a pattern does not return one finite amplitude per pixel.
    """
    tx_unique, tx_index = np.unique(tx, axis=0, return_inverse=True)
    rx_unique, rx_index = np.unique(rx, axis=0, return_inverse=True)

    count = pixels.shape[0]
    blocks = -(-count // BLOCK)
    padded = np.empty((3, blocks * BLOCK))
    padded[:, :count] = pixels.T
    padded[:, count:] = pixels[-1][:, None]

    gain = np.empty((len(tx_unique) + len(rx_unique), 0))
    tx_pattern, rx_pattern = patterns
    if tx_pattern is not None or rx_pattern is not None:
        gain = np.ones((len(gain), padded.shape[1]))
        if tx_pattern is not None:
            for row, position in zip(gain, tx_unique, strict=False):
                row[:count] = _amplitude(tx_pattern, "tx_pattern", position, pixels)
        if rx_pattern is not None:
            for row, position in zip(gain[len(tx_unique) :], rx_unique, strict=True):
                row[:count] = _amplitude(rx_pattern, "rx_pattern", position, pixels)
    return ImagingLayout(
        tx_index.reshape(-1).astype(np.int64),
        rx_index.reshape(-1).astype(np.int64) + len(tx_unique),
        np.concatenate([tx_unique, rx_unique]),
        padded,
        count,
        np.array(medium),
        gain,
    )


def _amplitude(pattern: Pattern, name: str, position: FloatArray, pixels: FloatArray) -> FloatArray:
    """Evaluate an antenna's amplitude at the pixels (pixel, 3), which must be one number each."""
    value = floats(pattern(position, pixels))
    if value.shape not in ((), (pixels.shape[0],)) or not np.isfinite(value).all():
        raise ValueError(
            f"{name} must return one finite amplitude per pixel ({pixels.shape[0]}), "
            f"got shape {value.shape}"
        )
    return value


@dataclass(frozen=True)
class ToneGrid:
    """Positions of tones on a uniform spectrum."""

    step: float  #: spacing of the spectrum, Hz
    #: position of each tone relative to the carrier, in steps; whole numbers if the tones are
    #: uniform
    position: FloatArray
    carrier: float  #: frequency of position zero, Hz
    uniform: bool  #: whether all positions are whole numbers

    @property
    def extent(self) -> int:
        """Number of steps from the first to the last tone, both included."""
        return 2 * math.ceil(float(np.abs(self.position).max())) + 1


def place_tones(frequency: FloatArray, swath: tuple[float, float], tolerance: float) -> ToneGrid:
    """Place tones on a uniform spectrum.

    It is their own if they have one, gaps included, else one that is fine enough for the swath.
    Tones count as uniform if their distance from the grid turns no phase by more than a tenth of
    ``tolerance``.

    Parameters
    ----------
    frequency : (tone,) ndarray
        Frequencies in increasing order, Hz.
    swath : tuple of float
        Shortest and longest path, m.
    tolerance : float
        Relative error of the images.

    Returns
    -------
    ToneGrid
        Positions of the tones.
    """
    spacing = np.diff(frequency)
    step = float(spacing.min()) if spacing.size else float(frequency[0])
    position = np.rint((frequency - frequency[0]) / step)
    if position[-1] > 0:
        # The mean step over the band: that of two neighbours has the rounding of a file.
        step = float((frequency[-1] - frequency[0]) / position[-1])
    off_grid = np.abs(frequency - frequency[0] - step * position).max()
    middle = position[-1] // 2
    phase_error = 2 * math.pi * off_grid * swath[1] / SPEED_OF_LIGHT
    # A spectrum that is gaps above all costs more than spreading the tones.
    if phase_error <= tolerance / 10 and position[-1] < 64 * frequency.size:
        return ToneGrid(step, position - middle, float(frequency[0] + step * middle), True)

    carrier = (frequency[0] + frequency[-1]) / 2
    # Three swaths are unambiguous, so that spreading tones over neighbouring slots has room to
    # alias into.
    step = min(SPEED_OF_LIGHT / (3 * (swath[1] - swath[0]) + 1e-3), frequency[-1] - frequency[0])
    return ToneGrid(float(step), (frequency - carrier) / step, float(carrier), False)


@dataclass(frozen=True)
class Plan:
    """Parameters of the kernels of one operator, with the spectrum in double precision."""

    layout: ImagingLayout
    window: Window
    spectrum: Spectrum
    per_turn: float  #: spacing of the spectrum over the speed of light, 1/m
    carrier: float  #: position zero of the spectrum over the speed of light, 1/m
    start: int  #: first bin that a path reaches; the window's outer taps start earlier
    phase: Complex128Array | None  #: (1 or pair, tone): factor on every tone
    #: largest phase error of the 32-bit delays of the kernels in single precision, rad
    rounding: float

    @property
    def bins(self) -> int:
        """Number of bins per pair, with those that only the window's outer taps reach."""
        return self.spectrum.factor.size

    def geometry(self) -> Geometry:
        """Return the geometry for the kernels in single precision."""
        layout = self.layout
        width = self.window.width
        shift = 33 - self.window.size.bit_length()
        half_bin = 1 << (shift - 1) if width % 2 else 0
        weight = np.zeros((polynomial_degree(width) + 1, padded(width)), np.float32)
        weight[:, :width] = polynomials(self.window, polynomial_degree(width)).T
        origin = ((self.start << shift) - half_bin) % 2**32
        return Geometry(
            layout.tx,
            layout.rx,
            layout.antenna,
            layout.pixels,
            layout.count,
            layout.medium,
            self.per_turn,
            self.carrier,
            origin,
            shift,
            layout.gain.astype(np.float32),
            weight.reshape(-1),
        )

    def precise_geometry(self) -> PreciseGeometry:
        """Return the geometry for the kernels in double precision."""
        layout = self.layout
        start = self.start % self.window.size - (0.5 if self.window.width % 2 else 0.0)
        weight = polynomials(self.window, self.window.width + 9)
        return PreciseGeometry(
            layout.paths(),
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
    active: BoolArray,
    layout: ImagingLayout,
    offset: FloatArray,
    tolerance: float,
) -> Plan:
    """Choose window and spectrum for the ``active`` tones.

    Parameters
    ----------
    frequency : (tone,) ndarray
        Frequencies in increasing order, Hz.
    active : (tone,) ndarray of bool
        Tones that any sub-band weighs.
    layout : ImagingLayout
        Antennas and pixels.
    offset : (pair,) ndarray
        Path that is subtracted by a factor on every tone, m.
    tolerance : float
        Relative error of the images.

    Returns
    -------
    Plan
        The plan.
    """
    swath = layout.swath()
    tones = place_tones(frequency[active], swath, tolerance)
    if tones.uniform:
        window_tolerance = tolerance
        extent = tones.extent
    else:
        window_tolerance = tolerance / 2  # the other half is for spreading the tones
        extent = max(tones.extent + 16, 100)
    window = design_window(extent, window_tolerance, layout.count)
    size = window.size
    per_turn = tones.step / SPEED_OF_LIGHT

    # Bins from the shortest to the longest path, at least one more on either side for rounding, and
    # those that only the window reaches.
    start = math.floor(swath[0] * per_turn * size) - 1
    reach = min(math.floor(swath[1] * per_turn * size) + 3 - start, size)
    first = start - (window.width - 1) // 2
    bins = reach + window.width

    turns = np.zeros((1, frequency.size))
    centre = 0
    if not tones.uniform:
        # The correction of the bins is best about bin zero: the swath's middle is moved there.
        centre = start + reach // 2
        turns[0, active] = tones.position * (centre / size)
    if offset.any():
        turns = turns - offset[:, None] * (frequency / SPEED_OF_LIGHT)
    phase = np.exp(2j * np.pi * (turns - np.floor(turns))) if turns.any() else None

    spectrum = _spectrum(tones, active, window, first - centre, bins, window_tolerance)
    rounding = 2 * math.pi * float(np.abs(tones.position).max()) * 2 / 2**32
    carrier = tones.carrier / SPEED_OF_LIGHT
    return Plan(layout, window, spectrum, per_turn, carrier, start, phase, rounding)


def _spectrum(
    tones: ToneGrid,
    active: BoolArray,
    window: Window,
    first: int,
    bins: int,
    tolerance: float,
) -> Spectrum:
    """Return the slots of every tone in the spectrum.

    Uneven tones are spread over several, as in a non-uniform transform of the first kind.
    """
    size = window.size
    # Divided by the window's transform, which the interpolation multiplies with.
    weight = 1 / transform(window.width, window.beta, tones.position / size)[:, None]
    slots = np.rint(tones.position).astype(np.int64)[:, None]
    factor = np.ones(bins)
    if not tones.uniform:
        slots, shares, factor = _spread(tones.position, size, first, bins, tolerance)
        weight = weight * shares
    per_tone = np.where(active, slots.shape[1], 0)
    entries = np.concatenate([[0], np.cumsum(per_tone)]).astype(np.int64)
    twiddle = np.exp(2j * np.pi * np.arange(size) / size)
    return Spectrum(
        size, first % size, entries, (slots % size).reshape(-1), weight.reshape(-1), factor, twiddle
    )


def _spread(
    position: FloatArray, size: int, first: int, bins: int, tolerance: float
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return slots and weights that represent uneven tones, and the correction of each bin."""
    width = 2
    while width < MAX_WIDTH and best_shape(width, 2.0)[1] > tolerance:
        width += 1
    beta = best_shape(width, 2.0)[0]
    lowest = np.ceil(position - width / 2).astype(np.int64)
    slots = lowest[:, None] + np.arange(width)
    distance = (slots - position[:, None]) / (width / 2)
    inside = np.clip(1 - distance**2, 0, None)
    shares = np.i0(beta * np.sqrt(inside)) / np.i0(beta)
    correction = 1 / transform(width, beta, np.arange(first, first + bins) / size)
    return slots, shares, correction
