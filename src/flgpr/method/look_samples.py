"""What one scan shows about alarms: patches, range cuts, A-scans and polarimetric coherency."""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from flgpr.features import PatchShape
from flgpr.kernels.focus import focus
from flgpr.kernels.sampling import bilinear
from flgpr.kernels.windows import WINDOWS, band_weights
from flgpr.model import SPEED_OF_LIGHT
from flgpr.model.run import polarizations_of
from flgpr.screen.views import grid_of, sampled
from flgpr.types import Complex128Array, ComplexArray, Float32Array, FloatArray, IndexArray

CUT = np.round(np.arange(-40, 41) * 0.05, 3)
"""Range offsets of the cuts about an alarm, m."""
TRACE = np.round(np.arange(-80, 81) * 0.025, 4)
"""Range offsets of the A-scans about an alarm, m."""
_FLOOR = 1e-6
_TINY = np.finfo(float).tiny


def decibels(magnitude: ArrayLike) -> NDArray[np.float16]:
    """Return magnitudes in dB in half precision, good to 1/32 dB below 64 dB.

    Nothing is below -120 dB; NaN stays.
    """
    return np.asarray(20 * np.log10(np.maximum(magnitude, _FLOOR)), dtype=np.float16)


def in_sight(image: xr.DataArray, points: FloatArray, y_max: float) -> IndexArray:
    """Return the indices of the points (n, 3) in the scan frame that an image shows up to y_max."""
    x = image["x"].values
    y = image["y"].values
    in_x = (points[:, 0] >= x[0]) & (points[:, 0] <= x[-1])
    in_y = (points[:, 1] >= y[0]) & (points[:, 1] <= y[-1]) & (points[:, 1] <= y_max)
    return np.flatnonzero(in_x & in_y)


def patches(magnitude: xr.DataArray, points: FloatArray, shape: PatchShape) -> Float32Array:
    """Sample a scan image on patches about points.

    Parameters
    ----------
    magnitude : (polarization, subband, y, x) DataArray
        Magnitude of a cleaned scan image.
    points : (point, 3) ndarray
        In the scan frame, m.
    shape : PatchShape
        Size and spacing of the patches.

    Returns
    -------
    (point, polarization, subband, y, x) ndarray
        NaN outside the image.
    """
    offsets = np.broadcast_to(shape.offsets(), (len(points), shape.size, shape.size, 2))
    return _sampled(magnitude, points[:, None, None, :2] + offsets)


def cuts_along_sight(magnitude: xr.DataArray, points: FloatArray) -> Float32Array:
    """Sample a scan image along the line of sight through points.

    Parameters
    ----------
    magnitude : (polarization, subband, y, x) DataArray
        Magnitude of a cleaned scan image.
    points : (point, 3) ndarray
        In the scan frame, m.

    Returns
    -------
    (point, polarization, subband, cut) ndarray
        At the offsets ``CUT``; NaN outside the image.
    """
    places = points[:, :2]
    distance = np.hypot(places[:, :1], places[:, 1:])
    line_of_sight = places / np.maximum(distance, _TINY)
    return _sampled(magnitude, places[:, None, :] + CUT[:, None] * line_of_sight[:, None])


def _sampled(magnitude: xr.DataArray, places: FloatArray) -> Float32Array:
    """Interpolate an image at places (point, ..., 2); return values by point and channel."""
    by_channel = sampled(magnitude.values, grid_of(magnitude), places)
    return np.moveaxis(by_channel, 2, 0)


def range_kernel(frequency: FloatArray, offsets: FloatArray) -> Complex128Array:
    """Return the matrix ``w(f)·exp(+j4πfr/c)`` that compresses tones in range.

    Parameters
    ----------
    frequency : (frequency,) ndarray
        Hz.
    offsets : (offset,) ndarray
        Range offsets r, m.

    Returns
    -------
    (frequency, offset) ndarray of complex
        w is the Hann window of sum one.
    """
    band = (float(frequency[0]), float(frequency[-1]))
    weight = band_weights(frequency, (band,), WINDOWS["hann"])[0]
    scale = weight / max(float(weight.sum()), _TINY)
    phase = 4 * np.pi * frequency[:, None] * offsets / SPEED_OF_LIGHT
    return np.asarray(scale[:, None] * np.exp(1j * phase), dtype=np.complex128)


def focused_trace(
    signal: ComplexArray,
    frequency: FloatArray,
    tx: FloatArray,
    rx: FloatArray,
    points: FloatArray,
    kernel: Complex128Array,
) -> Float32Array:
    """Compute A-scans of the whole array focused on points: delays are steered to each of them.

    ``s(r) = mean over pair and f of w(f)·b(pair, f)·exp(+j2πf(L_pair + 2r)/c)`` with the Hann
    window w of mean one. A unit scatterer at the point alone gives the magnitude 1 at r = 0.

    Parameters
    ----------
    signal : (polarization, pair, frequency) ndarray of complex
        A scan's data b.
    frequency : (frequency,) ndarray
        Hz.
    tx, rx : (pair, 3) ndarray
        Antennas in the scan frame, m.
    points : (point, 3) ndarray
        In the scan frame, m.
    kernel : (frequency, range) ndarray of complex
        As of :func:`range_kernel`.

    Returns
    -------
    (point, polarization, range) ndarray
        Magnitudes.
    """
    path = sum(np.linalg.norm(points[:, None] - ends, axis=-1) for ends in (tx, rx))
    traces = np.empty((len(points), len(signal), kernel.shape[1]), np.float32)
    real_and_imaginary = np.stack([kernel.real, kernel.imag]).astype(np.float32)
    wavenumber = frequency / SPEED_OF_LIGHT
    focus(np.asarray(signal, np.complex64), wavenumber, path, real_and_imaginary, traces)
    return traces


def coherency_at(image: xr.DataArray, points: FloatArray) -> Complex128Array:
    """Sum k·k^H over 5 x 5 pixels about points, k the Pauli vector.

    Parameters
    ----------
    image : (polarization, y, x) DataArray of complex
        One sub-band of a cleaned scan image.
    points : (point, 3) ndarray
        In the scan frame, m.

    Returns
    -------
    (point, 3, 3) ndarray of complex
        Zero where a polarization is missing.
    """
    labels = polarizations_of(image)
    cross_polarized = [label for label in ("HV", "VH") if label in labels]
    if not ({"HH", "VV"} <= set(labels) and cross_polarized):
        return np.zeros((len(points), 3, 3), np.complex128)

    x = image["x"].values
    y = image["y"].values
    offset = np.arange(-2.0, 3.0)
    row = ((points[:, 1] - y[0]) / (y[1] - y[0]))[:, None, None] + offset[:, None]
    column = ((points[:, 0] - x[0]) / (x[1] - x[0]))[:, None, None] + offset
    pixels = np.broadcast_arrays(row, column)

    def values(label: str) -> Complex128Array:
        return bilinear(image.values[labels.index(label)], *pixels)

    hh = values("HH")
    vv = values("VV")
    hv = np.mean([values(label) for label in cross_polarized], axis=0)
    pauli = np.stack([hh + vv, hh - vv, 2 * hv], axis=1).reshape(len(points), 3, -1)
    vector = np.nan_to_num(pauli) / np.sqrt(2)
    return np.asarray(vector @ vector.conj().swapaxes(1, 2), dtype=np.complex128)
