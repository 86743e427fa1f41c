"""The imaging operator: the adjoint A^H makes images of data, the forward model A makes data of images."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flgpr.kernels.direct import adjoint_direct, forward_direct
from flgpr.kernels.windows import WINDOWS, band_weights
from flgpr.model import SPEED_OF_LIGHT, check_frequency

Subbands = Sequence[tuple[float, float]]


class ImagingOperator:
    """Backprojection of multistatic stepped-frequency data and its exact transpose.

    With L the total path from transmitter to pixel to receiver, times the refractive index of the medium and less the
    pair's path offset, and w_s(f) the window of sub-band s (zero outside it)::

        adjoint   x_s(p)  = Σ_pair Σ_f w_s(f) b(pair, f) exp(+j2πf L(pair, p)/c)     (Fuse et al. 2018, Eq. 1)
        forward   b(pair, f) = Σ_s Σ_p w_s(f) x_s(p) exp(-j2πf L(pair, p)/c)

    Parameters
    ----------
    frequency : (frequency,) array_like
        Tones, Hz, strictly increasing; they may be uneven or have gaps.
    tx_position, rx_position : (pair, 3) array_like
        Antenna positions of each pair, m, in the frame of the pixels.
    pixels : (..., 3) array_like
        Pixel centres, m: any set of points.
    subbands : sequence of (lo, hi), optional
        Band edges in Hz, both included. None takes the whole band; the sub-band axis stays, with length 1.
    tolerance : float
        Largest relative L2 error against the direct double-precision sum.
    device : {"cpu"}
        Where the sums are computed.
    permittivity : float
        Relative permittivity of the medium between antennas and pixels.
    path_offset : (pair,) array_like, optional
        Length subtracted from every path of a pair, m, for data referenced to a scene centre.
    window : {"boxcar", "hann", "hamming", "taylor"} or (frequency,) array_like, optional
        Weight over the tones of each sub-band; an array is multiplied into every sub-band. Default: none (boxcar).

    Raises
    ------
    ValueError
        Names the parameter, the rule and the value; a sub-band without a tone is one of the cases.

    References
    ----------
    Fuse et al. 2018, Eq. 1-3 and 5.
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
        self._pixels = np.ascontiguousarray(grid.reshape(-1, 3))
        if not (0 < tolerance < 1):
            raise ValueError(f"tolerance must lie between 0 and 1, got {tolerance}")
        self.tolerance = float(tolerance)
        if device != "cpu":
            raise ValueError(f"device must be 'cpu', got {device!r}")
        self.device = device
        if not (math.isfinite(permittivity) and permittivity >= 1):
            raise ValueError(f"permittivity must be at least 1, got {permittivity}")
        self.permittivity = float(permittivity)
        self.path_offset = self._offsets(path_offset)
        self.subbands = self._bands(subbands)
        self.weight = self._weights(window)

    @property
    def pairs(self) -> int:
        """Number of antenna pairs."""
        return self.tx_position.shape[0]

    def adjoint(self, data: ArrayLike) -> NDArray[np.complex64]:
        """Image data: apply A^H.

        Parameters
        ----------
        data : (polarization, pair, frequency) array_like of complex
            Received field.

        Returns
        -------
        (polarization, subband, *pixels.shape[:-1]) ndarray of complex64
            One image per polarization and sub-band.

        Raises
        ------
        ValueError
            If the shape does not fit or a value is not finite.
        """
        block = self._checked(data, "data", (self.pairs, self.frequency.size))
        out = np.empty((block.shape[0], len(self.subbands), self._pixels.shape[0]), np.complex64)
        adjoint_direct(block, *self._geometry(), out)
        return out.reshape(*out.shape[:2], *self.pixel_shape)

    def forward(self, image: ArrayLike) -> NDArray[np.complex64]:
        """Model data: apply A, summed over sub-bands.

        Parameters
        ----------
        image : (polarization, subband, *pixels.shape[:-1]) array_like of complex
            Reflectivity of every pixel.

        Returns
        -------
        (polarization, pair, frequency) ndarray of complex64
            The field the pairs would receive.

        Raises
        ------
        ValueError
            If the shape does not fit or a value is not finite.
        """
        block = self._checked(image, "image", (len(self.subbands), *self.pixel_shape))
        out = np.empty((block.shape[0], self.pairs, self.frequency.size), np.complex64)
        forward_direct(block.reshape(*block.shape[:2], -1), *self._geometry(), out)
        return out

    def _geometry(self) -> tuple[object, ...]:
        wavenumber = self.frequency / SPEED_OF_LIGHT
        index = math.sqrt(self.permittivity)
        positions = (self.tx_position, self.rx_position, self.path_offset)
        return (self.weight, wavenumber, *positions, index, self._pixels)

    def _checked(self, value: ArrayLike, name: str, tail: tuple[int, ...]) -> NDArray[np.complex64]:
        block = np.ascontiguousarray(value, dtype=np.complex64)
        if block.ndim != 1 + len(tail) or block.shape[1:] != tail:
            raise ValueError(
                f"{name} must have the shape (polarization, {', '.join(map(str, tail))}), got {block.shape}"
            )
        if not np.isfinite(block).all():
            count = np.count_nonzero(~np.isfinite(block))
            raise ValueError(f"{name} must be finite, got {count} of {block.size} values that are not")
        return block

    def _offsets(self, value: ArrayLike | None) -> NDArray[np.float64]:
        if value is None:
            return np.zeros(self.pairs)
        offset = np.asarray(value, dtype=np.float64)
        if offset.shape != (self.pairs,) or not np.isfinite(offset).all():
            raise ValueError(
                f"path_offset must hold one finite length per pair ({self.pairs}), got shape {offset.shape}"
            )
        return np.ascontiguousarray(offset)

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
            raise ValueError(f"window must be one of {', '.join(WINDOWS)} or an array, got {window!r}")
        weight = band_weights(self.frequency, self.subbands, WINDOWS[name])
        empty = [band for band, row in zip(self.subbands, weight, strict=True) if not row.any()]
        if empty:
            lo, hi = empty[0]
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
        raise ValueError(f"{name} must have the shape (..., 3) with at least one point, got {points.shape}")
    if not np.isfinite(points).all():
        raise ValueError(f"{name} must be finite, got {np.count_nonzero(~np.isfinite(points))} values that are not")
    return np.ascontiguousarray(points)
