"""The imaging operator: the adjoint A^H makes images of data, the forward model A makes data of images."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from flgpr.imaging.engines import Engine, make_engine
from flgpr.imaging.plan import Pattern, lay_out
from flgpr.kernels.windows import WINDOWS, band_weights
from flgpr.model import check_frequency

Subbands = Sequence[tuple[float, float]]

SINGLE_TOLERANCE = 1e-5
"""Smallest tolerance that single precision keeps."""


class ImagingOperator:
    """Backprojection of multistatic stepped-frequency data and its exact transpose.

    With L the total optical path from transmitter to pixel to receiver less the pair's path offset,
    g the product of the two antennas' amplitudes (one by default) and w_s(f) the window of sub-band
    s (zero outside it)::

        adjoint   x_s(p)  = Σ_pair Σ_f w_s(f) g(pair, p) b(pair, f) exp(+j2πf L(pair, p)/c)   (Fuse et al. 2018, Eq. 1)
        forward   b(pair, f) = Σ_s Σ_p w_s(f) g(pair, p) x_s(p) exp(-j2πf L(pair, p)/c)

    A parameter that breaks its rule is a ValueError that names it, the rule and the value; a
    sub-band without a tone is one of the cases.

    Parameters
    ----------
    frequency : (frequency,) array_like
        Tones, Hz, strictly increasing; they may be uneven or have gaps.
    tx_position, rx_position : (pair, 3) array_like
        Antenna positions of each pair, m, in the frame of the pixels.
    pixels : (..., 3) array_like
        Pixel centres, m: any set of points.
    subbands : sequence of (lo, hi), optional
        Band edges in Hz, both included. None takes the whole band; the sub-band axis stays, with
        length 1.
    tolerance : float
        Largest relative L2 error against the direct double-precision sum.
    device : {"cpu", "cuda"}
        Where the sums are computed; "cuda" needs an NVIDIA device and the package numba-cuda.
    permittivity : float
        Relative permittivity of the medium between antennas and pixels.
    path_offset : (pair,) array_like, optional
        Length subtracted from every path of a pair, m, for data referenced to a scene centre.
    window : {"boxcar", "hann", "hamming", "taylor"} or (frequency,) array_like, optional
        Weight over the tones of each sub-band; an array is multiplied into every sub-band. Default:
        none (boxcar).
    half_space : float, optional
        Relative permittivity of ground that fills z < 0, at least ``permittivity``; paths to pixels
        below z = 0 are then refracted at the surface (Fermat's principle). All antennas must lie
        above all pixels and above z = 0.
    tx_pattern, rx_pattern : callable, optional
        Amplitude of an antenna, called once per antenna with its position (3,) and the pixels
        (pixel, 3), m, and returning one real number per pixel.
    dtype : {"complex64", "complex128"}, optional
        Precision of the result and of the sums. Default: complex64, but complex128 for a tolerance
        below 1e-5.
    method : {"auto", "profile", "direct"}
        "profile" interpolates range profiles, "direct" sums term by term in double precision,
        "auto" takes the one that needs less work.

    References
    ----------
    Fuse et al. 2018, Eq. 1-3 and 5.

    Examples
    --------
    A point's data, modelled and imaged: nothing is normalised, so the image peaks at the number of pairs times tones.

    >>> import numpy as np
    >>> from flgpr.imaging import ImagingOperator
    >>> from flgpr.model import Grid
    >>> frequency = 0.5e9 + 10e6 * np.arange(101)
    >>> rx = np.column_stack([np.linspace(-0.8, 0.8, 9), np.zeros(9), np.full(9, 1.5)])
    >>> tx = np.zeros((9, 3)) + [0.0, 0.0, 1.5]
    >>> grid = Grid.spanning((-1.0, 1.0), (4.0, 6.0), 0.05)
    >>> point = ImagingOperator(frequency, tx, rx, [[[0.25, 5.0, 0.0]]], method="direct")
    >>> data = point.forward(np.ones((1, 1, 1, 1)))  # polarization, pair, frequency
    >>> image = np.abs(ImagingOperator(frequency, tx, rx, grid.points()).adjoint(data)[0, 0])  # y, x
    >>> row, column = np.unravel_index(image.argmax(), image.shape)
    >>> float(grid.x[column]), float(grid.y[row]), round(float(image.max())) == 9 * 101
    (0.25, 5.0, True)
    """

    def __init__(
        self, frequency: ArrayLike, tx_position: ArrayLike, rx_position: ArrayLike, pixels: ArrayLike,
        subbands: Subbands | None = None, tolerance: float = 1e-3, device: str = "cpu", permittivity: float = 1.0,
        path_offset: ArrayLike | None = None, window: str | ArrayLike | None = None, half_space: float | None = None,
        tx_pattern: Pattern | None = None, rx_pattern: Pattern | None = None, dtype: DTypeLike | None = None,
        method: str = "auto",
    ) -> None:  # fmt: skip
        self.frequency = check_frequency(frequency)
        self.tx_position = _points(tx_position, "tx_position")
        self.rx_position = _points(rx_position, "rx_position")
        if self.tx_position.ndim != 2 or self.tx_position.shape != self.rx_position.shape:
            raise ValueError(
                "tx_position and rx_position must both have the shape (pair, 3), got "
                f"{self.tx_position.shape} and {self.rx_position.shape}"
            )
        grid = _points(pixels, "pixels")
        self.pixel_shape = grid.shape[:-1]
        points = grid.reshape(-1, 3)
        if not (1e-12 <= tolerance < 1):
            raise ValueError(f"tolerance must lie between 1e-12 and 1, got {tolerance}")
        self.tolerance = float(tolerance)
        self.dtype = _precision(dtype, self.tolerance)
        self.device = device
        if not (math.isfinite(permittivity) and permittivity >= 1):
            raise ValueError(f"permittivity must be at least 1, got {permittivity}")
        self.permittivity = float(permittivity)
        self.half_space = self._ground(half_space, points)
        self.path_offset = self._offsets(path_offset)
        self.subbands = self._bands(subbands)
        self.weight = self._weights(window)
        medium = (
            math.sqrt(self.permittivity),
            math.sqrt(self.half_space) if self.half_space else 0.0,
        )
        layout = lay_out(
            self.tx_position, self.rx_position, points, medium, (tx_pattern, rx_pattern)
        )
        self.engine: Engine = make_engine(
            layout,
            self.frequency,
            self.weight,
            self.path_offset,
            self.tolerance,
            self.dtype,
            device,
            method,
        )

    @property
    def pairs(self) -> int:
        """Number of antenna pairs."""
        return self.tx_position.shape[0]

    @property
    def method(self) -> str:
        """The method in use: "profile" or "direct"."""
        return self.engine.method

    @property
    def width(self) -> int:
        """Bins that the interpolation window covers; zero for direct sums."""
        return self.engine.width

    def image_buffer(self, *lead: int) -> NDArray[Any]:
        """Make memory for images (lead, subband, pixels), to be passed as ``out``; page-locked for a CUDA device."""
        return self.engine.buffer((*lead, len(self.subbands), *self.pixel_shape), self.dtype)

    def adjoint(
        self, data: ArrayLike, out: NDArray[Any] | None = None, rows: int | None = None
    ) -> NDArray[Any]:
        """Image data: apply A^H.

        ``data`` (..., polarization, pair, frequency) are received fields, finite; leading axes are scans taken with one
        geometry. Returns an image per polarization and sub-band, (..., polarization, subband, pixels), put in ``out``
        if given, a contiguous array of the operator's dtype. With ``rows`` only the first so many along the first axis
        of the pixels are imaged, to the same bits.
        """
        block, lead = self._checked(data, "data", (self.pairs, self.frequency.size))
        pixels = (
            self.pixel_shape
            if rows is None
            else (min(rows, self.pixel_shape[0]), *self.pixel_shape[1:])
        )
        shape = (*lead, len(self.subbands), *pixels)
        images = (
            self.engine.buffer(shape, self.dtype)
            if out is None
            else _target(out, shape, self.dtype)
        )
        self.engine.adjoint(
            block, images.reshape(block.shape[0], len(self.subbands), math.prod(pixels))
        )
        return images

    def forward(self, image: ArrayLike) -> NDArray[Any]:
        """Model data (..., polarization, pair, frequency), summed over sub-bands: apply A.

        ``image`` (..., polarization, subband, pixels) is the reflectivity of every pixel, finite; leading axes are
        scans.
        """
        block, lead = self._checked(image, "image", (len(self.subbands), *self.pixel_shape))
        out = np.empty((block.shape[0], self.pairs, self.frequency.size), self.dtype)
        self.engine.forward(block.reshape(*block.shape[:2], math.prod(self.pixel_shape)), out)
        return out.reshape(*lead, *out.shape[1:])

    def _checked(
        self, value: ArrayLike, name: str, tail: tuple[int, ...]
    ) -> tuple[NDArray[Any], tuple[int, ...]]:
        block = np.ascontiguousarray(value, dtype=self.dtype)
        if block.ndim <= len(tail) or block.shape[block.ndim - len(tail) :] != tail:
            raise ValueError(
                f"{name} must have the shape (..., polarization, {', '.join(map(str, tail))}), got {block.shape}"
            )
        # A sum is finite only if all its terms are. If it overflows, and only then, every value is
        # looked at.
        with np.errstate(over="ignore", invalid="ignore"):
            total = block.sum()
        if not np.isfinite(total) and not np.isfinite(block).all():
            count = np.count_nonzero(~np.isfinite(block))
            raise ValueError(
                f"{name} must be finite, got {count} of {block.size} values that are not"
            )
        lead = block.shape[: block.ndim - len(tail)]
        return block.reshape(math.prod(lead), *tail), lead

    def _offsets(self, value: ArrayLike | None) -> NDArray[np.float64]:
        if value is None:
            return np.zeros(self.pairs)
        offset = np.asarray(value, dtype=np.float64)
        if offset.shape != (self.pairs,) or not np.isfinite(offset).all():
            raise ValueError(
                f"path_offset must hold one finite length per pair ({self.pairs}), got shape {offset.shape}"
            )
        return np.ascontiguousarray(offset)

    def _ground(self, value: float | None, pixels: NDArray[np.float64]) -> float | None:
        if value is None:
            return None
        if not (math.isfinite(value) and value >= self.permittivity):
            raise ValueError(
                f"half_space must be a relative permittivity of at least {self.permittivity:g}, that above, got {value}"
            )
        lowest = min(self.tx_position[:, 2].min(), self.rx_position[:, 2].min())
        highest = max(0.0, float(pixels[:, 2].max()))
        if not lowest > highest:
            raise ValueError(
                f"half_space needs all antennas above all pixels and above z = 0 ({highest:g} m), got z = {lowest:g} m"
            )
        return float(value)

    def _bands(self, subbands: Subbands | None) -> tuple[tuple[float, float], ...]:
        if subbands is None:
            return ((float(self.frequency[0]), float(self.frequency[-1])),)
        bands = tuple((float(lo), float(hi)) for lo, hi in subbands)
        if not bands:
            raise ValueError("subbands must name at least one (lo, hi), got none")
        for lo, hi in bands:
            if not (math.isfinite(lo) and math.isfinite(hi) and 0 <= lo <= hi):
                raise ValueError(f"subbands must have 0 <= lo <= hi in Hz, got ({lo:g}, {hi:g})")
        return bands

    def _weights(self, window: str | ArrayLike | None) -> NDArray[np.float64]:
        name = window if isinstance(window, str) else "boxcar"
        if name not in WINDOWS:
            raise ValueError(
                f"window must be one of {', '.join(WINDOWS)} or an array, got {window!r}"
            )
        weight = band_weights(self.frequency, self.subbands, WINDOWS[name])
        for (lo, hi), row in zip(self.subbands, weight, strict=True):
            if not row.any():
                raise ValueError(
                    f"subbands must each hold a tone; {lo:g} to {hi:g} Hz holds none of the tones "
                    f"{self.frequency[0]:g} to {self.frequency[-1]:g} Hz"
                )
        if window is not None and not isinstance(window, str):
            taper = np.asarray(window, dtype=np.float64)
            if taper.shape != self.frequency.shape or not np.isfinite(taper).all():
                raise ValueError(
                    f"window must hold one finite weight per tone ({self.frequency.size}), got shape {taper.shape}"
                )
            weight = weight * taper
        return weight


def _points(value: ArrayLike, name: str) -> NDArray[np.float64]:
    points = np.asarray(value, dtype=np.float64)
    if points.ndim < 1 or points.shape[-1] != 3 or points.size == 0:
        raise ValueError(
            f"{name} must have the shape (..., 3) with at least one point, got {points.shape}"
        )
    if not np.isfinite(points).all():
        raise ValueError(
            f"{name} must be finite, got {np.count_nonzero(~np.isfinite(points))} values that are not"
        )
    return np.ascontiguousarray(points)


def _precision(dtype: DTypeLike | None, tolerance: float) -> np.dtype[Any]:
    if dtype is None:
        return np.dtype(np.complex64 if tolerance >= SINGLE_TOLERANCE else np.complex128)
    kind = np.dtype(dtype)
    if kind not in (np.dtype(np.complex64), np.dtype(np.complex128)):
        raise ValueError(f"dtype must be complex64 or complex128, got {kind}")
    if kind == np.dtype(np.complex64) and tolerance < SINGLE_TOLERANCE:
        raise ValueError(
            f"tolerance must be at least {SINGLE_TOLERANCE:g} in complex64, got {tolerance:g}"
        )
    return kind


def _target(out: NDArray[Any], shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
    if out.shape != shape or out.dtype != dtype or not out.flags.c_contiguous:
        raise ValueError(
            f"out must be contiguous {dtype} of the shape {shape}, got {out.dtype} {out.shape}"
        )
    return out
