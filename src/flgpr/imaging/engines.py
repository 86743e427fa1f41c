"""Ways to compute the imaging sums behind one interface: term by term, or from interpolated range profiles."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from flgpr.imaging.plan import Layout, Plan, make_plan
from flgpr.kernels import profiles, transform
from flgpr.kernels.direct import adjoint_direct, forward_direct
from flgpr.kernels.geometry import antenna_paths
from flgpr.kernels.layout import CHANNELS, aligned
from flgpr.model import SPEED_OF_LIGHT

FloatArray = NDArray[np.float64]


class Engine(Protocol):
    """The adjoint and the forward sums on checked arrays."""

    method: str

    def adjoint(self, data: NDArray[Any], out: NDArray[Any]) -> None:
        """Fill ``out`` (polarization, subband, pixel) from ``data`` (polarization, pair, tone)."""

    def forward(self, image: NDArray[Any], out: NDArray[Any]) -> None:
        """Fill ``out`` (polarization, pair, tone) from ``image`` (polarization, subband, pixel)."""


class DirectEngine:
    """Sums term by term in double precision."""

    method = "direct"

    def __init__(self, layout: Layout, frequency: FloatArray, weight: FloatArray, offset: FloatArray) -> None:
        path = np.empty((layout.antenna.shape[0], layout.pixels.shape[1]))
        antenna_paths(layout.pixels, layout.antenna, layout.medium, path)
        active = weight.any(axis=0)
        self._active = active
        self._sums = (weight[:, active], frequency[active] / SPEED_OF_LIGHT, path, layout.tx, layout.rx, offset)
        self._gain = layout.gain

    def adjoint(self, data: NDArray[Any], out: NDArray[Any]) -> None:
        """Fill ``out`` (polarization, subband, pixel) from ``data`` (polarization, pair, tone)."""
        adjoint_direct(np.ascontiguousarray(data[..., self._active]), *self._sums, self._gain, out)

    def forward(self, image: NDArray[Any], out: NDArray[Any]) -> None:
        """Fill ``out`` (polarization, pair, tone) from ``image`` (polarization, subband, pixel)."""
        part = np.empty((*out.shape[:2], np.count_nonzero(self._active)), out.dtype)
        forward_direct(image, *self._sums, self._gain, part)
        out[...] = 0
        out[..., self._active] = part


class ProfileEngine:
    """Range profiles and their interpolation in single precision on the CPU."""

    method = "profile"

    def __init__(self, plan: Plan, weight: FloatArray, phase: NDArray[np.complex128] | None) -> None:
        self._plan = plan
        self._weight = weight.astype(np.float32)
        self._phase = None if phase is None else phase.astype(np.complex64)
        self._taps = (0,) * plan.window.width

    def adjoint(self, data: NDArray[Any], out: NDArray[Any]) -> None:
        """Fill ``out`` (polarization, subband, pixel) from ``data`` (polarization, pair, tone)."""
        plan = self._plan
        if self._phase is not None:
            data = data * self._phase
        for rows, bands, channels in passes(*out.shape[:2]):
            table = self._table(channels)
            lane = (0,) * channels
            transform.compress(data[rows], self._weight[bands], plan.spectrum, table, lane)
            part = out[rows, bands].reshape(-1, out.shape[2])
            profiles.adjoint(table, plan.bins, plan.geometry, part, self._taps, lane)

    def forward(self, image: NDArray[Any], out: NDArray[Any]) -> None:
        """Fill ``out`` (polarization, pair, tone) from ``image`` (polarization, subband, pixel)."""
        plan = self._plan
        out[...] = 0
        for rows, bands, channels in passes(*image.shape[:2]):
            table = self._table(channels)
            lane = (0,) * channels
            part = image[rows, bands].reshape(-1, image.shape[2])
            profiles.forward(table, plan.bins, plan.geometry, part, self._taps, lane)
            transform.expand(table, self._weight[bands], plan.spectrum, out[rows], lane)
        if self._phase is not None:
            out *= self._phase.conj()

    def _table(self, channels: int) -> NDArray[np.float32]:
        return aligned(self._plan.geometry.tx.size * self._plan.bins * 2 * channels, np.float32)


def passes(polarizations: int, subbands: int) -> list[tuple[slice, slice, int]]:
    """Split the images into passes of at most as many channels as a lane row holds.

    Returns the polarizations and the sub-bands of each pass and the channels of its rows. A pass takes all sub-bands of
    some polarizations, or some sub-bands of one, so that its images are neighbours in memory.
    """
    most = max(CHANNELS)
    bands_held = min(subbands, most)
    rows_held = most // bands_held if subbands <= most else 1
    found = []
    for row in range(0, polarizations, rows_held):
        rows = slice(row, min(row + rows_held, polarizations))
        for band in range(0, subbands, bands_held):
            bands = slice(band, min(band + bands_held, subbands))
            needed = (rows.stop - rows.start) * (bands.stop - bands.start)
            found.append((rows, bands, min(c for c in CHANNELS if c >= needed)))
    return found


def make_engine(
    layout: Layout, frequency: FloatArray, weight: FloatArray, offset: FloatArray, tolerance: float,
    dtype: np.dtype[Any], device: str, method: str,
) -> Engine:  # fmt: skip
    """Choose and prepare the engine for a device, a precision and a method.

    Raises
    ------
    ValueError
        If the device or the method is not known.
    """
    if device != "cpu":
        raise ValueError(f"device must be 'cpu', got {device!r}")
    if method not in ("auto", "profile", "direct"):
        raise ValueError(f"method must be 'auto', 'profile' or 'direct', got {method!r}")
    if method == "direct" or dtype == np.dtype(np.complex128):
        return DirectEngine(layout, frequency, weight, offset)
    active = np.asarray(weight.any(axis=0))
    if method == "auto" and layout.count * np.count_nonzero(active) < 2000:
        return DirectEngine(layout, frequency, weight, offset)
    plan = make_plan(frequency, active, layout, tolerance)
    phase = plan.phase
    if offset.any():
        turns = -offset[:, None] * frequency / SPEED_OF_LIGHT
        shift = np.exp(2j * np.pi * (turns - np.floor(turns)))
        phase = shift if phase is None else shift * phase
    return ProfileEngine(plan, weight, phase)
