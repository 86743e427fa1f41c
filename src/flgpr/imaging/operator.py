"""The imaging operator: the adjoint A^H images data, the forward model A predicts data.

What computes the sums is chosen in ``_make_backend``: on a CPU it is ``imaging/cpu.py``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from flgpr.imaging.backend import Backend
from flgpr.imaging.cpu import DirectBackend, PreciseBackend, ProfileBackend
from flgpr.imaging.plan import ImagingLayout, Pattern, lay_out, make_plan
from flgpr.kernels.layout import CHANNELS
from flgpr.kernels.windows import WINDOWS, band_weights
from flgpr.model import check_frequency
from flgpr.types import AnyArray, FloatArray, floats

Subbands = Sequence[tuple[float, float]]

SINGLE_TOLERANCE = 1e-5
"""Smallest tolerance that single precision keeps."""


class ImagingOperator:
    """Backprojection of multistatic stepped-frequency data and its exact transpose.

    With L the total optical path from transmitter to pixel to receiver less the pair's path offset,
    g the product of the two antennas' amplitudes (one by default) and w_s(f) the window of sub-band
    s (zero outside it)::

        adjoint   x_s(p)  = Σ_pair Σ_f w_s(f) g(pair, p) b(pair, f) exp(+j2πf L(pair, p)/c)
        forward   b(pair, f) = Σ_s Σ_p w_s(f) g(pair, p) x_s(p) exp(-j2πf L(pair, p)/c)

    The adjoint is Eq. 1 of Fuse et al. 2018.

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

    Raises
    ------
    ValueError
        If a parameter breaks its rule, or a sub-band has no tone.

    References
    ----------
    Fuse et al. 2018, Eq. 1-3 and 5.

    Examples
    --------
    The data of a point are predicted and imaged. Nothing is normalised: the image peaks at the
    number of pairs times tones.

    >>> import numpy as np
    >>> from flgpr.imaging import ImagingOperator
    >>> from flgpr.model import Grid
    >>> frequency = 0.5e9 + 10e6 * np.arange(101)
    >>> rx = np.column_stack([np.linspace(-0.8, 0.8, 9), np.zeros(9), np.full(9, 1.5)])
    >>> tx = np.zeros((9, 3)) + [0.0, 0.0, 1.5]
    >>> grid = Grid.spanning((-1.0, 1.0), (4.0, 6.0), 0.05)
    >>> point = ImagingOperator(frequency, tx, rx, [[[0.25, 5.0, 0.0]]], method="direct")
    >>> data = point.forward(np.ones((1, 1, 1, 1)))  # polarization, pair, frequency
    >>> operator = ImagingOperator(frequency, tx, rx, grid.points())
    >>> image = np.abs(operator.adjoint(data)[0, 0])  # y, x
    >>> row, column = np.unravel_index(image.argmax(), image.shape)
    >>> float(grid.x[column]), float(grid.y[row]), round(float(image.max())) == 9 * 101
    (0.25, 5.0, True)
    """

    def __init__(
        self,
        frequency: ArrayLike,
        tx_position: ArrayLike,
        rx_position: ArrayLike,
        pixels: ArrayLike,
        subbands: Subbands | None = None,
        tolerance: float = 1e-3,
        device: str = "cpu",
        permittivity: float = 1.0,
        path_offset: ArrayLike | None = None,
        window: str | ArrayLike | None = None,
        half_space: float | None = None,
        tx_pattern: Pattern | None = None,
        rx_pattern: Pattern | None = None,
        dtype: DTypeLike | None = None,
        method: str = "auto",
    ) -> None:
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

        ground_index = math.sqrt(self.half_space) if self.half_space else 0.0
        medium = (math.sqrt(self.permittivity), ground_index)
        patterns = (tx_pattern, rx_pattern)
        layout = lay_out(self.tx_position, self.rx_position, points, medium, patterns)
        self.backend = self._make_backend(layout, method)

    @property
    def pairs(self) -> int:
        """Number of antenna pairs."""
        return self.tx_position.shape[0]

    @property
    def method(self) -> str:
        """Method in use, "profile" or "direct"."""
        return self.backend.method

    @property
    def width(self) -> int:
        """Number of bins that the interpolation window covers; zero for direct sums."""
        return self.backend.width

    def image_buffer(self, *lead: int) -> AnyArray:
        """Allocate images (lead, subband, pixels) for ``out``; page-locked for a CUDA device."""
        return self.backend.buffer((*lead, len(self.subbands), *self.pixel_shape), self.dtype)

    def adjoint(
        self, data: ArrayLike, out: AnyArray | None = None, rows: int | None = None
    ) -> AnyArray:
        """Return the image of data: apply A^H.

        Parameters
        ----------
        data : (..., polarization, pair, frequency) array_like of complex
            Received fields, finite; leading axes are scans taken with one geometry.
        out : (..., polarization, subband, pixels) ndarray, optional
            Memory for the result: contiguous, of the operator's dtype.
        rows : int, optional
            Rows to image along the first axis of the pixels, to the same bits; by default all.

        Returns
        -------
        (..., polarization, subband, pixels) ndarray
            Image per polarization and sub-band.

        Raises
        ------
        ValueError
            If the data have another shape or are not finite, or ``out`` does not fit.
        """
        block, lead = self._checked(data, "data", (self.pairs, self.frequency.size))
        pixels = self.pixel_shape
        if rows is not None:
            pixels = (min(rows, pixels[0]), *pixels[1:])
        shape = (*lead, len(self.subbands), *pixels)
        if out is None:
            out = self.backend.buffer(shape, self.dtype)
        images = _checked_target(out, shape, self.dtype)
        flat = images.reshape(block.shape[0], len(self.subbands), math.prod(pixels))
        self.backend.adjoint(block, flat)
        return images

    def forward(self, image: ArrayLike) -> AnyArray:
        """Return the data of an image, summed over sub-bands: apply A.

        Parameters
        ----------
        image : (..., polarization, subband, pixels) array_like of complex
            Reflectivity of every pixel, finite; leading axes are scans.

        Returns
        -------
        (..., polarization, pair, frequency) ndarray
            Data.

        Raises
        ------
        ValueError
            If the image has another shape or is not finite.
        """
        block, lead = self._checked(image, "image", (len(self.subbands), *self.pixel_shape))
        flat = block.reshape(*block.shape[:2], math.prod(self.pixel_shape))
        out = np.empty((block.shape[0], self.pairs, self.frequency.size), self.dtype)
        self.backend.forward(flat, out)
        return out.reshape(*lead, *out.shape[1:])

    def _checked(
        self, value: ArrayLike, name: str, tail: tuple[int, ...]
    ) -> tuple[AnyArray, tuple[int, ...]]:
        """Return values as (row, *tail), all leading axes in one, and the axes before them."""
        block = np.ascontiguousarray(value, dtype=self.dtype)
        if block.ndim <= len(tail) or block.shape[block.ndim - len(tail) :] != tail:
            raise ValueError(
                f"{name} must have the shape (..., polarization, {', '.join(map(str, tail))}), "
                f"got {block.shape}"
            )
        # A sum is finite only if all its terms are. Every value is checked only where it overflows.
        with np.errstate(over="ignore", invalid="ignore"):
            total = block.sum()
        if not np.isfinite(total) and not np.isfinite(block).all():
            count = np.count_nonzero(~np.isfinite(block))
            raise ValueError(
                f"{name} must be finite, got {count} of {block.size} values that are not"
            )
        lead = block.shape[: block.ndim - len(tail)]
        return block.reshape(math.prod(lead), *tail), lead

    def _offsets(self, value: ArrayLike | None) -> FloatArray:
        """Return the checked path offset (pair,), by default zero."""
        if value is None:
            return np.zeros(self.pairs)
        offset = floats(value)
        if offset.shape != (self.pairs,) or not np.isfinite(offset).all():
            raise ValueError(
                f"path_offset must hold one finite length per pair ({self.pairs}), "
                f"got shape {offset.shape}"
            )
        return np.ascontiguousarray(offset)

    def _ground(self, value: float | None, pixels: FloatArray) -> float | None:
        """Return the checked permittivity of the ground, above which all antennas must lie."""
        if value is None:
            return None
        if not (math.isfinite(value) and value >= self.permittivity):
            raise ValueError(
                "half_space must be a relative permittivity of at least "
                f"{self.permittivity:g}, that above, got {value}"
            )
        lowest = min(self.tx_position[:, 2].min(), self.rx_position[:, 2].min())
        highest = max(0.0, float(pixels[:, 2].max()))
        if not lowest > highest:
            raise ValueError(
                "half_space needs all antennas above all pixels and above z = 0 "
                f"({highest:g} m), got z = {lowest:g} m"
            )
        return float(value)

    def _bands(self, subbands: Subbands | None) -> tuple[tuple[float, float], ...]:
        """Return the checked sub-bands, by default the whole band."""
        if subbands is None:
            return ((float(self.frequency[0]), float(self.frequency[-1])),)
        bands = tuple((float(lo), float(hi)) for lo, hi in subbands)
        if not bands:
            raise ValueError("subbands must name at least one (lo, hi), got none")
        for lo, hi in bands:
            if not (math.isfinite(lo) and math.isfinite(hi) and 0 <= lo <= hi):
                raise ValueError(f"subbands must have 0 <= lo <= hi in Hz, got ({lo:g}, {hi:g})")
        return bands

    def _weights(self, window: str | ArrayLike | None) -> FloatArray:
        """Return the weights (subband, frequency); every sub-band must hold a tone."""
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
            taper = floats(window)
            if taper.shape != self.frequency.shape or not np.isfinite(taper).all():
                raise ValueError(
                    f"window must hold one finite weight per tone ({self.frequency.size}), "
                    f"got shape {taper.shape}"
                )
            weight = weight * taper
        return weight

    def _make_backend(self, layout: ImagingLayout, method: str) -> Backend:
        """Choose and prepare what computes the sums, for the device, the precision and a method.

        What cannot be combined is a ValueError.
        """
        if self.device not in ("cpu", "cuda"):
            raise ValueError(f"device must be 'cpu' or 'cuda', got {self.device!r}")
        if method not in ("auto", "profile", "direct"):
            raise ValueError(f"method must be 'auto', 'profile' or 'direct', got {method!r}")
        active = np.asarray(self.weight.any(axis=0))
        # Below this many terms per pair, profiles cost more than the sums themselves.
        few = layout.count * np.count_nonzero(active) < 2000
        if self.device == "cpu" and (method == "direct" or (method == "auto" and few)):
            return DirectBackend(layout, self.frequency, self.weight, self.path_offset)
        single = self.dtype == np.dtype(np.complex64)
        # What single precision adds to the window's error is small but not nothing.
        window_tolerance = 0.9 * self.tolerance if single else self.tolerance
        plan = make_plan(self.frequency, active, layout, self.path_offset, window_tolerance)
        # 32-bit delays and indices do not suffice with many thousands of tones.
        table_size = self.pairs * plan.bins * 2 * max(CHANNELS)
        fits_single = plan.rounding < self.tolerance / 2 and table_size < 2**32
        if self.device == "cpu":
            backend = ProfileBackend if single and fits_single else PreciseBackend
            return backend(plan, self.weight)

        # A CUDA device has single precision and profiles only.
        if not single:
            raise ValueError(
                "dtype must be complex64 (and tolerance at least 1e-5) with device 'cuda', "
                f"got {self.dtype}"
            )
        if method == "direct":
            raise ValueError("method must be 'auto' or 'profile' with device 'cuda', got 'direct'")
        if not fits_single:
            raise ValueError(
                f"tolerance must be at least {2 * plan.rounding:.0e} with device 'cuda' and these "
                f"tones, got {self.tolerance:g}"
            )
        # Imported here because it needs numba-cuda, which only users of a device install.
        try:
            from flgpr.imaging.cuda import CudaBackend
        except ImportError as error:
            raise ValueError(f"device 'cuda' needs the package numba-cuda: {error}") from None
        return CudaBackend(plan, self.weight)


# Checks of what is given


def _points(value: ArrayLike, name: str) -> FloatArray:
    """Return checked points (..., 3), at least one."""
    points = floats(value)
    if points.ndim < 1 or points.shape[-1] != 3 or points.size == 0:
        raise ValueError(
            f"{name} must have the shape (..., 3) with at least one point, got {points.shape}"
        )
    infinite = np.count_nonzero(~np.isfinite(points))
    if infinite:
        raise ValueError(f"{name} must be finite, got {infinite} values that are not")
    return np.ascontiguousarray(points)


def _precision(dtype: DTypeLike | None, tolerance: float) -> np.dtype[Any]:
    """Return the checked dtype, by default the smallest that keeps the tolerance."""
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


def _checked_target(out: AnyArray, shape: tuple[int, ...], dtype: np.dtype[Any]) -> AnyArray:
    """Return the memory for a result, which must be contiguous and of its shape and dtype."""
    if out.shape != shape or out.dtype != dtype or not out.flags.c_contiguous:
        raise ValueError(
            f"out must be contiguous {dtype} of the shape {shape}, got {out.dtype} {out.shape}"
        )
    return out
