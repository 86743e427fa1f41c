"""The field that stands still on the vehicle, taken out of the data before anything is imaged."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

ComplexArray = NDArray[np.complex64]


def standing_field(signal: ArrayLike) -> ComplexArray:
    """Estimate what is the same in all scans: direct coupling and echoes of the vehicle itself.

    Of a signal (scan, polarization, pair, frequency) of at least three scans it is the median of the real and of the
    imaginary part of every sample: ground that passes by does not enter it.
    """
    data = np.asarray(signal, dtype=np.complex64)
    if len(data) < 3:
        raise ValueError(
            f"signal must hold at least three scans to tell what stands still, got {len(data)}"
        )
    return np.stack(
        [
            np.median(one.real, axis=0) + 1j * np.median(one.imag, axis=0)
            for one in data.swapaxes(0, 1)
        ]
    )


def subtract_standing(data: ArrayLike, field: ComplexArray) -> ComplexArray:
    """Subtract the standing field, fitted to the complex gain of every scan and polarization of the data.

    Examples
    --------
    >>> import numpy as np
    >>> from flgpr.clutter import standing_field, subtract_standing
    >>> still = np.array([[[1.0 + 2.0j, -3.0j, 2.0]]])
    >>> scans = np.array([0.9, 1.0, 1.1])[:, None, None, None] * still
    >>> np.abs(subtract_standing(scans, standing_field(scans))).max() < 1e-6
    np.True_
    """
    signal = np.asarray(data, dtype=np.complex64)
    power = np.sum(np.abs(field) ** 2, axis=(1, 2), dtype=np.float64)
    gain = np.einsum("...pnk,pnk->...p", signal, field.conj()) / np.where(power > 0, power, 1.0)
    return np.asarray(signal - gain[..., None, None] * field, dtype=np.complex64)
