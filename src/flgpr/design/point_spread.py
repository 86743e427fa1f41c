"""Image of a point on the ground by an array that stands level: shape, widths and cell area."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from flgpr.kernels.widths import half_power
from flgpr.kernels.windows import WINDOWS, band_weights
from flgpr.model import SPEED_OF_LIGHT, Sensor
from flgpr.types import ArrayLike, Complex128Array, FloatArray, floats

Beam = Callable[[FloatArray], FloatArray]
_OVERSAMPLING = 32
_CELL_STEP = 0.25  # steps of the integral over a resolution cell, in expected widths
_CELL_REACH = 15.0  # range cells to which its lobes are integrated


class PointSpread:
    """Image of a point on the ground by an array that stands level.

    It is ``|Σ_pair Σ_f w(f)·exp(+j2πf(L(p) - L(q))/c)|``. The sum over tones depends on the
    difference of paths alone and is tabulated once. Antenna patterns and spreading are left out, as
    in image formation.

    Parameters
    ----------
    sensor : Sensor
        The array.
    band : tuple of float, optional
        Lowest and highest tone, Hz; None takes all tones.
    window : str
        Window over the tones.
    response : (frequency,) array_like, optional
        Amplitude of the radar at each of the sensor's tones; None is one.

    Raises
    ------
    ValueError
        If the window is not known or the band holds fewer than two tones.
    """

    def __init__(
        self,
        sensor: Sensor,
        band: tuple[float, float] | None = None,
        window: str = "hann",
        response: ArrayLike | None = None,
    ) -> None:
        if window not in WINDOWS:
            raise ValueError(f"window must be one of {', '.join(WINDOWS)}, got {window!r}")
        tones = sensor.tones.axis()
        low, high = band or (float(tones[0]), float(tones[-1]))
        chosen = (tones >= low) & (tones <= high)
        if np.count_nonzero(chosen) < 2:
            raise ValueError(f"band must hold at least two tones, got {low:g} to {high:g} Hz")
        self.tones = tones[chosen]
        self.footprint = sensor.ground_in_view
        weight = band_weights(self.tones, ((low, high),), WINDOWS[window])[0]
        if response is not None:
            weight = weight * floats(response)[chosen]

        up = np.array([0.0, 0.0, sensor.height])
        tx, rx = sensor.pairs()
        self.tx = tx + up
        self.rx = rx + up

        # The sum over tones about the middle one, over one period of path. The first value is
        # repeated at the end, for the interpolation.
        count = 1 << math.ceil(math.log2(_OVERSAMPLING * self.tones.size))
        middle = self.tones.size // 2
        slots = (np.arange(self.tones.size) - middle) % count
        spectrum = np.zeros(count, complex)
        spectrum[slots] = weight
        self._table = np.append(np.fft.ifft(spectrum) * count, 0)
        self._table[-1] = self._table[0]

        self._period = SPEED_OF_LIGHT / sensor.tones.step
        self._carrier = float(self.tones[middle])
        self._peak = weight.sum() * len(tx)

    def paths(self, points: ArrayLike) -> FloatArray:
        """Return the lengths of the paths of all pairs over points.

        Parameters
        ----------
        points : (..., 3) array_like
            Points, m.

        Returns
        -------
        (pair, ...) ndarray
            Lengths from transmitter to point to receiver, m.
        """
        p = floats(points)
        shape = (-1, *[1] * (p.ndim - 1), 3)  # antennas along an axis before those of the points
        outward = np.linalg.norm(p - self.tx.reshape(shape), axis=-1)
        back = np.linalg.norm(p - self.rx.reshape(shape), axis=-1)
        return floats(outward + back)

    def __call__(
        self, points: ArrayLike, source: ArrayLike, gain: FloatArray | None = None
    ) -> FloatArray:
        """Return the amplitude of the image of a point, relative to its peak.

        Parameters
        ----------
        points : (..., 3) array_like
            Where the image is computed, m.
        source : (3,) array_like
            The point, m.
        gain : (pair, ...) ndarray of float, optional
            Amplitude of each pair's contribution; one by default.

        Returns
        -------
        (...) ndarray
            Amplitude.
        """
        p = floats(points)
        source_paths = self.paths(floats(source))
        total = np.zeros(p.shape[:-1], complex)
        antennas = zip(self.tx, self.rx, source_paths, strict=True)
        for pair, (tx, rx, source_path) in enumerate(antennas):
            outward = np.linalg.norm(p - tx, axis=-1)
            back = np.linalg.norm(p - rx, axis=-1)
            longer = outward + back - source_path
            value = self._sum_over_tones(longer)
            total += value if gain is None else gain[pair] * value
        return floats(np.abs(total) / self._peak)

    def _sum_over_tones(self, longer: FloatArray) -> Complex128Array:
        """Return ``Σ_f w(f)·exp(+j2πfd/c)`` for differences d of paths, m, from the table."""
        index = longer / self._period % 1.0 * (self._table.size - 1)
        cell = np.minimum(index.astype(np.intp), self._table.size - 2)
        first = self._table[cell]
        envelope = first + (index - cell) * (self._table[cell + 1] - first)
        turns = self._carrier / SPEED_OF_LIGHT * longer % 1.0
        return envelope * np.exp(2j * np.pi * turns)

    def cell_area(self, source: ArrayLike, beam: Beam | None = None) -> float:
        """Return the area of the resolution cell at a point of the ground, m²: ``∫|spread|² dA``.

        Clutter of backscatter σ⁰ has the mean power of a point of cross section σ⁰ times this area.
        Lobes are counted over the sensor's footprint, up to 15 range cells from the point's circle
        of distance.

        Parameters
        ----------
        source : (3,) array_like
            The point, m.
        beam : callable, optional
            Returns the amplitude (pair, point) with which each pair sees points (point, 3). With
            None all points count alike, so that grating lobes far to the side count as in image
            formation.

        Returns
        -------
        float
            Area, m².
        """
        centre = floats(source)
        down, cross = self.expected_widths(centre)
        x_min, x_max, y_min, y_max = self.footprint
        x = np.arange(x_min, x_max, min(_CELL_STEP * cross, (x_max - x_min) / 50))
        y = np.arange(y_min, y_max, _CELL_STEP * down)
        points = ground_plane(x, y).reshape(-1, 3)

        middle = np.concatenate([self.tx, self.rx]).mean(axis=0)
        slant = np.linalg.norm(points - middle, axis=1)
        source_slant = np.linalg.norm(centre - middle)
        range_cell = SPEED_OF_LIGHT / (2 * np.ptp(self.tones))
        points = points[np.abs(slant - source_slant) < _CELL_REACH * range_cell]

        if beam is None:
            amplitude = self(points, centre)
        else:
            gain = beam(points)
            amplitude = self(points, centre, gain / beam(centre[None]).mean())
        return float((amplitude**2).sum() * (x[1] - x[0]) * (y[1] - y[0]))

    def expected_widths(self, source: FloatArray) -> tuple[float, float]:
        """Return rough widths down-range and cross-range, m.

        They are ``c/(2B·sinθ)``, with θ the angle of incidence on the ground, and
        ``λR/(D_t + D_r)``, with D the lengths of the arrays.

        Parameters
        ----------
        source : (3,) ndarray
            Point of the ground, m.
        """
        middle = np.concatenate([self.tx, self.rx]).mean(axis=0)
        slant = float(np.linalg.norm(source - middle))
        ground = float(np.hypot(*(source - middle)[:2]))
        down = SPEED_OF_LIGHT / (2 * np.ptp(self.tones)) * slant / ground

        # At least 5 cm: a single pair has no aperture, and its image no width across.
        aperture = max(float(np.ptp((self.tx + self.rx)[:, 0])), 0.05)
        wavelength = SPEED_OF_LIGHT / self.tones.mean()
        cross = wavelength * slant / aperture
        return float(down), float(cross)

    def widths(self, source: ArrayLike) -> tuple[float, float]:
        """Return the half-power widths along y and x through a point of the ground (3,), m.

        A width is NaN where the response does not fall to half power.
        """
        centre = floats(source)
        down, cross = self.expected_widths(centre)
        return self._width(centre, 1, down), self._width(centre, 0, cross)

    def _width(self, centre: FloatArray, axis: int, expected: float) -> float:
        """Return the half-power width along an axis, of which the expected one is known."""
        offset = np.linspace(-4, 4, 401) * expected
        line = np.repeat(centre[None], offset.size, axis=0)
        line[:, axis] += offset
        return half_power(offset, self(line, centre))


def ground_plane(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the points (y, x, 3) of the ground at positions across (x,) and ahead (y,), m."""
    return np.stack([*np.meshgrid(x, y), np.zeros((y.size, x.size))], axis=-1)
